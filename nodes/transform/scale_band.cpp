// SPDX-License-Identifier: Apache-2.0
#include "nodes/fit/band_figures.h"
#include "rayloom/core/registry.h"
#include "rayloom/image/mirrored.h"

#include <string>
#include <vector>

namespace rayloom
{
namespace
{

/// transform.scale_band: a band over, or times, an image.
class ScaleBand final : public Node
{
public:
    struct Params {
        std::string mode = "divide";
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.scale_band")
            .summary("Divides a band by a map of the noise's strength, or multiplies it again.")
            .doc("The map has the size of the image and is mirrored beyond its edges, as the band "
                 "is. Without a map, and for the low-pass, the band is handed on.")
            .source("MATH.md, section 3 (estimated noise)")
            .example("rayloom: 1\n"
                     "name: scale-band-example\n"
                     "doc: Cores bands whose noise is stronger here than there.\n"
                     "inputs:\n"
                     "  image: {doc: logarithm of a render}\n"
                     "nodes:\n"
                     "  bands: {op: multiscale.steerable, image: image}\n"
                     "  map: {op: fit.noise_map, band: 'bands[0]'}\n"
                     "  even: {op: transform.scale_band, band: bands, map: map}\n"
                     "  noise: {op: fit.noise, band: even, noise: given, s: 0.19, p: 1.5}\n"
                     "  fit: {op: fit.laplacian, band: even, noise: noise.figures}\n"
                     "  cored: {op: threshold.coring, band: even, fit: fit.figures}\n"
                     "  back: {op: transform.scale_band, band: cored.band, map: map, "
                     "mode: multiply}\n"
                     "  clean: {op: multiscale.steerable_inverse, bands: back}\n"
                     "outputs:\n"
                     "  image: clean\n");
        d.input("band", "a band of multiscale.steerable");
        d.input("map", "positive, as large as the image; one channel").optional();
        d.output("band", "the scaled band");
        d.param("mode", &Params::mode, "What is done with the map.")
            .choices({"divide", "multiply"});
    }
    explicit ScaleBand(const Params& p) : m_divide(p.mode == "divide") {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& band = context.input("band");
        const SteerableBand kind = band_of_channel(band.channels.front());
        m_window = over_image(kind, band.data);
        context.output("band", band);
        if (context.has("map")) {
            const ImageDesc& map = context.input("map");
            if (map.data != m_window)
                throw NodeError("map (" + map.data.text() +
                                ") must cover the pixels the band is of (" + m_window.text() + ")");
            if (map.channel_count() != 1)
                throw NodeError("map has " + std::to_string(map.channel_count()) +
                                " channels; it must have one (fit.noise_map)");
            context.needs("map", [window = m_window](const Need& need) {
                return mirrored_region(need.region, window);
            });
        }
        m_handed_on = !context.has("map") || kind.kind == SteerableBand::Kind::low;
        if (m_handed_on) context.pass_through("band", "band");
    }

    void compute(const TileContext& context) const override
    {
        const ConstImageView band = context.input("band");
        const ImageView out = context.output("band");
        const Region& r = context.region();
        std::vector<float> mirrored(static_cast<std::size_t>(r.width()), 1.0f);
        for (int y = r.y0; y < r.y1; ++y) {
            if (!m_handed_on)
                load_mirrored_row(context.input("map"), m_window, y, r, mirrored.data());
            for (int c = 0; c < out.channels(); ++c) {
                const float* const in = band.ptr(c, r.x0, y);
                float* const to = out.row(c, y);
                if (m_divide)
                    for (std::size_t i = 0; i < mirrored.size(); ++i) to[i] = in[i] / mirrored[i];
                else
                    for (std::size_t i = 0; i < mirrored.size(); ++i) to[i] = in[i] * mirrored[i];
            }
        }
    }

private:
    bool m_divide;
    bool m_handed_on = false;
    Region m_window;
};

RAYLOOM_NODE(ScaleBand);

} // namespace
} // namespace rayloom
