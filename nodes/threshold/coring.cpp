// SPDX-License-Identifier: Apache-2.0
#include "nodes/fit/band_figures.h"
#include "rayloom/core/parallel.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <cmath>

namespace rayloom
{
namespace
{

/// threshold.coring: each coefficient of a band becomes its posterior mean.
class Coring final : public Node
{
public:
    struct Params {
        std::string channels = "all";
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("threshold.coring")
            .summary("Replaces each coefficient of a band by the mean of what it may have been "
                     "without noise.")
            .doc("Signal and noise are generalised Laplacians with the figures of fit.laplacian; "
                 "the posterior mean ĉ(y) is tabulated once for a band and channel and read off. "
                 "Small coefficients shrink towards zero, large ones keep what stands out of the "
                 "noise. A band without noise passes through unchanged, one that is all noise "
                 "becomes zero, the low-pass is left alone. ĉ is odd and |ĉ(y)| ≤ |y|; it rises "
                 "with y as long as the noise has p ≥ 1 (noise with longer tails than the signal "
                 "explains a far outlier better than the signal does, and ĉ falls again).")
            .source("001_6a300dc64642895d.txt, equations (7)-(11)")
            .version(2)
            .accuracy("|ĉ − exact| ≤ 1e-4 s_n + 1e-7 |y| for p in [0.3, 4].")
            .example("rayloom: 1\n"
                     "name: coring-example\n"
                     "doc: Cores every band of a logarithm with noise of known scale.\n"
                     "inputs:\n"
                     "  image: {doc: logarithm of a render}\n"
                     "nodes:\n"
                     "  bands: {op: multiscale.steerable, image: image}\n"
                     "  noise: {op: fit.noise, band: bands, noise: given, s: 0.19, p: 1.5}\n"
                     "  fit: {op: fit.laplacian, band: bands, noise: noise.figures}\n"
                     "  cored: {op: threshold.coring, band: bands, fit: fit.figures}\n"
                     "  clean: {op: multiscale.steerable_inverse, bands: cored}\n"
                     "outputs:\n"
                     "  image: clean\n");
        d.input("band", "a band of multiscale.steerable");
        d.input("fit", "figures of fit.laplacian for the band").table();
        d.output("band", "the band with its noise taken down");
        d.output("curve", "ĉ(y) of each channel: band, channel, y, c").table().optional();
        d.param("channels", &Params::channels,
                "Core every channel, or the first alone (the luminance of log-opponent axes).")
            .choices({"all", "first"});
    }
    explicit Coring(const Params& p) : m_params(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& band = context.input("band");
        m_band = band_of_channel(band.channels.front());
        m_channels = band.channels;
        m_cored = m_params.channels == "first" ? 1 : m_channels.size();
        context.output("band", band);
        if (m_band.kind == SteerableBand::Kind::low) {
            m_cored = 0;
            context.pass_through("band", "band");
        }
        for (std::size_t c = m_cored; c < m_channels.size() && m_cored > 0; ++c)
            context.pass_channel("band", static_cast<int>(c), "band", static_cast<int>(c));
    }

    std::map<std::string, Table, std::less<>>
    finish(std::span<const double>, std::span<const TileContext::Input> tables) override
    {
        const Table& figures = *tables.front().table;
        m_tables.assign(m_channels.size(), {});
        parallel_for<std::size_t>(0, m_cored, 1, [&](std::size_t c) {
            m_tables[c] = PosteriorMeanTable(signal_of(figures, c), noise_of(figures, c),
                                             figures.number("greatest", c));
        });
        Table curve;
        curve.columns = {"band", "channel", "y", "c"};
        constexpr int points = 32;
        for (std::size_t c = 0; c < m_cored; ++c)
            for (int i = 0; i <= points; ++i) {
                const double y = figures.number("greatest", c) * i / points;
                curve.rows.push_back({m_band.name(), plain_channel(m_channels[c]), y,
                                      static_cast<double>(m_tables[c](static_cast<float>(y)))});
            }
        return {{"curve", curve}};
    }

    void compute(const TileContext& context) const override
    {
        const ConstImageView in = context.input("band");
        const ImageView out = context.output("band");
        const Region& r = context.region();
        const auto n = static_cast<std::size_t>(r.width());
        for (int y = r.y0; y < r.y1; ++y)
            for (std::size_t c = 0; c < m_channels.size(); ++c) {
                const int channel = static_cast<int>(c);
                m_tables[c].apply({in.ptr(channel, r.x0, y), n}, {out.row(channel, y), n});
            }
    }

private:
    Params m_params;
    SteerableBand m_band;
    std::vector<std::string> m_channels;
    std::size_t m_cored = 0;
    std::vector<PosteriorMeanTable> m_tables;
};

RAYLOOM_NODE(Coring);

} // namespace
} // namespace rayloom
