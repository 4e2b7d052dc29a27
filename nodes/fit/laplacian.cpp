// SPDX-License-Identifier: Apache-2.0
#include "nodes/fit/band_figures.h"
#include "rayloom/core/registry.h"

#include <cmath>

namespace rayloom
{
namespace
{

/// fit.laplacian: the distribution of a band's signal beneath its noise.
class FitLaplacian final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("fit.laplacian")
            .summary("Fits a generalised Laplacian to what a band holds beside its noise.")
            .doc("The band is y = c + n with independent n of known scale and shape. Second and "
                 "fourth moments of y over the image, less those of n, give scale s_c and shape "
                 "p_c of c. A band with no more variance than its noise has s_c = 0 (\"all "
                 "noise\"); shapes are kept in [0.3, 4], and the table says where one was held "
                 "there. Without noise figures the band itself is fitted. Coefficients that are "
                 "exactly "
                 "zero (a black background) or not finite are not counted.")
            .source("001_6a300dc64642895d.txt, equations (12), (16)-(18)")
            .version(3)
            .accuracy("s and p within 2 % from 10⁶ independent values.")
            .example("rayloom: 1\n"
                     "name: fit-laplacian-example\n"
                     "doc: Signal and noise of each band.\n"
                     "inputs:\n"
                     "  image: {doc: logarithm of a render}\n"
                     "nodes:\n"
                     "  bands: {op: multiscale.steerable, image: image}\n"
                     "  noise: {op: fit.noise, band: bands, noise: given}\n"
                     "  fit: {op: fit.laplacian, band: bands, noise: noise.figures}\n"
                     "outputs:\n"
                     "  fit: fit.figures\n");
        d.input("band", "a band of multiscale.steerable");
        d.input("noise", "figures of fit.noise for the band").table().optional();
        d.output("figures",
                 "a row a channel: band, channel, s_n, p_n, s_c, p_c, deviation, kurtosis, "
                 "greatest, fit")
            .table();
    }
    explicit FitLaplacian(const Params&) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& band = context.input("band");
        m_band = band_of_channel(band.channels.front());
        m_channels = band.channels;
        if (m_band.kind == SteerableBand::Kind::low) return;
        context.reduce(over_image(m_band, band.data), m_channels.size() * BandMoments::size, 16);
        context.reduce_needs("band");
    }

    void reduce(const TileContext& rows, std::span<double> sums) const override
    {
        const Region& r = rows.region();
        const ConstImageView band = rows.input("band");
        for (int y = r.y0; y < r.y1; ++y)
            for (std::size_t c = 0; c < m_channels.size(); ++c)
                BandMoments::add(
                    {band.ptr(static_cast<int>(c), r.x0, y), static_cast<std::size_t>(r.width())},
                    sums.subspan(c * BandMoments::size, BandMoments::size));
    }
    void combine(std::span<double> into, std::span<const double> other) const override
    {
        BandMoments::combine(into, other);
    }

    std::map<std::string, Table, std::less<>>
    finish(std::span<const double> totals, std::span<const TileContext::Input> tables) override
    {
        Table figures;
        figures.columns = {"band", "channel",   "s_n",      "p_n",      "s_c",
                           "p_c",  "deviation", "kurtosis", "greatest", "fit"};
        for (std::size_t c = 0; c < m_channels.size(); ++c) {
            const std::string channel = plain_channel(m_channels[c]);
            if (m_band.kind == SteerableBand::Kind::low) {
                figures.rows.push_back(
                    {m_band.name(), channel, 0.0, 2.0, 0.0, 2.0, 0.0, 0.0, 0.0, "not cored"});
                continue;
            }
            const BandMoments moments(totals.subspan(c * BandMoments::size, BandMoments::size));
            const GeneralisedLaplacian noise = tables.empty() ? GeneralisedLaplacian{0.0, 2.0}
                                                              : noise_of(*tables.front().table, c);
            const SignalFit fit = fit_signal(moments.second, moments.fourth, noise,
                                             noise.s > 0.0 ? moments.sampling_error() : 0.0);
            figures.rows.push_back({m_band.name(), channel, noise.s, noise.p, fit.density.s,
                                    fit.density.p, std::sqrt(moments.second), moments.kurtosis(),
                                    moments.greatest, to_string(fit.status)});
        }
        return {{"figures", figures}};
    }

    void compute(const TileContext&) const override {}

private:
    SteerableBand m_band;
    std::vector<std::string> m_channels;
};

RAYLOOM_NODE(FitLaplacian);

} // namespace
} // namespace rayloom
