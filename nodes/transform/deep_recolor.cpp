// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/deep_samples.h"
#include "rayloom/core/deep_node.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <cmath>

namespace rayloom
{

namespace
{

/// A deep image whose flattened colour is that of a flat one.
class DeepRecolor final : public DeepNode
{
public:
    struct Params {
        std::string method = "scale";
        float max_gain = 8.0f;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.deep_recolor")
            .summary("Gives a deep image the colour of a flat one, such as its denoised render.")
            .doc("The colours of each pixel's samples are changed so that the pixel flattens "
                 "(transform.deep_flatten) to the colour of the flat image. Alpha, Z, ZBack, ids "
                 "and every other channel keep their samples, bit for bit, and the number and "
                 "order of samples stay. Both images are premultiplied, and the flat one's alpha "
                 "is not used.\n\n"
                 "With C the flat colour, F what the samples flatten to, A their alpha together "
                 "and αᵢ that of one, a sample's value v becomes g·v + αᵢ·(C − g·F) / A, each "
                 "channel apart.\n\n"
                 "- `scale`: g = C / F, but at most `max_gain`, and 0 where C and F differ in "
                 "sign or F is 0. A red surface behind a blue one stays red; what a gain of "
                 "`max_gain` does not reach is spread by coverage.\n"
                 "- `spread`: g = 0. Every sample gets the flat colour, unpremultiplied, times "
                 "its alpha, as deep compositors recolour deep opacity.\n\n"
                 "A colour channel the deep image does not have is added, by spreading. Where "
                 "all alpha of a pixel is 0, g has no limit, and colour that cannot be scaled "
                 "goes to the nearest sample. A pixel without samples cannot hold colour: if the "
                 "flat image has any there, it is counted in the report, and the flattened result "
                 "is black. Samples that are NaN or infinite count as 0 and get a finite value if "
                 "the flat colour is one.\n\n"
                 "Errors: a deep image without alpha, a flat one without colour, data windows "
                 "that differ.")
            .source("Interpreting OpenEXR Deep Pixels (openexr.com)")
            .accuracy("Computed in double, stored as float: the recoloured image flattens to the "
                      "flat colour within 1e-6 of the sum of the samples' magnitudes.")
            .example("rayloom: 1\n"
                     "name: deep-recolor-example\n"
                     "doc: Gives a deep render the colour of a denoised one.\n"
                     "inputs:\n"
                     "  deep: {doc: deep render, kind: deep}\n"
                     "  color: {doc: denoised radiance, channels: RGB}\n"
                     "nodes:\n"
                     "  recolored: {op: transform.deep_recolor, deep: deep, color: color}\n"
                     "outputs:\n"
                     "  deep: recolored\n");
        d.input("deep", "premultiplied samples with alpha; colour and Z if it has them").deep();
        d.input("color", "the colour the result flattens to, premultiplied");
        d.output("deep", "the deep image with the colour of the flat one").deep();
        d.param("method", &Params::method, "how the colour is shared out among a pixel's samples")
            .choices({"scale", "spread"});
        d.param("max_gain", &Params::max_gain,
                "times brighter `scale` makes a sample before it spreads")
            .range(1, 1e6);
    }

    explicit DeepRecolor(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& deep = context.input("deep");
        const ImageDesc& color = context.input("color");
        context.require_same_window("deep", "color");
        m_alpha = require_deep_alpha(deep);
        m_depth = deep.channel("Z");
        std::vector<std::string> names = deep.channels;
        m_pairs.clear();
        for (const int from : deep_colour(color)) {
            const std::string& name = color.channels[static_cast<std::size_t>(from)];
            int to = deep.channel(name);
            if (to < 0) {
                to = static_cast<int>(names.size());
                names.push_back(name);
            }
            m_pairs.push_back({from, to});
        }
        if (m_pairs.empty()) throw NodeError("input 'color' has no colour channel");
        // Ids and the like may lie beside a colour that is new; a colour left as it was is a
        // mistake.
        const bool has_rgb =
            deep.channel("R") >= 0 || deep.channel("G") >= 0 || deep.channel("B") >= 0;
        if (has_rgb && std::ranges::none_of(
                           m_pairs, [&](const Pair& p) { return p.to < deep.channel_count(); }))
            throw NodeError("'deep' has a colour, but 'color' has none of its channels");
        m_had = deep.channel_count();
        m_added = names.size() - deep.channels.size();
        context.output("deep", deep.with_channels(std::move(names)));
    }

    DeepRow deep_row(const TileContext& context, int y) const override
    {
        context.check_cancelled();
        const DeepView deep = context.deep("deep");
        const ConstImageView color = context.input("color");
        const double max_gain = m.method == "spread" ? 0.0 : static_cast<double>(m.max_gain);
        const DeepRow& row = deep.row(y);
        DeepRow out = row;
        // New channels come before the remainders of ids.
        out.samples.insert(out.samples.begin() + m_had, m_added,
                           std::vector<float>(row.first.back()));
        DeepVisibility seen;
        std::size_t homeless = 0;
        for (int at = 0; at < deep.region.width(); ++at) {
            const int x = deep.region.x0 + at;
            const auto alpha = row.pixel(m_alpha, at);
            if (alpha.empty()) {
                homeless += std::ranges::any_of(
                    m_pairs, [&](const Pair& p) { return color.at(p.from, x, y) != 0.0f; });
                continue;
            }
            seen.look(alpha, m_depth < 0 ? std::span<const float>() : row.pixel(m_depth, at));
            const std::size_t first = row.first[static_cast<std::size_t>(at)];
            for (const Pair& pair : m_pairs) {
                const bool keeps = pair.to < m_had && max_gain > 0.0;
                float* to = out.samples[static_cast<std::size_t>(pair.to)].data() + first;
                recolor_samples(seen, alpha,
                                keeps ? row.pixel(pair.to, at) : std::span<const float>(),
                                color.at(pair.from, x, y), max_gain, {to, alpha.size()});
            }
        }
        context.count("pixels with colour that have no deep sample", homeless);
        return out;
    }

private:
    struct Pair {
        int from, to; ///< channel of the flat image, and of the deep one
    };
    Params m;
    std::vector<Pair> m_pairs;
    int m_alpha = -1, m_depth = -1;
    int m_had = 0;           ///< channels of the deep input
    std::size_t m_added = 0; ///< channels it lacks
};

} // namespace

RAYLOOM_NODE(DeepRecolor);

} // namespace rayloom
