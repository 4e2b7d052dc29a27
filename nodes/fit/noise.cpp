// SPDX-License-Identifier: Apache-2.0
#include "nodes/fit/band_figures.h"
#include "rayloom/core/registry.h"
#include "rayloom/image/mirrored.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace rayloom
{
namespace
{

/// Deviation of noise, at the most, as a multiple of the median size of its values: 1.5 for normal
/// noise, 2 for Laplacian, up to 3.3 in the high-pass of renders.
constexpr double most_medians = 6.0;
/// Halves are measured in blocks of rows, of which so many pixels are enough: their moments vary by
/// about 1 % from one choice to the next.
constexpr int block_rows = 64;
constexpr std::size_t sample_pixels = std::size_t{1} << 18;

/// fit.noise: how large and how peaked the noise of a band is.
class FitNoise final : public Node
{
public:
    struct Params {
        std::string noise = "auto";
        double s = 0.19;
        double p = 1.5;
        double margin = 1.0;
        double excess = 1.0;
        double growth = 0.12;
        double least_shape = 2.0;
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
    /// What is made of measured moments, the deviation being `greatest` at the most.
    GeneralisedLaplacian of_moments(const BandMoments& moments, double greatest) const;
    /// Sums a channel: BandMoments, then SizeCounts where the high-pass is measured.
    std::size_t stride() const
    {
        return BandMoments::size + (m_source == Source::high_pass ? SizeCounts::size : 0);
    }

    Params m_params;
    Source m_source = Source::given;
    SteerableBand m_band;
    Region m_window; ///< of the image that was taken apart
    int m_every = 1; ///< of the blocks of rows that halves are measured in, one in so many
    std::vector<std::string> m_channels;
};

void FitNoise::describe(Declaration<Params>& d)
{
    d.name("fit.noise")
        .summary("Scale and shape of the noise in a band: given, from two halves, or from the "
                 "high-pass.")
        .doc("`given` hands on the parameters: s and p in every band, 2s and p in the high-pass, "
             "as the paper does. `auto` measures. Half the difference of two half renders is pure "
             "noise, of the strength that the mean of both has: connect it (difference), and its "
             "band is taken (of images above half a million pixels, of every second strip of 64 "
             "rows or fewer). Without one the noise is taken to be independent from pixel "
             "to pixel (a box pixel filter) and to make up the high-pass; the other bands are "
             "given the high-pass's figures (high) and scale them by the gain of their filters "
             "and by √(1 + `growth` · 4^level), level 0 being the high-pass: the noise of a "
             "logarithm has a mean that varies "
             "with its strength, so it is not white, and what varies slowly has a power that "
             "quadruples with the distance of a filter's taps. Noise is everywhere, edges are "
             "not: the deviation "
             "is six times the median size at the most (renders have 1.6 to 3.3), so an image "
             "without noise, whose high-pass is next to nothing but at its edges, keeps "
             "them.\n\n"
             "Second and fourth moments give deviation and shape. The deviation is multiplied by "
             "`margin` · (1 + `excess` · σ²), σ² being the variance that independent noise in the "
             "pixels would have: strong noise has specks that one deviation does not tell of, and "
             "too much of it does less harm than too little. The shape is not let below "
             "`least_shape`: the long tails (p of 0.4 to 1.3 on renders) are those of a strength "
             "that varies, not of the noise at any one place. Where it varies much, divide bands "
             "and difference by a map of it first (fit.noise_map). Coefficients that are exactly "
             "zero (a black background) or not finite are not counted.\n\n"
             "The low-pass has no noise figures: it is not cored. `kurtosis` is as measured.")
        .source("001_6a300dc64642895d.txt, section 3; auto: MATH.md, section 3")
        .version(5)
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
    d.input("difference",
            "noise alone: half the difference of two halves, of which the band is taken")
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
    d.param("excess", &Params::excess, "What of the variance is added to 1 as a further factor.")
        .range(0.0, 100.0)
        .source("docs/methods/bayesian-wavelet.md");
    d.param("growth", &Params::growth,
            "Variance that is added to 1, times 4^level, where the high-pass stands for other "
            "bands.")
        .range(0.0, 10.0)
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
    m_window = over_image(m_band, band.data);
    const bool halves = context.has("difference");
    if (halves) {
        const ImageDesc& difference = context.input("difference");
        if (difference.data != m_window)
            throw NodeError("difference (" + difference.data.text() +
                            ") must cover the pixels the band is of (" + m_window.text() + ")");
        if (difference.channel_count() != band.channel_count())
            throw NodeError("difference has " + std::to_string(difference.channel_count()) +
                            " channels, band has " + std::to_string(band.channel_count()));
    }
    if (m_band.kind == SteerableBand::Kind::low) {
        m_source = Source::none;
    } else if (m_params.noise == "given") {
        m_source = Source::given;
    } else if (halves) {
        m_source = Source::halves;
        // Blocks of rows that share the halo of the filters: no band of noise is ever kept. A large
        // image needs not all of them.
        const int blocks = m_window.height() / block_rows;
        const auto enough = static_cast<int>(m_window.pixels() / sample_pixels);
        m_every = std::max(1, std::min(enough, blocks / 4));
        context.reduce(m_window, m_channels.size() * stride(), block_rows);
        context.reduce_needs("difference", [band = m_band, window = m_window](const Need& need) {
            return mirrored_region(steerable_need(band, need.region), window);
        });
        // For one thread each.
        context.scratch(
            2 * steerable_analysis_scratch(m_band, {m_window.x0, 0, m_window.x1, block_rows}));
    } else if (context.has("high")) {
        m_source = Source::high_figures;
    } else if (m_band.kind == SteerableBand::Kind::high) {
        m_source = Source::high_pass;
        context.reduce(band.data, m_channels.size() * stride(), 16);
        context.reduce_needs("band");
    } else {
        throw NodeError("nothing to measure the noise by: connect half the difference of two "
                        "halves (difference) or the figures of the high-pass (high), or set "
                        "noise: given");
    }
}

void FitNoise::reduce(const TileContext& rows, std::span<double> sums) const
{
    const Region& r = rows.region();
    if (m_source == Source::halves && (r.y0 - m_window.y0) / block_rows % m_every != 0) return;
    ImageBuffer taken;
    for (std::size_t c = 0; c < m_channels.size(); ++c) {
        const int channel = static_cast<int>(c);
        ConstImageView band;
        if (m_source == Source::halves) {
            taken.reshape(r, 1);
            steerable_analyse(m_band, m_window, rows.input("difference").channel_range(channel, 1),
                              taken.view());
            band = taken.view();
        } else {
            band = rows.input("band").channel_range(channel, 1);
        }
        const std::span<double> own = sums.subspan(c * stride(), stride());
        for (int y = r.y0; y < r.y1; ++y) {
            const std::span<const float> row(band.ptr(0, r.x0, y),
                                             static_cast<std::size_t>(r.width()));
            BandMoments::add(row, own.first(BandMoments::size));
            if (m_source == Source::high_pass) SizeCounts::add(row, own.subspan(BandMoments::size));
        }
    }
}

void FitNoise::combine(std::span<double> into, std::span<const double> other) const
{
    for (std::size_t at = 0; at < into.size(); at += stride()) {
        BandMoments::combine(into.subspan(at, BandMoments::size),
                             other.subspan(at, BandMoments::size));
        for (std::size_t i = at + BandMoments::size; i < at + stride(); ++i) into[i] += other[i];
    }
}

GeneralisedLaplacian FitNoise::of_moments(const BandMoments& moments, double greatest) const
{
    GeneralisedLaplacian noise = fit_signal(moments.second, moments.fourth, {0.0, 2.0}).density;
    if (noise.s <= 0.0) return {0.0, m_params.p};
    // The same deviation with a shape that is not too sharp, and the margin.
    const double deviation = std::min(std::sqrt(noise.variance()), greatest);
    noise = {1.0, std::max(noise.p, m_params.least_shape)};
    const double in_pixels = deviation / m_band.white_noise_gain();
    noise.s = m_params.margin * (1.0 + m_params.excess * in_pixels * in_pixels) * deviation /
              std::sqrt(noise.variance());
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
            const auto own = totals.subspan(c * stride(), stride());
            const BandMoments moments(own.first(BandMoments::size));
            noise = of_moments(moments, m_source == Source::high_pass
                                            ? most_medians *
                                                  SizeCounts::median(own.subspan(BandMoments::size))
                                            : std::numeric_limits<double>::infinity());
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
                       std::sqrt(1.0 + m_params.growth * std::exp2(2 * m_band.level));
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
