// SPDX-License-Identifier: Apache-2.0
#include "nodes/multiscale/steerable_kernel.h"
#include "rayloom/core/registry.h"

namespace rayloom
{
namespace
{

/// multiscale.steerable_inverse: oriented bands into an image.
class SteerableInverse final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("multiscale.steerable_inverse")
            .summary("Puts an image together from the bands of multiscale.steerable.")
            .doc("Takes the list in the order multiscale.steerable gives it. Every band goes "
                 "through the adjoint of the filters it was made by; where bands were changed in "
                 "ways no image has, this is the nearest image.")
            .source("001_6a300dc64642895d.txt, section 4.2; MATH.md, section 3")
            .accuracy("Analysis and synthesis in a row: error ≤ 1e-6 of the image's range.")
            .example("rayloom: 1\n"
                     "name: steerable-inverse-example\n"
                     "doc: There and back.\n"
                     "inputs:\n"
                     "  image: {doc: any image}\n"
                     "nodes:\n"
                     "  bands: {op: multiscale.steerable, image: image, levels: 2}\n"
                     "  again: {op: multiscale.steerable_inverse, bands: bands}\n"
                     "outputs:\n"
                     "  image: again\n");
        d.input("bands", "bands in the order of multiscale.steerable").list();
        d.output("image", "the image");
    }
    explicit SteerableInverse(const Params&) {}

    void plan(PlanContext& context) override
    {
        const auto count = static_cast<int>(context.count("bands"));
        m_levels = (count - 2) / steerable_orientations;
        if (count != steerable_band_count(m_levels) || m_levels < 1 ||
            m_levels > steerable_max_levels)
            throw NodeError("bands has " + std::to_string(count) +
                            " elements; L levels make 4·L + 2 (high-pass, four bands a level, "
                            "low-pass), L from 1 to " +
                            std::to_string(steerable_max_levels));
        const ImageDesc& first = context.input("bands");
        const Region window = first.data;
        std::vector<std::string> names;
        for (const std::string& channel : first.channels) names.push_back(plain_channel(channel));
        for (int i = 0; i < count; ++i) {
            const ImageDesc& image = context.input("bands", static_cast<std::size_t>(i));
            const SteerableBand expected = steerable_band(i, m_levels);
            const SteerableBand band = band_of_channel(image.channels.front());
            if (band.name() != expected.name())
                throw NodeError("element " + std::to_string(i) + " of bands is " + band.name() +
                                "; " + expected.name() + " belongs there");
            if (image.channels.size() != names.size())
                throw NodeError(band.name() + " has " + std::to_string(image.channels.size()) +
                                " channels, the high-pass has " + std::to_string(names.size()));
            if (image.data != window.grown(steerable_halo(band)))
                throw NodeError(band.name() + " has the data window " + image.data.text() +
                                "; beside a high-pass of " + window.text() + " it has to be " +
                                window.grown(steerable_halo(band)).text());
        }
        context.output("image", first.with_channels(names));
        context.needs("bands", [levels = m_levels](const Need& need) {
            return need.region.grown(
                steerable_halo(steerable_band(static_cast<int>(need.input_element), levels)));
        });
        context.scratch(steerable_synthesis_scratch(m_levels, window));
    }

    void compute(const TileContext& context) const override
    {
        const ImageView out = context.output("image");
        std::vector<ConstImageView> bands(context.count("bands"));
        for (int c = 0; c < out.channels(); ++c) {
            context.check_cancelled();
            for (std::size_t i = 0; i < bands.size(); ++i)
                bands[i] = context.input("bands", i).channel_range(c, 1);
            steerable_synthesise(m_levels, bands, out.channel_range(c, 1));
        }
    }

private:
    int m_levels = 0;
};

RAYLOOM_NODE(SteerableInverse);

} // namespace
} // namespace rayloom
