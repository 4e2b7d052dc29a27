// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/planes_guides.h"
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <string>

namespace rayloom
{

namespace
{

/// Every pixel from all planes that cover it.
class FusePlanes final : public Node
{
public:
    struct Params {
        int max_radius = 15;
        std::string blend = "max";
        int stride = PlaneSettings().stride;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("fuse.planes")
            .version(5)
            .summary("Averages, at each pixel, the planes of all squares that cover it.")
            .doc(
                "ζ(p) = Σ w·z̄ / Σ w over the centres q whose square covers p. z̄ blends the plane "
                "Z of the square with that of the quadrant p lies in, (Z + w_m·Z_m) / (1 + w_m); "
                "on an axis both quadrants count half, at the centre all four a quarter. w is "
                "min(Z/Z_m, Z_m/Z)⁸ (0 unless both are positive) times the guides: n·n′ to the "
                "fourth power, 0 beyond 60°; 1/100 for centres on a boundary; the share of objects "
                "both pixels see; and the root of the centre's `pivot`. A pixel nobody else "
                "covers gets its own plane: so do those that fit.plane left to their neighbours "
                "(radius 0), whose plane counts 1/1000. The "
                "result is not negative; alpha and other channels of `image` pass through.")
            .source("003_fb3ee135f07a6099.txt, section 4.4, equations 11 to 13")
            .accuracy("Float against the double oracle: 2e-4 of the value.")
            .example("rayloom: 1\n"
                     "name: planes-example\n"
                     "doc: Filters light with local planes.\n"
                     "inputs:\n"
                     "  light: {doc: light without texture, channels: RGB}\n"
                     "  variance: {doc: its variance, channels: RGB}\n"
                     "  normal: {doc: surface normal, channels: \"X,Y,Z\"}\n"
                     "nodes:\n"
                     "  planes: {op: fit.plane, image: light, variance: variance, normal: normal, "
                     "max_radius: 5}\n"
                     "  filtered: {op: fuse.planes, image: light, coefficients: planes, normal: "
                     "normal, max_radius: 5}\n"
                     "outputs:\n"
                     "  image: filtered\n");
        d.input("image", "z that was fitted; gives names, and the channels that pass through");
        d.input("coefficients", "planes of fit.plane");
        PlaneGuidePorts::declare(d);
        d.output("image", "filtered z");
        d.param("max_radius", &Params::max_radius, "as in fit.plane: squares reach no farther")
            .range(1, max_plane_radius)
            .unit("px");
        d.param("blend", &Params::blend,
                "how w_m of equation 11 reads (12): 'max' (as printed) trusts a quadrant more the "
                "more it "
                "differs, 'min' less; measured in docs/methods/pivot.md")
            .choices({"min", "max"})
            .source("003_fb3ee135f07a6099.txt, equation 12");
        d.param("stride", &Params::stride, "as in fit.plane: another gives the same, later")
            .range(1, max_plane_stride)
            .unit("px");
    }

    explicit FusePlanes(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_image = image.colour();
        m_colours = static_cast<int>(m_image.size());
        context.require_same_window("image", "coefficients");
        const ImageDesc& coefficients = context.input("coefficients");
        if ((m_colours != 1 && m_colours != 3) ||
            coefficients.channel_count() != plane_coefficients(m_colours))
            throw NodeError("input 'coefficients' has " +
                            std::to_string(coefficients.channel_count()) +
                            " channels; fit.plane gives " +
                            std::to_string(plane_coefficients(m_colours)) + " for this image");
        m_settings.max_radius = m.max_radius;
        m_settings.stride = m.stride;
        m_settings.blend = m.blend == "max" ? PlaneBlend::max : PlaneBlend::min;
        m_data = image.data;
        context.needs("coefficients", Halo::all(m.max_radius));
        m_guides.plan(context, m.max_radius);
        context.output("image", image);
        m_passed.plan(context, "image", m_image);
        context.scratch(fuse_planes_scratch(m_settings, m_colours, m_guides.part_channels()));
    }

    void compute(const TileContext& context) const override
    {
        const Region& region = context.region();
        const ImageView out = context.output("image");
        ImageBuffer filtered(region, m_colours);
        fuse_planes(m_settings, m_data, context.input("coefficients"), m_guides.views(context),
                    filtered.view(), [&] { context.check_cancelled(); });
        for (int y = region.y0; y < region.y1; ++y)
            for (int c = 0; c < m_colours; ++c)
                std::copy_n(filtered.view().row(c, y), region.width(),
                            out.row(m_image[static_cast<std::size_t>(c)], y));
        m_passed.copy(context.input("image"), out);
    }

private:
    Params m;
    PlaneSettings m_settings;
    PlaneGuidePorts m_guides;
    Region m_data;
    std::vector<int> m_image;
    PassedChannels m_passed;
    int m_colours = 0;
};

RAYLOOM_NODE(FusePlanes);

} // namespace
} // namespace rayloom
