// SPDX-License-Identifier: Apache-2.0
#include "nodes/fit/band_figures.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <cmath>

namespace rayloom
{
namespace
{

/// fit.noise: how large and how peaked the noise of a band is.
class FitNoise final : public Node
{
public:
    struct Params {
        std::string noise = "auto";
        double s = 0.19;
        double p = 1.5;
        double margin = 1.4;
        double growth = 1.2;
        double least_shape = 1.5;
    };

    static void describe(Declaration<Params>& d);
    explicit FitNoise(const Params& p) : m_params(p) {}

    void plan(PlanContext& context) override;
    void reduce(const TileContext& rows, std::span<double> sums) const override;
    void combine(std::span<double> into, std::span<const double> other) const override;
    std::map<std::string, Table, std::less<>> finish(std::span<const double> totals,
                                                     std::span<const TileContext::Input>) override;
    void compute(const TileContext&) const override {}

private:
    enum class Source { given, halves, high_pass, high_figures, none };
    /// What is made of measured moments.
    GeneralisedLaplacian of_moments(const BandMoments& moments) const;

    Params m_params;
    Source m_source = Source::given;
    SteerableBand m_band;
    std::vector<std::string> m_channels;
};

void FitNoise::describe(Declaration<Params>& d)
{
    d.name("fit.noise")
        .summary("Scale and shape of the noise in a band: given, from two halves, or from the "
                 "high-pass.")
        .doc("`given` hands on the parameters: s and p in every band, 2s and p in the high-pass, "
             "as the paper does. `auto` measures. Half the difference of two half renders is pure "
             "noise, of the strength that the mean of both has: connect the same band of it "
             "(noise_band). Without one the noise is taken to be independent from pixel "
             "to pixel (a box pixel filter) and to make up the high-pass; the other bands are "
             "given the high-pass's figures (high) and scale them by the gain of their filters, "
             "and by `growth` for each level: the noise of a logarithm has a mean that varies "
             "with its strength, so it is not white. An image without noise then loses its "
             "high-pass.\n\n"
             "Second and fourth moments give deviation and shape. The deviation is multiplied by "
             "`margin`: one figure stands for an image whose noise is stronger here than there, "
             "and too much of it does less harm than too little. The shape is not let below "
             "`least_shape`: the long tails (p of 0.4 to 1.3 on renders) are those of a strength "
             "that varies, not of the noise at any one place. Coefficients that are exactly zero "
             "(a black background) are not counted.\n\n"
             "The low-pass has no noise figures: it is not cored. `kurtosis` is as measured.")
        .source("001_6a300dc64642895d.txt, section 3; auto: MATH.md, section 3")
        .version(2)
        .accuracy("Deviation and kurtosis within 2 % from 10⁶ independent values.")
        .example("rayloom: 1\n"
                 "name: fit-noise-example\n"
                 "doc: Noise of each band, from the high-pass.\n"
                 "inputs:\n"
                 "  image: {doc: logarithm of a render}\n"
                 "nodes:\n"
                 "  bands: {op: multiscale.steerable, image: image}\n"
                 "  high: {op: fit.noise, band: 'bands[0]'}\n"
                 "  noise: {op: fit.noise, band: bands, high: high.figures}\n"
                 "outputs:\n"
                 "  noise: noise.figures\n");
    d.input("band", "the band whose noise is asked for");
    d.input("noise_band", "the same band of noise alone: half the difference of two halves")
        .optional();
    d.input("high", "figures of this node for the high-pass of the same image").table().optional();
    d.output("figures", "a row a channel: band, channel, s_n, p_n, deviation, kurtosis, source")
        .table();
    d.param("noise", &Params::noise, "Hand on s and p, or measure.").choices({"auto", "given"});
    d.param("s", &Params::s, "Scale of the noise in the bands (twice that in the high-pass).")
        .range(0.0, 100.0)
        .source("001_6a300dc64642895d.txt, section 5: 0.19 and 0.6");
    d.param("p", &Params::p, "Shape of the noise, when it is not measured.")
        .range(least_shape, greatest_shape)
        .source("001_6a300dc64642895d.txt, section 5");
    d.param("margin", &Params::margin, "Times the measured deviation.")
        .range(0.0, 100.0)
        .source("docs/methods/bayesian-wavelet.md");
    d.param("growth", &Params::growth,
            "Times the scale for each level, where the high-pass stands for other bands.")
        .range(0.1, 10.0)
        .source("docs/methods/bayesian-wavelet.md");
    d.param("least_shape", &Params::least_shape, "Least shape of measured noise.")
        .range(least_shape, greatest_shape)
        .source("docs/methods/bayesian-wavelet.md");
}

void FitNoise::plan(PlanContext& context)
{
    const ImageDesc& band = context.input("band");
    m_band = band_of_channel(band.channels.front());
    m_channels = band.channels;
    const bool halves = context.has("noise_band");
    if (halves) {
        context.require_same_window("band", "noise_band");
        const int channels = context.input("noise_band").channel_count();
        if (channels != band.channel_count())
            throw NodeError("noise_band has " + std::to_string(channels) + " channels, band has " +
                            std::to_string(band.channel_count()));
    }
    if (m_band.kind == SteerableBand::Kind::low) {
        m_source = Source::none;
    } else if (m_params.noise == "given") {
        m_source = Source::given;
    } else if (halves) {
        m_source = Source::halves;
        context.reduce(over_image(m_band, band.data), m_channels.size() * BandMoments::size, 16);
        context.reduce_needs("noise_band");
    } else if (context.has("high")) {
        m_source = Source::high_figures;
    } else if (m_band.kind == SteerableBand::Kind::high) {
        m_source = Source::high_pass;
        context.reduce(band.data, m_channels.size() * BandMoments::size, 16);
        context.reduce_needs("band");
    } else {
        throw NodeError("nothing to measure the noise by: connect half the difference of two "
                        "halves (noise_band) or the figures of the high-pass (high), or set "
                        "noise: given");
    }
}

void FitNoise::reduce(const TileContext& rows, std::span<double> sums) const
{
    const Region& r = rows.region();
    const ConstImageView band = rows.input(m_source == Source::halves ? "noise_band" : "band");
    for (std::size_t c = 0; c < m_channels.size(); ++c)
        for (int y = r.y0; y < r.y1; ++y)
            BandMoments::add(
                {band.ptr(static_cast<int>(c), r.x0, y), static_cast<std::size_t>(r.width())},
                sums.subspan(c * BandMoments::size, BandMoments::size));
}

void FitNoise::combine(std::span<double> into, std::span<const double> other) const
{
    BandMoments::combine(into, other);
}

GeneralisedLaplacian FitNoise::of_moments(const BandMoments& moments) const
{
    GeneralisedLaplacian noise = fit_signal(moments.second, moments.fourth, {0.0, 2.0}).density;
    if (noise.s <= 0.0) return {0.0, m_params.p};
    // The same deviation with a shape that is not too sharp, and the margin.
    const double deviation = std::sqrt(noise.variance());
    noise = {1.0, std::max(noise.p, m_params.least_shape)};
    noise.s = m_params.margin * deviation / std::sqrt(noise.variance());
    return noise;
}

std::map<std::string, Table, std::less<>>
FitNoise::finish(std::span<const double> totals, std::span<const TileContext::Input> tables)
{
    Table figures;
    figures.columns = {"band", "channel", "s_n", "p_n", "deviation", "kurtosis", "source"};
    for (std::size_t c = 0; c < m_channels.size(); ++c) {
        GeneralisedLaplacian noise{0.0, m_params.p};
        std::string source;
        double kurtosis = 0.0;
        switch (m_source) {
        case Source::none: source = "low-pass: not cored"; break;
        case Source::given:
            noise.s = m_band.kind == SteerableBand::Kind::high ? 2.0 * m_params.s : m_params.s;
            source = "given";
            break;
        case Source::halves:
        case Source::high_pass: {
            const BandMoments moments(totals.subspan(c * BandMoments::size, BandMoments::size));
            noise = of_moments(moments);
            kurtosis = moments.kurtosis();
            source = m_source == Source::halves ? "halves" : "high-pass";
            break;
        }
        case Source::high_figures: {
            const Table& high = *tables.front().table;
            if (high.rows.size() != m_channels.size())
                throw InputError("high has figures of " + std::to_string(high.rows.size()) +
                                 " channels, band has " + std::to_string(m_channels.size()));
            noise = noise_of(high, c);
            noise.s *= m_band.white_noise_gain() / SteerableBand{}.white_noise_gain() *
                       std::pow(m_params.growth, m_band.level);
            kurtosis = high.number("kurtosis", c);
            source = "high-pass";
            break;
        }
        }
        figures.rows.push_back({m_band.name(), plain_channel(m_channels[c]), noise.s, noise.p,
                                std::sqrt(noise.variance()), kurtosis, source});
    }
    return {{"figures", figures}};
}

RAYLOOM_NODE(FitNoise);

} // namespace
} // namespace rayloom
