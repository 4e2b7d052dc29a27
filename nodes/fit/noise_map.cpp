// SPDX-License-Identifier: Apache-2.0
#include "nodes/fit/band_figures.h"
#include "nodes/transform/spread_kernel.h"
#include "rayloom/core/registry.h"
#include "rayloom/image/mirrored.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace rayloom
{
namespace
{

/// √|v|; 0 for what is not finite, which then is no evidence.
inline float root_of(float v)
{
    const float size = std::fabs(v);
    return size <= std::numeric_limits<float>::max() ? std::sqrt(size) : 0.0f;
}

/// Σ√|v| over values that are finite and not exactly zero, and how many there are.
void add_roots(std::span<const float> values, std::span<double> sums)
{
    // Eight partial sums: see BandMoments::add().
    constexpr std::size_t lanes = 8;
    std::array<double, lanes> roots{};
    std::array<std::int32_t, lanes> zeros{};
    const auto add = [&](std::size_t k, float v) {
        const float root = root_of(v);
        roots[k] += static_cast<double>(root);
        zeros[k] += root == 0.0f;
    };
    const std::size_t n = values.size();
    std::size_t i = 0;
    for (; i + lanes <= n; i += lanes)
        for (std::size_t k = 0; k < lanes; ++k) add(k, values[i + k]);
    for (std::size_t k = 0; i < n; ++i, ++k) add(k, values[i]);
    sums[1] += static_cast<double>(n);
    for (std::size_t k = 0; k < lanes; ++k) {
        sums[0] += roots[k];
        sums[1] -= zeros[k];
    }
}

/// fit.noise_map: where noise is stronger and where weaker than elsewhere.
class FitNoiseMap final : public Node
{
public:
    struct Params {
        int scale = 4;
        float least = 0.25f;
        float greatest = 4.0f;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("fit.noise_map")
            .summary("How strong the noise is around each pixel, as a multiple of the image's.")
            .doc("The high-pass of a render's logarithm, or of half the difference of two halves, "
                 "is mostly noise. The map is (K u / K 1)², where u is the mean over channels of "
                 "√|h|, each over its own mean in the image, and K the smooth kernel of "
                 "transform.restore_mean over pixels that are finite and not exactly zero (a black "
                 "background is no evidence); it is kept between `least` and `greatest`. Roots, "
                 "as noise is everywhere and edges are not: a line of edges through the kernel "
                 "counts little. One map for all channels, so that no colour is cored more than "
                 "another.\n\n"
                 "With transform.scale_band bands are divided by the map before they are measured "
                 "and cored, and multiplied afterwards: noise is then as strong everywhere.")
            .source("MATH.md, section 3 (estimated noise)")
            .accuracy("Relative error 2e-6.")
            .example("rayloom: 1\n"
                     "name: fit-noise-map-example\n"
                     "doc: The noise of each band, taken to be as strong everywhere.\n"
                     "inputs:\n"
                     "  image: {doc: logarithm of a render}\n"
                     "nodes:\n"
                     "  bands: {op: multiscale.steerable, image: image}\n"
                     "  map: {op: fit.noise_map, band: 'bands[0]'}\n"
                     "  even: {op: transform.scale_band, band: bands, map: map}\n"
                     "  high: {op: fit.noise, band: 'even[0]'}\n"
                     "  noise: {op: fit.noise, band: even, high: high.figures}\n"
                     "outputs:\n"
                     "  map: map\n"
                     "  noise: noise.figures\n");
        d.input("band", "the high-pass of multiscale.steerable");
        d.output("map", "the noise's strength, one channel");
        d.param("scale", &Params::scale,
                "Width of the kernel, as a power of two: a deviation of 9.2 pixels at 4.")
            .range(1, 8)
            .source("docs/methods/bayesian-wavelet.md");
        d.param("least", &Params::least, "Least value of the map.")
            .range(0.001, 1.0)
            .source("docs/methods/bayesian-wavelet.md");
        d.param("greatest", &Params::greatest, "Greatest value of the map.")
            .range(1.0, 1000.0)
            .source("docs/methods/bayesian-wavelet.md");
    }
    explicit FitNoiseMap(const Params& p) : m_params(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& band = context.input("band");
        if (band_of_channel(band.channels.front()).kind != SteerableBand::Kind::high)
            throw NodeError("band must be the high-pass, the first of multiscale.steerable");
        m_window = band.data;
        m_share.assign(band.channels.size(), 0.0f);
        context.output("map", band.with_channels({"strength"}));
        const int reach = spread_reach(m_params.scale);
        context.needs("band", [window = m_window, reach](const Need& need) {
            return mirrored_region(need.region.grown(Halo::all(reach)), window);
        });
        context.reduce(m_window, m_share.size() * sums, 16);
        context.reduce_needs("band");
        context.scratch(4 * ImageBuffer::bytes_for(m_window.grown(Halo::all(reach)), 1));
    }

    void reduce(const TileContext& rows, std::span<double> totals) const override
    {
        const Region& r = rows.region();
        const ConstImageView band = rows.input("band");
        for (int y = r.y0; y < r.y1; ++y)
            for (std::size_t c = 0; c < m_share.size(); ++c)
                add_roots(
                    {band.ptr(static_cast<int>(c), r.x0, y), static_cast<std::size_t>(r.width())},
                    totals.subspan(c * sums, sums));
    }

    std::map<std::string, Table, std::less<>> finish(std::span<const double> totals,
                                                     std::span<const TileContext::Input>) override
    {
        // Every channel that has noise counts alike, whatever its strength.
        std::size_t noisy = 0;
        for (std::size_t c = 0; c < m_share.size(); ++c) noisy += totals[c * sums] > 0.0 ? 1 : 0;
        for (std::size_t c = 0; c < m_share.size(); ++c) {
            const double roots = totals[c * sums], count = totals[c * sums + 1];
            m_share[c] = roots > 0.0
                             ? static_cast<float>(count / (roots * static_cast<double>(noisy)))
                             : 0.0f;
        }
        return {};
    }

    void compute(const TileContext& context) const override
    {
        const Region& r = context.region();
        const ImageView out = context.output("map");
        const Region wide = r.grown(Halo::all(spread_reach(m_params.scale)));
        const ConstImageView band = context.input("band");
        const auto n = static_cast<std::size_t>(wide.width());
        ImageBuffer sizes(wide, 1), counts(wide, 1), between, other;
        std::vector<float> row(n);
        int zeros = 0;
        for (int y = wide.y0; y < wide.y1; ++y) {
            float* const size = sizes.view().row(0, y);
            float* const count = counts.view().row(0, y);
            std::fill_n(size, n, 0.0f);
            for (std::size_t c = 0; c < m_share.size(); ++c) {
                load_mirrored_row(band.channel_range(static_cast<int>(c), 1), m_window, y, wide,
                                  row.data());
                for (std::size_t i = 0; i < n; ++i) size[i] += m_share[c] * root_of(row[i]);
            }
            for (std::size_t i = 0; i < n; ++i) {
                count[i] = size[i] > 0.0f ? 1.0f : 0.0f;
                zeros += size[i] > 0.0f ? 0 : 1;
            }
        }
        spread(m_params.scale, r, sizes, between, other);
        // K of ones is 1 to the last bit.
        if (zeros > 0) spread(m_params.scale, r, counts, between, other);
        const ConstImageView size = sizes.view(), count = counts.view();
        for (int y = r.y0; y < r.y1; ++y) {
            float* const to = out.row(0, y);
            const float* const k = size.ptr(0, r.x0, y);
            const float* const ones = count.ptr(0, r.x0, y);
            for (int i = 0; i < r.width(); ++i) {
                const float seen = std::max(ones[i], 1e-6f);
                const float ratio = k[i] / seen;
                to[i] = std::clamp(ratio * ratio, m_params.least, m_params.greatest);
            }
        }
    }

private:
    static constexpr std::size_t sums = 2;

    Params m_params;
    Region m_window;
    std::vector<float> m_share; ///< what √|h| of each channel is multiplied by
};

RAYLOOM_NODE(FitNoiseMap);

} // namespace
} // namespace rayloom
