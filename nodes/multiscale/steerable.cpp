// SPDX-License-Identifier: Apache-2.0
#include "nodes/multiscale/steerable_kernel.h"
#include "rayloom/core/registry.h"
#include "rayloom/image/mirrored.h"

namespace rayloom
{
namespace
{

/// multiscale.steerable: an image into oriented bands.
class Steerable final : public Node
{
public:
    struct Params {
        int levels = 3;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("multiscale.steerable")
            .summary("Takes an image apart into a high-pass, four orientations a level, and a "
                     "low-pass.")
            .doc("The list holds the high-pass, bands 1 to 4 of level 1 (the finest), of level 2 "
                 "and so on, and the low-pass: 4·levels + 2 images, none decimated. Band 1 of a "
                 "level answers to changes along x, 2 along the falling diagonal, 3 along y, 4 "
                 "along the rising diagonal. Channels are called `level1.band2.R`. Bands are a "
                 "little larger than the image (by 2^level pixels), which beyond its edges is "
                 "mirrored.\n\n"
                 "The filters are local (two to four pixels at a time, repeated at distances 1, "
                 "2, 4, …), so bands are computed tile by tile. They form a frame whose adjoint "
                 "is its inverse: multiscale.steerable_inverse gives back the image. "
                 "docs/methods/bayesian-wavelet.md says how it differs from the frequency-domain "
                 "steerable pyramid. Independent noise of deviation σ in the pixels has deviation "
                 "0.8 σ in the high-pass, 0.354 σ in bands 1 and 3 and 0.25 σ in bands 2 and 4 of "
                 "every level.")
            .source("001_6a300dc64642895d.txt, section 4.2; MATH.md, section 3")
            .accuracy("Analysis and synthesis in a row: error ≤ 1e-6 of the image's range.")
            .example("rayloom: 1\n"
                     "name: steerable-example\n"
                     "doc: Oriented bands of an image, and the image again.\n"
                     "inputs:\n"
                     "  image: {doc: any image}\n"
                     "nodes:\n"
                     "  bands: {op: multiscale.steerable, image: image, levels: 3}\n"
                     "  image-again: {op: multiscale.steerable_inverse, bands: bands}\n"
                     "outputs:\n"
                     "  image: image-again\n");
        d.input("image", "any image");
        d.output("bands", "high-pass, oriented bands from fine to coarse, low-pass").list();
        d.param("levels", &Params::levels, "Levels with four orientations each.")
            .range(1, steerable_max_levels);
    }
    explicit Steerable(const Params& p) : m_levels(p.levels) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_window = image.data;
        std::vector<ImageDesc> bands;
        for (int i = 0; i < steerable_band_count(m_levels); ++i) {
            const SteerableBand band = steerable_band(i, m_levels);
            std::vector<std::string> names;
            for (const std::string& channel : image.channels)
                names.push_back(band.name() + "." + channel);
            ImageDesc desc = image.with_channels(names);
            desc.data = m_window.grown(steerable_halo(band));
            bands.push_back(std::move(desc));
        }
        context.output_list("bands", std::move(bands));
        context.needs("image", [window = m_window, levels = m_levels](const Need& need) {
            const int band = static_cast<int>(need.output_element);
            return mirrored_region(steerable_need(steerable_band(band, levels), need.region),
                                   window);
        });
        context.scratch(steerable_analysis_scratch(
            steerable_band(steerable_band_count(m_levels) - 1, m_levels), m_window));
    }

    void compute(const TileContext& context) const override
    {
        const SteerableBand band = steerable_band(static_cast<int>(context.element()), m_levels);
        const ConstImageView image = context.input("image");
        const ImageView out = context.output("bands");
        for (int c = 0; c < out.channels(); ++c) {
            context.check_cancelled();
            steerable_analyse(band, m_window, image.channel_range(c, 1), out.channel_range(c, 1));
        }
    }

private:
    int m_levels;
    Region m_window;
};

RAYLOOM_NODE(Steerable);

} // namespace
} // namespace rayloom
