// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <vector>

namespace rayloom
{

/// Filtered light multiplied by its pivot.
class Modulate final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.modulate")
            .summary("Multiplies filtered light by its pivot image, so that texture returns.")
            .doc("L = Lₐ · ζ, channel by channel: the inverse of transform.demodulate. Where "
                 "`marked` is not 0 nothing was divided, so nothing is multiplied: the value is "
                 "that of `original`, untouched by any filter, or without it that of `image`. "
                 "Alpha and every other channel pass through.")
            .source("003_fb3ee135f07a6099.txt, end of section 4.4")
            .accuracy("One multiplication in float.")
            .example("rayloom: 1\n"
                     "name: modulate-example\n"
                     "doc: Divides by the albedo and multiplies it back.\n"
                     "inputs:\n"
                     "  radiance: {doc: linear radiance, channels: RGB}\n"
                     "  albedo: {doc: directional albedo, channels: RGB}\n"
                     "nodes:\n"
                     "  light: {op: transform.demodulate, image: radiance, pivot: albedo}\n"
                     "  back: {op: transform.modulate, image: light.image, pivot: albedo, "
                     "marked: light.marked, original: radiance}\n"
                     "outputs:\n"
                     "  image: back\n");
        d.input("image", "filtered light ζ");
        d.input("pivot", "the pivot it was divided by: as many colour channels, or one for all");
        d.input("marked", "marks of transform.demodulate").optional();
        d.input("original", "the radiance that was divided; kept where marked").optional();
        d.output("image", "radiance, channels as `image`");
    }

    explicit Modulate(const Params&) {}

    void plan(PlanContext& context) override
    {
        m_image = require_colours(context, "image");
        m_pivot = matching_colours(context, "image", "pivot", ColourCount::same_or_one);
        if (context.has("marked"))
            m_marked = matching_colours(context, "image", "marked", ColourCount::same_or_one);
        if (context.has("original")) m_original = matching_colours(context, "image", "original");
        if (context.has("original") && !context.has("marked"))
            throw NodeError("'original' is only used where 'marked' says so; connect 'marked' too");
        context.output("image", context.input("image"));
        m_passed.plan(context, "image", m_image);
    }

    void compute(const TileContext& context) const override
    {
        const Region& r = context.region();
        const ImageView out = context.output("image");
        const ConstImageView image = context.input("image"), pivot = context.input("pivot");
        for (int y = r.y0; y < r.y1; ++y) {
            for (std::size_t c = 0; c < m_image.size(); ++c) {
                const float* z = image.ptr(m_image[c], r.x0, y);
                const float* p = pivot.ptr(m_pivot[c], r.x0, y);
                float* to = out.row(m_image[c], y);
                if (m_marked.empty()) {
                    for (int x = 0; x < r.width(); ++x) to[x] = z[x] * p[x];
                    continue;
                }
                const float* mark = context.input("marked").ptr(m_marked[c], r.x0, y);
                const float* keep =
                    m_original.empty() ? z : context.input("original").ptr(m_original[c], r.x0, y);
                for (int x = 0; x < r.width(); ++x) to[x] = mark[x] != 0.0f ? keep[x] : z[x] * p[x];
            }
        }
        m_passed.copy(image, out);
    }

private:
    std::vector<int> m_image, m_pivot, m_marked, m_original;
    PassedChannels m_passed;
};

RAYLOOM_NODE(Modulate);

} // namespace rayloom
