// SPDX-License-Identifier: Apache-2.0
#include "nodes/fit/band_figures.h"
#include "rayloom/core/registry.h"

#include <cmath>

namespace rayloom
{
namespace
{

/// measure.band_fit: how well the fitted distribution describes a band.
class BandFit final : public Node
{
public:
    struct Params {
        std::string distribution = "signal";
        int bins = 101;
        double reach = 3.0;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("measure.band_fit")
            .summary("Measures how far a band's histogram is from the generalised Laplacian fitted "
                     "to it.")
            .doc("The histogram has equal bins from −r to r, r being `reach` deviations of the "
                 "band; F is the share of the band's values in a bin and f the share the "
                 "distribution gives it, both divided by the bin's width. The fitting error is "
                 "the root of the mean of (F − f)²/f² over the bins. It weighs bins alike, so the "
                 "sparse tails count as much as the crowded middle; compare only figures of equal "
                 "`bins` and `reach`. With `signal` the figures s_c and p_c are held against the "
                 "band (fit.laplacian without noise: a clean image's band, or a map of noise), "
                 "with `noise` s_n and p_n. Values that are exactly zero (a black background) or "
                 "not "
                 "finite are not counted.")
            .source("001_6a300dc64642895d.txt, equation (3), Tables 1 and 2")
            .version(3)
            .accuracy("Counts are exact; probabilities within 1e-12.")
            .example("rayloom: 1\n"
                     "name: band-fit-example\n"
                     "doc: Table of s, p and fitting error for each band of a clean image.\n"
                     "inputs:\n"
                     "  image: {doc: logarithm of a render}\n"
                     "nodes:\n"
                     "  bands: {op: multiscale.steerable, image: image}\n"
                     "  fit: {op: fit.laplacian, band: bands}\n"
                     "  error: {op: measure.band_fit, band: bands, fit: fit.figures}\n"
                     "outputs:\n"
                     "  table: error.figures\n"
                     "  histogram: error.histogram\n");
        d.input("band", "a band of multiscale.steerable");
        d.input("fit", "figures of fit.laplacian for the band").table();
        d.output("figures", "a row a channel: band, channel, s, p, fitting_error").table();
        d.output("histogram", "a row a bin: band, channel, x, observed, fitted (densities)")
            .table()
            .optional();
        d.param("distribution", &Params::distribution, "Which of the fitted distributions.")
            .choices({"signal", "noise"});
        d.param("bins", &Params::bins, "Bins of the histogram.").range(3, 10001);
        d.param("reach", &Params::reach, "Half the histogram's width, in deviations of the band.")
            .range(0.1, 100.0);
    }
    explicit BandFit(const Params& p) : m_params(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& band = context.input("band");
        m_band = band_of_channel(band.channels.front());
        m_channels = band.channels;
        context.reduce(over_image(m_band, band.data), m_channels.size() * values(), 32);
        context.reduce_needs("band");
    }

    void reduce(const TileContext& rows, std::span<double> sums) const override
    {
        const Table& figures = rows.table("fit");
        const Region& r = rows.region();
        const ConstImageView band = rows.input("band");
        for (std::size_t c = 0; c < m_channels.size(); ++c) {
            const std::span<double> to = sums.subspan(c * values(), values());
            const double half = half_width(figures, c);
            if (half <= 0.0) continue;
            const double scale = 0.5 * m_params.bins / half;
            for (int y = r.y0; y < r.y1; ++y)
                for (const float v : std::span(band.ptr(static_cast<int>(c), r.x0, y),
                                               static_cast<std::size_t>(r.width()))) {
                    if (v == 0.0f || !std::isfinite(v)) continue;
                    const double at = (v + half) * scale;
                    if (at >= 0.0 && at < m_params.bins) to[static_cast<std::size_t>(at)] += 1.0;
                    to[values() - 1] += 1.0;
                }
        }
    }

    std::map<std::string, Table, std::less<>>
    finish(std::span<const double> totals, std::span<const TileContext::Input> tables) override
    {
        const Table& fit = *tables.front().table;
        Table figures, histogram;
        figures.columns = {"band", "channel", "s", "p", "fitting_error"};
        histogram.columns = {"band", "channel", "x", "observed", "fitted"};
        for (std::size_t c = 0; c < m_channels.size(); ++c) {
            const std::string channel = plain_channel(m_channels[c]);
            const GeneralisedLaplacian density =
                m_params.distribution == "signal" ? signal_of(fit, c) : noise_of(fit, c);
            const std::span<const double> counts = totals.subspan(c * values(), values());
            const double half = half_width(fit, c), all = counts.back();
            double sum = 0.0;
            if (half > 0.0 && density.s > 0.0 && all > 0.0)
                for (int b = 0; b < m_params.bins; ++b) {
                    const double width = 2.0 * half / m_params.bins;
                    const double lo = -half + b * width, hi = lo + width;
                    const double fitted = (below(density, hi) - below(density, lo)) / width;
                    const double observed = counts[static_cast<std::size_t>(b)] / all / width;
                    // An empty bin misses all of f, however little that is: far out, no float's
                    // worth.
                    sum += observed == 0.0
                               ? 1.0
                               : (observed - fitted) * (observed - fitted) / (fitted * fitted);
                    histogram.rows.push_back(
                        {m_band.name(), channel, 0.5 * (lo + hi), observed, fitted});
                }
            figures.rows.push_back(
                {m_band.name(), channel, density.s, density.p, std::sqrt(sum / m_params.bins)});
        }
        return {{"figures", figures}, {"histogram", histogram}};
    }

    void compute(const TileContext&) const override {}

private:
    /// Counts of the bins, and of all values.
    std::size_t values() const { return static_cast<std::size_t>(m_params.bins) + 1; }
    double half_width(const Table& figures, std::size_t channel) const
    {
        return m_params.reach * figures.number("deviation", channel);
    }
    /// P(X ≤ x), less ½.
    static double below(const GeneralisedLaplacian& density, double x)
    {
        return std::copysign(0.5 * density.probability_within(std::fabs(x)), x);
    }

    Params m_params;
    SteerableBand m_band;
    std::vector<std::string> m_channels;
};

RAYLOOM_NODE(BandFit);

} // namespace
} // namespace rayloom
