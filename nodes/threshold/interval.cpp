// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"
#include "rayloom/stats/quantiles.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace rayloom
{
namespace
{

/// Counts beyond this take its factor, which is 0.1 % above the normal quantile's at 99 %.
constexpr int table_size = 1024;
/// Half-size of the neighbourhood that stands in for the samples a pixel does not have.
constexpr int fallback_radius = 2;

/// threshold.interval: confidence interval of each pixel's mean.
class Interval final : public Node
{
public:
    struct Params {
        double confidence = 0.99;
        std::string variance_of = "sample";
        float samples = 0.0f;
        std::string too_few = "error";
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("threshold.interval")
            .summary("Student-t confidence interval of each pixel's mean.")
            .doc(
                "[x̄ − h, x̄ + h] with h = t·s/√n, t the two-sided Student quantile of `confidence` "
                "at n − 1 degrees of freedom, in each colour channel on its own. The variance is "
                "that of single samples (`variance_of: sample`) or already that of the mean. n is "
                "an image, or one number for all pixels; fractions are rounded down.\n\n"
                "One sample has no spread. `too_few: error` stops with the pixel and what to "
                "render "
                "instead. `too_few: neighbours` takes, for pixels with one sample, the variance of "
                "the means in the 5×5 neighbourhood as the variance of the mean, with the factor "
                "of "
                "that many samples; edges make such an interval wide. A pixel without any sample "
                "(empty deep pixel) has an interval of width 0 around its mean.")
            .source("000_092f36e585912bb0.txt, eq. (2), (3)")
            .accuracy("Factors in double, rounded to float; beyond n = 1024 the factor of 1024.")
            .example(
                "rayloom: 1\n"
                "name: interval-example\n"
                "inputs:\n"
                "  stack: {doc: renders that differ in their seed, kind: list, channels: RGB}\n"
                "nodes:\n"
                "  statistics: {op: transform.statistics, stack: stack}\n"
                "  interval: {op: threshold.interval, mean: statistics.mean,\n"
                "             variance: statistics.variance, count: statistics.count}\n"
                "outputs:\n"
                "  width: interval.half_width\n");
        d.input("mean", "mean of each pixel's samples");
        d.input("variance",
                "unbiased variance, one channel per colour of the mean; without it every "
                "pixel counts as having one sample")
            .optional();
        d.input("count", "number of samples; its first channel is read").optional();
        d.output("low", "lower end of the interval").optional();
        d.output("high", "upper end of the interval").optional();
        d.output("half_width", "t·s/√n").optional();
        d.output("variance", "variance of the mean, whatever the input was").optional();
        d.param("confidence", &Params::confidence,
                "1 − α, the share of intervals to hold the truth.")
            .range(1e-6, 1.0 - 1e-9)
            .source("section 3.5: 0.998, then 0.99");
        d.param("variance_of", &Params::variance_of, "What `variance` is the variance of.")
            .choices({"sample", "mean"});
        d.param("samples", &Params::samples,
                "Samples of every pixel when there is no input `count`; 0: there is.")
            .range(0, 1e9);
        d.param("too_few", &Params::too_few, "What to do about pixels with one sample.")
            .choices({"error", "neighbours"});
    }

    explicit Interval(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& mean = context.input("mean");
        m_window = mean.data;
        m_mean = require_colours(context, "mean");
        m_of_sample = m.variance_of == "sample";
        if (context.has("variance"))
            m_variance = matching_colours(context, "mean", "variance");
        else if (m.too_few == "error")
            throw NodeError("there is no variance; connect one, or a stack of renders to take it "
                            "from, or set too_few: neighbours");
        if (context.has("count")) {
            context.require_same_window("mean", "count");
        } else if (m.samples <= 0.0f) {
            throw NodeError("how many samples a pixel has is not known: connect `count` or set "
                            "`samples`");
        } else if (m.samples < 2.0f && m.too_few == "error") {
            throw NodeError(one_sample_has_no_interval);
        }
        m_factors = StudentTable(1.0 - m.confidence, table_size).as_floats();
        m_neighbour_factor = m_factors[static_cast<std::size_t>(
            (2 * fallback_radius + 1) * (2 * fallback_radius + 1) - 2)];
        for (const char* port : {"low", "high", "half_width", "variance"})
            context.output(port, mean.with_channels(channel_names(mean, m_mean)));
        if (m.too_few == "neighbours") context.needs("mean", Halo::all(fallback_radius));
    }

    void compute(const TileContext& context) const override
    {
        const Region& region = context.region();
        const auto width = static_cast<std::size_t>(region.width());
        const ConstImageView mean = context.input("mean");
        const ConstImageView variance =
            m_variance.empty() ? ConstImageView() : context.input("variance");
        const ConstImageView counts =
            context.has("count") ? context.input("count") : ConstImageView();
        const Outputs out(context);
        // Of each pixel of a row: Student's factor, and what makes its variance that of the mean; 0
        // where it has no samples of its own to go by.
        std::vector<float> factor(width), divisor(width);
        std::vector<int> lone;
        std::size_t replaced = 0;
        for (int y = region.y0; y < region.y1; ++y) {
            lone.clear();
            for (int x = region.x0; x < region.x1; ++x) {
                const float count = counts.empty() ? m.samples : counts.at(0, x, y);
                const int n = samples_of(count);
                if (n == 1 && m.too_few == "error")
                    throw InputError("pixel (" + std::to_string(x) + ", " + std::to_string(y) +
                                     "): " + one_sample_has_no_interval);
                if (n == 1) lone.push_back(x);
                const auto i = static_cast<std::size_t>(x - region.x0);
                factor[i] = n >= 2 ? m_factors[static_cast<std::size_t>(n - 2)] : 0.0f;
                divisor[i] = n < 2 ? 0.0f : m_of_sample ? count : 1.0f;
            }
            replaced += lone.size();
            for (std::size_t c = 0; c < m_mean.size(); ++c) {
                const auto channel = static_cast<int>(c);
                const float* const centre = mean.ptr(m_mean[c], region.x0, y);
                const float* const given =
                    variance.empty() ? centre : variance.ptr(m_variance[c], region.x0, y);
                for (std::size_t i = 0; i < width; ++i) {
                    const float of_mean =
                        divisor[i] > 0.0f ? std::max(0.0f, given[i]) / divisor[i] : 0.0f;
                    out.set(channel, region.x0 + static_cast<int>(i), y, centre[i],
                            factor[i] * std::sqrt(of_mean), of_mean);
                }
                for (const int x : lone) {
                    const float of_mean = neighbour_variance(mean, m_mean[c], x, y);
                    out.set(channel, x, y, mean.at(m_mean[c], x, y),
                            m_neighbour_factor * std::sqrt(of_mean), of_mean);
                }
            }
        }
        if (replaced > 0)
            context.count("pixels with one sample, width from their neighbours", replaced);
    }

private:
    static constexpr const char* one_sample_has_no_interval =
        "one sample has no confidence interval; render at least two samples a pixel (or the frame "
        "twice with different seeds), or set too_few: neighbours";

    /// Those that are wanted; the others are empty.
    struct Outputs {
        ImageView low, high, half_width, variance;

        explicit Outputs(const TileContext& context)
            : low(wanted(context, "low")), high(wanted(context, "high")),
              half_width(wanted(context, "half_width")), variance(wanted(context, "variance"))
        {
        }
        static ImageView wanted(const TileContext& context, const char* port)
        {
            return context.wants(port) ? context.output(port) : ImageView();
        }
        void set(int channel, int x, int y, float centre, float h, float of_mean) const
        {
            if (!low.empty()) low.at(channel, x, y) = centre - h;
            if (!high.empty()) high.at(channel, x, y) = centre + h;
            if (!half_width.empty()) half_width.at(channel, x, y) = h;
            if (!variance.empty()) variance.at(channel, x, y) = of_mean;
        }
    };

    /// What the table of factors has; a count that is negative or no number is none.
    int samples_of(float count) const
    {
        const int n =
            count > 0.0f ? static_cast<int>(std::min(count, static_cast<float>(table_size))) : 0;
        return m_variance.empty() ? std::min(n, 1) : n;
    }

    float neighbour_variance(const ConstImageView& mean, int channel, int x, int y) const
    {
        const Region around =
            Region{x, y, x + 1, y + 1}.grown(Halo::all(fallback_radius)).intersect(m_window);
        double average = 0.0, squares = 0.0;
        for (int v = around.y0; v < around.y1; ++v)
            for (int u = around.x0; u < around.x1; ++u)
                average += static_cast<double>(mean.at(channel, u, v));
        average /= static_cast<double>(around.pixels());
        for (int v = around.y0; v < around.y1; ++v)
            for (int u = around.x0; u < around.x1; ++u) {
                const double e = static_cast<double>(mean.at(channel, u, v)) - average;
                squares += e * e;
            }
        return static_cast<float>(squares /
                                  std::max(1.0, static_cast<double>(around.pixels()) - 1.0));
    }

    Params m;
    Region m_window;
    bool m_of_sample = true; ///< the input is the variance of samples, not of their mean
    std::vector<int> m_mean, m_variance;
    std::vector<float> m_factors; ///< of n = 2, 3, …
    float m_neighbour_factor = 0.0f;
};

RAYLOOM_NODE(Interval);

} // namespace
} // namespace rayloom
