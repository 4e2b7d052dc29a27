// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <cmath>
#include <string>
#include <vector>

namespace rayloom
{

/// Radiance divided by its pivot.
class Demodulate final : public Node
{
public:
    struct Params {
        float threshold = 0.001f;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.demodulate")
            .summary("Divides radiance by its pivot image, so that texture leaves and light stays.")
            .doc("z = L / Lₐ, channel by channel. The pivot Lₐ is the view under unit ambient "
                 "light: the directional albedo, which renderers write as a colour pass (of a "
                 "lobe) or as the denoising albedo. Where Lₐ is not above `threshold` times its "
                 "mean over the image, or not finite, z is L itself and `marked` is 1; elsewhere "
                 "`marked` is 0. A variance is divided by the square of the same figure. Alpha and "
                 "every other channel pass through.\n\n"
                 "transform.modulate with the same pivot and marks is the inverse.")
            .source("003_fb3ee135f07a6099.txt, section 4.1, equation 9 and z = L / Lₐ")
            .accuracy("One division in float; multiplied back, within 1 unit in the last place.")
            .example("rayloom: 1\n"
                     "name: demodulate-example\n"
                     "doc: The light that falls on the surfaces, without their texture.\n"
                     "inputs:\n"
                     "  radiance: {doc: linear radiance, channels: RGB}\n"
                     "  albedo: {doc: directional albedo, channels: RGB}\n"
                     "nodes:\n"
                     "  light: {op: transform.demodulate, image: radiance, pivot: albedo}\n"
                     "outputs:\n"
                     "  image: light.image\n"
                     "  marked: light.marked\n");
        d.input("image", "linear radiance L");
        d.input("pivot", "pivot Lₐ: as many colour channels as `image`, or one for all");
        d.input("variance", "variance of L, colour channels as `image`").optional();
        d.output("image", "z, channels as `image`");
        d.output("marked", "1 where the pivot was too small to divide by, per colour channel")
            .optional();
        d.output("variance", "variance of z").optional();
        d.param("threshold", &Params::threshold,
                "share of the mean pivot that a pixel's pivot must exceed")
            .range(0, 1);
    }

    explicit Demodulate(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_image = require_colours(context, "image");
        m_pivot = matching_colours(context, "image", "pivot", ColourCount::same_or_one);
        context.output("image", image);
        const ImageDesc colours = image.with_channels(channel_names(image, m_image));
        context.output("marked", colours);
        m_passed.plan(context, "image", m_image);
        if (context.has("variance")) {
            m_variance = matching_colours(context, "image", "variance");
            context.output("variance", colours);
        }
        context.reduce(image.data, 2);
        context.reduce_needs("pivot");
    }

    void reduce(const TileContext& rows, std::span<double> sums) const override
    {
        const ConstImageView pivot = rows.input("pivot");
        const Region& r = rows.region();
        for (int y = r.y0; y < r.y1; ++y)
            for (const int c : m_pivot) {
                const float* p = pivot.ptr(c, r.x0, y);
                for (int x = 0; x < r.width(); ++x)
                    if (std::isfinite(p[x]) && p[x] > 0.0f) {
                        sums[0] += static_cast<double>(p[x]);
                        sums[1] += 1.0;
                    }
            }
    }

    std::map<std::string, Table, std::less<>> finish(std::span<const double> totals,
                                                     std::span<const TileContext::Input>) override
    {
        m_limit = totals[1] > 0.0 ? static_cast<float>(m.threshold * totals[0] / totals[1]) : 0.0f;
        return {};
    }

    void compute(const TileContext& context) const override
    {
        const Region& r = context.region();
        const ConstImageView image = context.input("image"), pivot = context.input("pivot");
        const bool variance = context.has("variance") && context.wants("variance");
        std::size_t marks = 0;
        for (int y = r.y0; y < r.y1; ++y) {
            for (std::size_t c = 0; c < m_image.size(); ++c) {
                const int to = static_cast<int>(c);
                const float* l = image.ptr(m_image[c], r.x0, y);
                const float* p = pivot.ptr(m_pivot[c], r.x0, y);
                float* z =
                    context.wants("image") ? context.output("image").row(m_image[c], y) : nullptr;
                float* mark =
                    context.wants("marked") ? context.output("marked").row(to, y) : nullptr;
                const float* v =
                    variance ? context.input("variance").ptr(m_variance[c], r.x0, y) : nullptr;
                float* vz = variance ? context.output("variance").row(to, y) : nullptr;
                for (int x = 0; x < r.width(); ++x) {
                    const bool divide = std::isfinite(p[x]) && p[x] > m_limit;
                    marks += divide ? 0 : 1;
                    if (z) z[x] = divide ? l[x] / p[x] : l[x];
                    if (mark) mark[x] = divide ? 0.0f : 1.0f;
                    if (vz) vz[x] = divide ? v[x] / p[x] / p[x] : v[x];
                }
            }
        }
        if (context.wants("image")) m_passed.copy(image, context.output("image"));
        if (marks > 0) context.count("values whose pivot is too small", marks);
    }

private:
    Params m;
    std::vector<int> m_image, m_pivot, m_variance;
    PassedChannels m_passed;
    float m_limit = 0.0f;
};

RAYLOOM_NODE(Demodulate);

} // namespace rayloom
