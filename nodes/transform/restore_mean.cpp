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
                "In mode 'balance' pixels hand out only what they lost, n − f, in shares that are "
                "f over its own local mean: out = f + f / K f · K((n − f) / K u), u = f / K f, "
                "and not below 0. An image that lost nothing stays as it is, and a peak beside "
                "pixels that "
                "lost much takes less of theirs. The sum is kept but for what was below 0. With "
                "`figures` f and n are both raised by ε meanwhile: the logarithm averaged x + ε, "
                "so that is what lost energy, and black pixels take part.\n\n"
                "In mode 'scale' the filtered image is multiplied by the ratio of both local "
                "means: out = f · K n / K f. Steps are as f has them, whatever lies beside them; "
                "the sum of the image is the reference's nearly, not exactly.\n\n"
                "With `weight` w the sum of w·out is that of w·n: for light that will be "
                "multiplied by a surface's colour, so that the radiance is kept and not the light "
                "(w·f and w·n take the places of f and n, and the result is divided by w). "
                "In mode 'balance' the reference stays where w is 0.\n\n"
                "K is the cubic B-spline kernel [1 4 6 4 1]/16 repeated at distances 1, 2, 4, … "
                "(`scale` times), the image mirrored beyond its edges; its deviation is "
                "√((4^scale − 1)/3) pixels: 4.6 at scale 3, 9.2 at 4. Colours are treated "
                "alike and apart, other channels pass through. Negative values of f count as "
                "zero.")
            .version(2)
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
        d.input("figures", "figures of the transform.log the image went through (mode balance)")
            .table()
            .optional();
        d.input("weight", "what each pixel counts: as many colour channels, or one").optional();
        d.output("image", "the filtered image with the reference's energy");
        d.param("scale", &Params::scale, "Width of the kernel, as a power of two; 0: no change.")
            .range(0, 8);
        d.param("mode", &Params::mode,
                "share: hand out the reference's energy in proportion to f; balance: hand out what "
                "is lost, in proportion to f over its local mean; scale: multiply f by the ratio "
                "of the means")
            .choices({"share", "balance", "scale"});
    }
    explicit RestoreMean(const Params& p)
        : m_scale(p.scale), m_restore(p.mode == "share"     ? restore_energy
                                      : p.mode == "balance" ? balance_energy
                                                            : restore_local_mean),
          m_reach(spread_reach(p.scale) * (p.mode == "share"     ? 2
                                           : p.mode == "balance" ? 3
                                                                 : 1))
    {
    }

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_window = image.data;
        m_channels = image.colour();
        m_reference_channels = matching_colours(context, "image", "reference");
        if (context.has("weight"))
            m_weight_channels =
                matching_colours(context, "image", "weight", ColourCount::same_or_one);
        if (context.has("figures") && m_restore != balance_energy)
            throw NodeError("'figures' is only used in mode balance");
        context.output("image", image);
        if (m_scale == 0) {
            context.pass_through("image", "image");
            return;
        }
        m_passed.plan(context, "image", m_channels);
        for (const auto& [port, reach] :
             {std::pair{"image", m_reach}, std::pair{"reference", spread_reach(m_scale)},
              std::pair{"weight", m_reach}})
            if (context.has(port))
                context.needs(port, [window = m_window, halo = reach](const Need& need) {
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
            EnergyImages images{image.channel_range(m_channels[k], 1),
                                reference.channel_range(m_reference_channels[k], 1)};
            ConstImageView weight;
            if (context.has("weight")) {
                weight = context.input("weight").channel_range(m_weight_channels[k], 1);
                images.weight = &weight;
            }
            if (context.has("figures"))
                images.offset = static_cast<float>(context.table("figures").number("epsilon"));
            m_restore(m_scale, m_window, images, out.channel_range(m_channels[k], 1));
        }
        m_passed.copy(image, out);
    }

private:
    int m_scale;
    void (*m_restore)(int, const Region&, const EnergyImages&, ImageView);
    int m_reach; ///< of `image`
    Region m_window;
    std::vector<int> m_channels, m_reference_channels, m_weight_channels;
    PassedChannels m_passed;
};

RAYLOOM_NODE(RestoreMean);

} // namespace
} // namespace rayloom
