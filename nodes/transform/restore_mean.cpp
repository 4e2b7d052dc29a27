// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/spread_kernel.h"
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"
#include "rayloom/image/mirrored.h"

#include <string>
#include <vector>

namespace rayloom
{
namespace
{

/// transform.restore_mean: gives a filtered image the local energy it had.
class RestoreMean final : public Node
{
public:
    struct Params {
        int scale = 3;
        std::string mode = "share";
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.restore_mean")
            .summary("Gives a filtered image back the local mean of the image it was made from.")
            .doc(
                "Every pixel of the reference hands its energy to its neighbours in proportion "
                "to what the filtered image f has there: out = f · K(n / K f), where n is the "
                "reference and K a smooth symmetric kernel. Nothing is lost or made: the "
                "sum of the image is the sum of the reference, to rounding, whatever f is. "
                "Where f is smooth over the kernel and off by a slowly varying factor, that factor "
                "(the loss of energy by averaging logarithms) cancels. Beside a much brighter "
                "step the dark side comes out too dark, as K f is not f there. Where f is black "
                "all over the kernel, the reference's energy stays where it is.\n\n"
                "In mode 'scale' the filtered image is multiplied by the ratio of both local "
                "means: out = f · K n / K f. Steps are as f has them, whatever lies beside them; "
                "the sum of the image is the reference's nearly, not exactly.\n\n"
                "K is the cubic B-spline kernel [1 4 6 4 1]/16 repeated at distances 1, 2, 4, … "
                "(`scale` times), the image mirrored beyond its edges; its deviation is "
                "√((4^scale − 1)/3) pixels: 4.6 at scale 3, 9.2 at 4. Colours are treated "
                "alike and apart, other channels pass through. Negative values of f count as "
                "zero.")
            .source("MATH.md, section 3 (energy after the logarithm)")
            .accuracy("Sum of the image kept to 1e-6, in single precision.")
            .example("rayloom: 1\n"
                     "name: restore-mean-example\n"
                     "doc: A logarithm smoothed and brought back without loss of energy.\n"
                     "inputs:\n"
                     "  image: {doc: linear radiance}\n"
                     "nodes:\n"
                     "  log: {op: transform.log, image: image}\n"
                     "  back: {op: transform.exp, image: log.log, figures: log.figures}\n"
                     "  energy: {op: transform.restore_mean, image: back, reference: image}\n"
                     "outputs:\n"
                     "  image: energy\n");
        d.input("image", "the filtered image");
        d.input("reference", "the image whose energy it is to have; same window and channels");
        d.output("image", "the filtered image with the reference's energy");
        d.param("scale", &Params::scale, "Width of the kernel, as a power of two; 0: no change.")
            .range(0, 8);
        d.param("mode", &Params::mode,
                "share: hand out the reference's energy in proportion to f; scale: multiply f by "
                "the ratio of the means")
            .choices({"share", "scale"});
    }
    explicit RestoreMean(const Params& p) : m_scale(p.scale), m_share(p.mode == "share") {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_window = image.data;
        m_channels = image.colour();
        m_reference_channels = matching_colours(context, "image", "reference");
        context.output("image", image);
        if (m_scale == 0) {
            context.pass_through("image", "image");
            return;
        }
        m_passed.plan(context, "image", m_channels);
        for (const auto& [port, times] :
             {std::pair{"image", m_share ? 2 : 1}, std::pair{"reference", 1}})
            context.needs(
                port, [window = m_window, halo = times * spread_reach(m_scale)](const Need& need) {
                    return mirrored_region(need.region.grown(Halo::all(halo)), window);
                });
        context.scratch(restore_energy_scratch(m_scale, m_window));
    }

    void compute(const TileContext& context) const override
    {
        const ConstImageView image = context.input("image"), reference = context.input("reference");
        const ImageView out = context.output("image");
        for (std::size_t k = 0; k < m_channels.size(); ++k) {
            context.check_cancelled();
            const auto restore = m_share ? restore_energy : restore_local_mean;
            restore(m_scale, m_window, image.channel_range(m_channels[k], 1),
                    reference.channel_range(m_reference_channels[k], 1),
                    out.channel_range(m_channels[k], 1));
        }
        m_passed.copy(image, out);
    }

private:
    int m_scale;
    bool m_share;
    Region m_window;
    std::vector<int> m_channels, m_reference_channels;
    PassedChannels m_passed;
};

RAYLOOM_NODE(RestoreMean);

} // namespace
} // namespace rayloom
