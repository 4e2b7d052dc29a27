// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/deep_samples.h"
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

namespace rayloom
{

namespace
{

/// A deep image as a viewer sees it.
class DeepFlatten final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.deep_flatten")
            .summary("Flattens a deep image: every pixel's samples over one another.")
            .doc("Colour and alpha of the samples, which are premultiplied, are put over one "
                 "another in the order of Z, nearest first: with Tᵢ = Π (1 − αⱼ) over the samples "
                 "in front, a channel is Σ Tᵢ vᵢ and alpha Σ Tᵢ αᵢ. Samples of equal Z keep the "
                 "order they are stored in, and so do all where there is no Z; where volumes "
                 "(ZBack) overlap, their fronts count. A pixel without samples is 0. Depth, ids "
                 "and other channels are left out.\n\n"
                 "Alpha counts as 0..1 and NaN alpha as 0. What lies behind full coverage counts "
                 "for nothing, be it NaN; a NaN that is seen is seen.\n\n"
                 "Errors: a deep image without alpha or without colour.")
            .source("Interpreting OpenEXR Deep Pixels, \"Flattening\" (openexr.com)")
            .accuracy("Summed in double; exact to float rounding.")
            .example("rayloom: 1\n"
                     "name: deep-flatten-example\n"
                     "doc: A deep render as a flat image.\n"
                     "inputs:\n"
                     "  deep: {doc: deep render, kind: deep}\n"
                     "nodes:\n"
                     "  flat: {op: transform.deep_flatten, deep: deep}\n"
                     "outputs:\n"
                     "  image: flat\n");
        d.input("deep", "premultiplied colour, alpha and Z").deep();
        d.output("image", "colour and alpha, premultiplied");
    }

    explicit DeepFlatten(const Params&) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& deep = context.input("deep");
        m_alpha = require_deep_alpha(deep);
        m_depth = deep.channel("Z");
        m_colour = deep_colour(deep);
        if (m_colour.empty()) throw NodeError("input 'deep' has no colour channel to flatten");
        std::vector<std::string> names = channel_names(deep, m_colour);
        names.push_back(deep.channels[static_cast<std::size_t>(m_alpha)]);
        context.output("image", deep.with_channels(names));
    }

    void compute(const TileContext& context) const override
    {
        const ImageView out = context.output("image");
        const DeepView deep = context.deep("deep");
        const Region& region = context.region();
        DeepVisibility seen;
        for (int y = region.y0; y < region.y1; ++y) {
            context.check_cancelled();
            const DeepRow& row = deep.row(y);
            for (int x = region.x0; x < region.x1; ++x) {
                const int at = x - deep.region.x0;
                seen.look(row.pixel(m_alpha, at),
                          m_depth < 0 ? std::span<const float>() : row.pixel(m_depth, at));
                int to = 0;
                for (const int c : m_colour)
                    out.at(to++, x, y) = static_cast<float>(seen.flatten(row.pixel(c, at)));
                out.at(to, x, y) = static_cast<float>(seen.coverage());
            }
        }
    }

private:
    std::vector<int> m_colour;
    int m_alpha = -1, m_depth = -1;
};

} // namespace

RAYLOOM_NODE(DeepFlatten);

} // namespace rayloom
