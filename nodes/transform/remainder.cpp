// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <vector>

namespace rayloom
{
namespace
{

/// transform.remainder: the beauty less its partial images.
class Remainder final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.remainder")
            .summary("What of the beauty is in none of its partial images.")
            .doc("Beauty − Σ partial images, in double, rounded once: emission, surroundings, "
                 "volumes, lobes without a pivot, and whatever the passes miss. Added to the "
                 "partial images by fuse.sum it gives the beauty again, to rounding, whether or "
                 "not the passes are complete: no energy is lost. Alpha is the beauty's. Values "
                 "more than a hundredth of the beauty below zero (passes that hold more than it) "
                 "are counted in the report. Not finite values of the partial images are taken as "
                 "0, those of the beauty are kept.")
            .source("003_fb3ee135f07a6099.txt, section 8")
            .accuracy("Rounded once to float.")
            .example("rayloom: 1\n"
                     "name: remainder-example\n"
                     "doc: What is not direct light.\n"
                     "inputs:\n"
                     "  beauty: {doc: linear radiance, channels: RGB}\n"
                     "  direct: {doc: direct light, channels: RGB}\n"
                     "nodes:\n"
                     "  rest: {op: transform.remainder, image: beauty, parts: direct}\n"
                     "outputs:\n"
                     "  image: rest\n");
        d.input("image", "the beauty");
        d.input("parts", "partial images, colour channels as the beauty").list().optional();
        d.output("image", "the remainder");
    }

    explicit Remainder(const Params&) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_channels.assign(1, image.colour());
        for (std::size_t i = 0; i < context.count("parts"); ++i)
            m_channels.push_back(matching_colours(context, "image", "parts", ColourCount::same, i));
        context.output("image", image);
        if (m_channels.size() == 1) context.pass_through("image", "image");
        m_passed.plan(context, "image", m_channels[0]);
    }

    void compute(const TileContext& context) const override
    {
        const Region& r = context.region();
        const ConstImageView image = context.input("image");
        const ImageView out = context.output("image");
        std::vector<double> sum(static_cast<std::size_t>(r.width()));
        std::size_t below = 0;
        for (int y = r.y0; y < r.y1; ++y) {
            for (std::size_t c = 0; c < m_channels[0].size(); ++c) {
                std::fill(sum.begin(), sum.end(), 0.0);
                for (std::size_t i = 1; i < m_channels.size(); ++i) {
                    const float* from =
                        context.input("parts", i - 1).ptr(m_channels[i][c], r.x0, y);
                    for (std::size_t x = 0; x < sum.size(); ++x)
                        if (from[x] - from[x] == 0.0f) sum[x] += static_cast<double>(from[x]);
                }
                const float* beauty = image.ptr(m_channels[0][c], r.x0, y);
                float* to = out.row(m_channels[0][c], y);
                for (std::size_t x = 0; x < sum.size(); ++x) {
                    to[x] = static_cast<float>(static_cast<double>(beauty[x]) - sum[x]);
                    below += to[x] < -0.01f * beauty[x] - 1e-4f ? 1 : 0;
                }
            }
        }
        m_passed.copy(image, out);
        if (below > 0) context.count("values whose passes hold more than the beauty", below);
    }

private:
    std::vector<std::vector<int>> m_channels; ///< beauty, then parts
    PassedChannels m_passed;
};
RAYLOOM_NODE(Remainder);

} // namespace
} // namespace rayloom
