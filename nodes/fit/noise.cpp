// SPDX-License-Identifier: Apache-2.0
#include "nodes/fit/band_figures.h"
#include "rayloom/core/registry.h"

#include <bit>
#include <cmath>
#include <cstdint>
#include <numeric>

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
    enum class Source { given, halves, high_pass, none };
    // |high-pass| is counted by exponent and the first five bits of the mantissa.
    static constexpr int bin_bits = 5;
    static constexpr std::size_t bins = std::size_t{256} << bin_bits;

    /// The share of |high-pass| whose bound, beside the median, tells the shape.
    static constexpr double upper_share = 0.95;
    static double quantile(std::span<const double> counts, double q);

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
             "as the paper does. `auto` measures. With the same band of two half renders "
             "connected (a, b), (a − b)/2 is pure noise, of the strength that the mean of both "
             "has; its second and fourth moments give s and p, band by band. Without halves the "
             "noise is taken to be independent from pixel to pixel (a box pixel filter) and to "
             "make up most of the high-pass: the median of |high-pass| and the bound on 95 % of "
             "it give scale and shape there, and the gain of the filters the scale in the band. "
             "Coefficients that are exactly zero (a black background) are not counted. That "
             "overestimates noise in images with fine texture everywhere.\n\n"
             "The low-pass has no noise figures: it is not cored.")
        .source("001_6a300dc64642895d.txt, section 3; auto: MATH.md, section 3")
        .accuracy("s and p within 2 % from 10⁶ independent values.")
        .example("rayloom: 1\n"
                 "name: fit-noise-example\n"
                 "doc: Noise of each band, from the high-pass.\n"
                 "inputs:\n"
                 "  image: {doc: logarithm of a render}\n"
                 "nodes:\n"
                 "  bands: {op: multiscale.steerable, image: image}\n"
                 "  noise: {op: fit.noise, band: bands, high: 'bands[0]'}\n"
                 "outputs:\n"
                 "  noise: noise.figures\n");
    d.input("band", "the band whose noise is asked for");
    d.input("a", "the same band of one half of the samples").optional();
    d.input("b", "the same band of the other half").optional();
    d.input("high", "the high-pass of the same image").optional();
    d.output("figures", "a row a channel: band, channel, s_n, p_n, deviation, source").table();
    d.param("noise", &Params::noise, "Hand on s and p, or measure.").choices({"auto", "given"});
    d.param("s", &Params::s, "Scale of the noise in the bands (twice that in the high-pass).")
        .range(0.0, 100.0)
        .source("001_6a300dc64642895d.txt, section 5: 0.19 and 0.6");
    d.param("p", &Params::p, "Shape of the noise, when it is not measured.")
        .range(least_shape, greatest_shape)
        .source("001_6a300dc64642895d.txt, section 5");
}

void FitNoise::plan(PlanContext& context)
{
    const ImageDesc& band = context.input("band");
    m_band = band_of_channel(band.channels.front());
    m_channels = band.channels;
    const bool halves = context.has("a") && context.has("b");
    if (context.has("a") != context.has("b"))
        throw NodeError("connect both halves (a and b) or none");
    for (const char* port : {"a", "b"}) {
        if (!halves) continue;
        context.require_same_window("band", port);
        if (context.input(port).channel_count() != band.channel_count())
            throw NodeError(std::string(port) + " has " +
                            std::to_string(context.input(port).channel_count()) +
                            " channels, band has " + std::to_string(band.channel_count()));
    }
    if (m_band.kind == SteerableBand::Kind::low) {
        m_source = Source::none;
    } else if (m_params.noise == "given") {
        m_source = Source::given;
    } else if (halves) {
        m_source = Source::halves;
        context.reduce(over_image(m_band, band.data), m_channels.size() * BandMoments::size, 16);
        context.reduce_needs("a");
        context.reduce_needs("b");
    } else if (context.has("high")) {
        m_source = Source::high_pass;
        const ImageDesc& high = context.input("high");
        if (band_of_channel(high.channels.front()).kind != SteerableBand::Kind::high)
            throw NodeError("high is not the high-pass; connect element 0 of the bands");
        if (high.channel_count() != band.channel_count())
            throw NodeError("high has " + std::to_string(high.channel_count()) +
                            " channels, band has " + std::to_string(band.channel_count()));
        context.reduce(high.data, m_channels.size() * bins, 64);
        context.reduce_needs("high");
    } else {
        throw NodeError("nothing to measure the noise by: connect two halves (a, b) or the "
                        "high-pass (high), or set noise: given");
    }
}

void FitNoise::reduce(const TileContext& rows, std::span<double> sums) const
{
    const Region& r = rows.region();
    const auto n = static_cast<std::size_t>(r.width());
    for (std::size_t c = 0; c < m_channels.size(); ++c) {
        const int channel = static_cast<int>(c);
        if (m_source == Source::halves) {
            const ConstImageView a = rows.input("a"), b = rows.input("b");
            for (int y = r.y0; y < r.y1; ++y)
                BandMoments::add_difference({a.ptr(channel, r.x0, y), n},
                                            {b.ptr(channel, r.x0, y), n}, 0.5f,
                                            sums.subspan(c * BandMoments::size, BandMoments::size));
            continue;
        }
        const ConstImageView high = rows.input("high");
        std::vector<std::uint32_t> counts(bins, 0);
        for (int y = r.y0; y < r.y1; ++y)
            for (std::size_t i = 0; i < n; ++i)
                ++counts[std::bit_cast<std::uint32_t>(std::fabs(high.ptr(channel, r.x0, y)[i])) >>
                         (23 - bin_bits)];
        for (std::size_t b = 0; b < bins; ++b) sums[c * bins + b] += counts[b];
    }
}

void FitNoise::combine(std::span<double> into, std::span<const double> other) const
{
    if (m_source == Source::halves) return BandMoments::combine(into, other);
    for (std::size_t i = 0; i < into.size(); ++i) into[i] += other[i];
}

/// The value a share q of the counted values lie below, by straight interpolation within its bin.
/// Bin i holds the floats whose leading bits are i; bin 0 (zero) is left out.
double FitNoise::quantile(std::span<const double> counts, double q)
{
    counts = counts.subspan(1);
    const double wanted = q * std::reduce(counts.begin(), counts.end());
    double below = 0.0;
    for (std::size_t b = 0; b < counts.size(); ++b) {
        if (counts[b] > 0.0 && below + counts[b] >= wanted) {
            const auto edge = [](std::size_t bin) {
                return static_cast<double>(
                    std::bit_cast<float>(static_cast<std::uint32_t>(bin) << (23 - bin_bits)));
            };
            return edge(b + 1) + (edge(b + 2) - edge(b + 1)) * (wanted - below) / counts[b];
        }
        below += counts[b];
    }
    return 0.0;
}

std::map<std::string, Table, std::less<>> FitNoise::finish(std::span<const double> totals,
                                                           std::span<const TileContext::Input>)
{
    Table figures;
    figures.columns = {"band", "channel", "s_n", "p_n", "deviation", "source"};
    for (std::size_t c = 0; c < m_channels.size(); ++c) {
        GeneralisedLaplacian noise{0.0, m_params.p};
        std::string source;
        switch (m_source) {
        case Source::none: source = "low-pass: not cored"; break;
        case Source::given:
            noise.s = m_band.kind == SteerableBand::Kind::high ? 2.0 * m_params.s : m_params.s;
            source = "given";
            break;
        case Source::halves: {
            const BandMoments moments(totals.subspan(c * BandMoments::size, BandMoments::size));
            const SignalFit fit = fit_signal(moments.second, moments.fourth, {0.0, 2.0});
            noise = fit.density;
            source = "halves, " + (fit.status == SignalStatus::no_signal ? "no difference"
                                                                         : to_string(fit.status));
            break;
        }
        case Source::high_pass: {
            const auto counts = totals.subspan(c * bins, bins);
            const double median = quantile(counts, 0.5);
            if (median > 0.0) {
                noise = fit_quantiles(median, quantile(counts, upper_share), upper_share);
                noise.s *= m_band.white_noise_gain() / SteerableBand{}.white_noise_gain();
            }
            source = "high-pass";
            break;
        }
        }
        figures.rows.push_back({m_band.name(), plain_channel(m_channels[c]), noise.s, noise.p,
                                std::sqrt(noise.variance()), source});
    }
    return {{"figures", figures}};
}

RAYLOOM_NODE(FitNoise);

} // namespace
} // namespace rayloom
