// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/planes_guides.h"
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <string>

namespace rayloom
{

namespace
{

/// Planes through the surroundings of each pixel.
class FitPlane final : public Node
{
public:
    struct Params {
        int min_radius = 2;
        int max_radius = 15;
        float growth = 0.5f;
        float range = 1.0f;
        std::string range_scale = "noise";
        float target_noise = 0.02f;
        float max_noise = 8.0f;
        float variation = 0.3f;
        float confidence = 2.0f;
        int stride = PlaneSettings().stride;
        int dense = PlaneSettings().dense;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("fit.plane")
            .version(4)
            .summary("Fits planes to the square around each pixel and to its four quadrants, as "
                     "large as the noise asks for.")
            .doc(
                "Around each pixel a square grows by a share of its size (`growth`) until the "
                "standard error of the fitted value is below `target_noise` of it, or the square "
                "has its largest size, or the light is uneven: the plane of the square and that "
                "of a quadrant differ at the centre by more than `variation` of the value and "
                "`confidence` standard errors of the quadrant (then the last even size is "
                "taken). Planes are weighted least squares with weights exp(−k|z − ⟨z⟩|/scale − σ "
                "− r²/R²) times the guides: n·n′ to the fourth power, 0 beyond 60°, and the share "
                "of objects both pixels see. σ is the relative standard error of z, over 5×5 "
                "pixels. The equation prints r²/R, which is no pure number; R² is. With `pivot` a "
                "pixel also counts by the root of its brightest colour there (at most 1): the "
                "darker the surface, the noisier what is divided by it.\n\n"
                "Large squares overlap, so that few of them are needed: beyond a half-size of "
                "`dense` only centres whose x and y are multiples of `stride` grow on. A centre in "
                "between that would is left to them, and its radius is 0, if one of the nearest of "
                "them gives its neighbours at least half of what it would (by the guides, and a "
                "hundredth of itself on a boundary); if none does it grows on as well. The lattice "
                "begins at pixel 0: of a mirrored image other centres grow.\n\n"
                "All colours share the weights, which come from their mean. Marked "
                "pixels, those that are not finite, and those with more than `max_noise` "
                "are left out; where fewer than three well-spread pixels are left the plane is "
                "level, at their weighted mean. A quadrant includes the axes and the centre.\n\n"
                "The coefficient image holds: radius, relative noise, then for the square and the "
                "quadrants right-lower, left-lower, right-upper, left-upper (y downwards), for "
                "each colour, a, b and c of a·dx + b·dy + c, measured from the centre. fuse.planes "
                "reads it.")
            .source("003_fb3ee135f07a6099.txt, sections 4.2 and 4.3, equation 10")
            .accuracy("Float against the double oracle: 2e-4 of the value; radii equal but where "
                      "a criterion is met within 1e-5.")
            .example("rayloom: 1\n"
                     "name: plane-example\n"
                     "doc: Radius that the noise of an image asks for.\n"
                     "inputs:\n"
                     "  light: {doc: light without texture, channels: RGB}\n"
                     "  variance: {doc: its variance, channels: RGB}\n"
                     "  normal: {doc: surface normal, channels: \"X,Y,Z\"}\n"
                     "nodes:\n"
                     "  planes: {op: fit.plane, image: light, variance: variance, normal: normal, "
                     "max_radius: 6}\n"
                     "outputs:\n"
                     "  coefficients: planes\n");
        d.input("image", "z, light divided by its pivot: 1 or 3 colour channels");
        d.input("variance", "variance of z: as many colour channels, or one");
        PlaneGuidePorts::declare(d);
        d.input("marked", "marks of transform.demodulate").optional();
        d.output("coefficients", "radius, relative noise and planes");
        d.param("min_radius", &Params::min_radius, "half-size of the smallest square")
            .range(1, max_plane_radius)
            .unit("px")
            .source("003_fb3ee135f07a6099.txt, section 4.3: 5×5 pixels");
        d.param("max_radius", &Params::max_radius, "half-size of the largest square")
            .range(1, max_plane_radius)
            .unit("px");
        d.param("growth", &Params::growth,
                "share of its half-size by which a square grows, at least one pixel; 0 tries every "
                "size, as printed")
            .range(0, 4)
            .source("003_fb3ee135f07a6099.txt, section 4.3: by one pixel");
        d.param("range", &Params::range, "k, weight of the difference from the mean")
            .min(0)
            .source("003_fb3ee135f07a6099.txt, equation 10");
        d.param("range_scale", &Params::range_scale,
                "what a difference is measured against: the mean, or the mean plus the standard "
                "deviation of the noise")
            .choices({"mean", "noise"});
        d.param("target_noise", &Params::target_noise,
                "relative standard error at which a square is large enough")
            .min(0);
        d.param("max_noise", &Params::max_noise,
                "pixels with a larger relative standard error are left out")
            .min(0);
        d.param("variation", &Params::variation,
                "relative difference of square and quadrant that is still even light")
            .min(0);
        d.param("confidence", &Params::confidence,
                "standard errors of the quadrant that are put down to noise")
            .min(0);
        d.param("stride", &Params::stride,
                "of the centres that grow beyond `dense`, in x and y; 1: all do")
            .range(1, max_plane_stride)
            .unit("px");
        d.param("dense", &Params::dense, "half-size up to which every centre grows")
            .range(max_plane_stride - 1, max_plane_radius)
            .unit("px");
    }

    explicit FitPlane(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        if (m.min_radius > m.max_radius)
            throw NodeError("min_radius (" + std::to_string(m.min_radius) +
                            ") is larger than max_radius (" + std::to_string(m.max_radius) + ")");
        const ImageDesc& image = context.input("image");
        const std::vector<int> colours = image.colour();
        if (colours.size() != 1 && colours.size() != 3)
            throw NodeError("input 'image' has " + std::to_string(colours.size()) +
                            " colour channels; 1 and 3 are possible");
        m_colours = static_cast<int>(colours.size());
        m_image = first_of_run(colours, "image");
        context.require_same_window("image", "variance");
        const std::vector<int> variance = context.input("variance").colour();
        if (variance.size() != 1 && variance.size() != colours.size())
            throw NodeError("input 'variance' has " + std::to_string(variance.size()) +
                            " colour channels; it needs " + std::to_string(colours.size()) +
                            " as 'image', or one");
        m_variance = first_of_run(variance, "variance");
        m_variances = static_cast<int>(variance.size());
        if (context.has("marked")) {
            m_marked = first_of_run(matching_colours(context, "image", "marked"), "marked");
        }
        m_settings.min_radius = m.min_radius;
        m_settings.max_radius = m.max_radius;
        m_settings.growth = m.growth;
        m_settings.range = m.range;
        m_settings.range_scale = m.range_scale == "mean" ? PlaneRange::mean : PlaneRange::noise;
        m_settings.target_noise = m.target_noise;
        m_settings.max_noise = m.max_noise;
        m_settings.variation = m.variation;
        m_settings.confidence = m.confidence;
        m_settings.stride = m.stride;
        m_settings.dense = m.dense;
        m_data = image.data;
        const int reach = plane_fit_reach(m_settings);
        for (const char* port : {"image", "variance", "marked"})
            if (context.has(port)) context.needs(port, Halo::all(reach));
        m_guides.plan(context, reach);

        std::vector<std::string> names{"radius", "noise"};
        for (const char* square : {"", "1", "2", "3", "4"})
            for (const int c : colours)
                for (const char* k : {"a", "b", "c"})
                    names.push_back(image.channels[static_cast<std::size_t>(c)] + "." + k + square);
        context.output("coefficients", image.with_channels(names));
        context.scratch(fit_planes_scratch(m_settings, m_colours, m_guides.part_channels()));
    }

    void compute(const TileContext& context) const override
    {
        PlaneGuides guides = m_guides.views(context);
        guides.image = context.input("image").channel_range(m_image, m_colours);
        guides.variance = context.input("variance").channel_range(m_variance, m_variances);
        if (context.has("marked"))
            guides.marked = context.input("marked").channel_range(m_marked, m_colours);
        fit_planes(m_settings, m_data, guides, context.output("coefficients"),
                   [&] { context.check_cancelled(); });
    }

private:
    Params m;
    PlaneSettings m_settings;
    PlaneGuidePorts m_guides;
    Region m_data;
    int m_image = 0, m_colours = 0, m_variance = 0, m_variances = 0, m_marked = 0;
};

RAYLOOM_NODE(FitPlane);

} // namespace
} // namespace rayloom
