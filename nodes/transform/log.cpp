// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/log_kernel.h"
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <array>
#include <bit>
#include <cstdint>
#include <limits>
#include <numeric>

namespace rayloom
{
namespace
{

/// transform.log: multiplicative noise becomes additive.
class Log final : public Node
{
public:
    struct Params {
        double epsilon = 1e-4;
        bool opponent = false;
    };

    static void describe(Declaration<Params>& d);
    explicit Log(const Params& p) : m_params(p) {}

    void plan(PlanContext& context) override;
    void reduce(const TileContext& rows, std::span<double> sums) const override;
    std::map<std::string, Table, std::less<>>
    finish(std::span<const double> totals, std::span<const TileContext::Input> tables) override;
    void compute(const TileContext& context) const override;

private:
    // Positive values are counted by exponent and the first five bits of the mantissa.
    static constexpr int bin_bits = 5;
    static constexpr std::size_t bins = std::size_t{256} << bin_bits;
    enum Sum : std::size_t { zeros, negatives, first_bin };

    Params m_params;
    std::vector<int> m_channels;
    bool m_given = false;
    float m_epsilon = 1.0f;
    /// What is left of the last octave is not to overflow the logarithm's argument.
    static constexpr float greatest = std::numeric_limits<float>::max() / 2;
};

void Log::describe(Declaration<Params>& d)
{
    d.name("transform.log")
        .summary("Natural logarithm of radiance, moved off zero by a share of its median.")
        .doc("y = ln(max(x, 0) + ε), where ε is `epsilon` times the median of the positive colour "
             "values (of all channels together, to 3 %), so that scaling the image shifts its "
             "logarithm and nothing more. An image without a positive value gets ε = 1. Negative "
             "values are taken as zero and counted. With figures connected ε is read from there: "
             "that is how the two halves of a stack get the ε of their mean.\n\n"
             "With `opponent`, three channels become L = (r + g + b)/3, C1 = (r − b)/√6 and C2 = "
             "(r − 2g + b)/(3√2) of the logarithms: an orthogonal change of axes (scaled by 1/√3) "
             "that keeps what is common to the colours apart from what is not. transform.exp "
             "undoes both. Alpha and other channels are dropped.")
        .source("001_6a300dc64642895d.txt, equations (4) and (5)")
        .accuracy("Absolute error of the logarithm 1e-7 (1 + |y|) before the change of axes.")
        .example("rayloom: 1\n"
                 "name: log-example\n"
                 "doc: Brightens the shadows of a render by halving its logarithm's ε.\n"
                 "inputs:\n"
                 "  image: {doc: linear radiance}\n"
                 "nodes:\n"
                 "  log: {op: transform.log, image: image}\n"
                 "  back: {op: transform.exp, image: log.log, figures: log.figures}\n"
                 "outputs:\n"
                 "  image: back\n");
    d.input("image", "linear radiance");
    d.input("figures", "take ε from another transform.log").table().optional();
    d.output("log", "logarithm of each colour channel, or L, C1 and C2");
    d.output("figures", "epsilon, opponent, and counts of positive, zero and negative values")
        .table()
        .optional();
    d.param("epsilon", &Params::epsilon,
            "Added before the logarithm, as a share of the median positive value.")
        .range(1e-7, 100.0)
        .source("MATH.md, section 3");
    d.param("opponent", &Params::opponent, "Change to log-opponent axes (three channels only).");
}

void Log::plan(PlanContext& context)
{
    const ImageDesc& image = context.input("image");
    m_channels = require_colours(context, "image");
    std::vector<std::string> names = channel_names(image, m_channels);
    if (m_params.opponent) {
        if (names.size() != 3)
            throw NodeError("opponent axes need three colour channels; the image has " +
                            std::to_string(names.size()) + " (set opponent: false)");
        names = {"L", "C1", "C2"};
    }
    context.output("log", image.with_channels(names));
    m_given = context.has("figures");
    if (!m_given) {
        context.reduce(image.data, first_bin + bins, 64);
        context.reduce_needs("image");
    }
}

void Log::reduce(const TileContext& rows, std::span<double> sums) const
{
    const ConstImageView image = rows.input("image");
    const Region& r = rows.region();
    std::vector<std::uint32_t> counts(bins, 0);
    for (int y = r.y0; y < r.y1; ++y)
        for (const int c : m_channels) {
            const float* const row = image.ptr(c, r.x0, y);
            std::uint32_t zero = 0, negative = 0;
            for (int i = 0; i < r.width(); ++i) {
                const auto bits = std::bit_cast<std::uint32_t>(row[i]);
                const bool positive = bits - 1 < 0x7fffffffu;
                zero += (bits << 1) == 0;
                negative += !positive && (bits << 1) != 0;
                counts[positive ? bits >> (23 - bin_bits) : 0] += positive;
            }
            sums[zeros] += zero;
            sums[negatives] += negative;
        }
    for (std::size_t b = 0; b < bins; ++b) sums[first_bin + b] = counts[b];
    if (sums[negatives] > 0.0)
        rows.count("negative values taken as zero", static_cast<std::size_t>(sums[negatives]));
}

std::map<std::string, Table, std::less<>> Log::finish(std::span<const double> totals,
                                                      std::span<const TileContext::Input> tables)
{
    Table figures;
    if (m_given) {
        figures = *tables.front().table;
        m_epsilon = static_cast<float>(figures.number("epsilon"));
        if (!(m_epsilon > 0.0f))
            throw InputError("the figures connected to transform.log hold no positive epsilon");
        figures = {};
        figures.set("epsilon", static_cast<double>(m_epsilon));
        figures.set("opponent", m_params.opponent ? 1.0 : 0.0);
        return {{"figures", figures}};
    }
    const std::span<const double> counts = totals.subspan(first_bin);
    const double positive = std::reduce(counts.begin(), counts.end());
    double median = 0.0, below = 0.0;
    for (std::size_t b = 0; b < bins && positive > 0.0; ++b) {
        below += counts[b];
        if (2.0 * below < positive) continue;
        // The middle of the bin.
        const auto bits =
            (static_cast<std::uint32_t>(b) << (23 - bin_bits)) + (1u << (22 - bin_bits));
        median = std::bit_cast<float>(bits);
        break;
    }
    // An ε below the least normal number would be lost beside a zero.
    m_epsilon =
        positive > 0.0
            ? std::max(static_cast<float>(std::min(m_params.epsilon * median, 1e30)), 1e-30f)
            : 1.0f;
    figures.set("epsilon", static_cast<double>(m_epsilon));
    figures.set("opponent", m_params.opponent ? 1.0 : 0.0);
    figures.set("median", median);
    figures.set("positive", positive);
    figures.set("zero", totals[zeros]);
    figures.set("negative", totals[negatives]);
    return {{"figures", figures}};
}

void Log::compute(const TileContext& context) const
{
    const ConstImageView image = context.input("image");
    const ImageView out = context.output("log");
    const Region& r = context.region();
    const float epsilon = m_epsilon;
    for (int y = r.y0; y < r.y1; ++y) {
        for (int c = 0; c < out.channels(); ++c) {
            const float* const in = image.ptr(m_channels[static_cast<std::size_t>(c)], r.x0, y);
            float* const to = out.row(c, y);
            for (int i = 0; i < r.width(); ++i) {
                float x = in[i] > 0.0f ? in[i] : 0.0f;
                x = x < greatest ? x : greatest;
                to[i] = log_of(x + epsilon);
            }
        }
        if (!m_params.opponent) continue;
        float *const l = out.row(0, y), *const c1 = out.row(1, y), *const c2 = out.row(2, y);
        for (int i = 0; i < r.width(); ++i) {
            const float red = l[i], green = c1[i], blue = c2[i];
            l[i] = ((red + blue) + green) * (1.0f / 3.0f);
            c1[i] = (red - blue) * 0.408248290f;
            c2[i] = ((red + blue) - 2.0f * green) * 0.235702260f;
        }
    }
}

RAYLOOM_NODE(Log);

} // namespace
} // namespace rayloom
