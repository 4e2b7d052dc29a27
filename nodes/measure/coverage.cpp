// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <cmath>
#include <string>
#include <vector>

namespace rayloom
{
namespace
{

/// measure.coverage: how often intervals and bounds hold.
class Coverage final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("measure.coverage")
            .summary("Share of pixels whose true value lies inside the confidence interval.")
            .doc("Per colour channel: `interval_C`, the share of pixels with low ≤ reference ≤ "
                 "high, "
                 "and, with `image`, `bound_C`, the share with |image − reference| ≤ high − low "
                 "(theorem 3.1); `interval` and `bound` are the means over the channels. Pixels "
                 "whose interval has no width count like others. Pixels that are not finite are "
                 "left "
                 "out and counted.")
            .source("000_092f36e585912bb0.txt, table 1 and theorem 3.1")
            .accuracy("Counts are exact.")
            .example("rayloom: 1\n"
                     "name: coverage-example\n"
                     "inputs:\n"
                     "  mean: {doc: mean of the samples, channels: RGB}\n"
                     "  variance: {doc: their variance, channels: RGB}\n"
                     "  reference: {doc: the true image, channels: RGB}\n"
                     "nodes:\n"
                     "  interval: {op: threshold.interval, mean: mean, variance: variance,\n"
                     "             samples: 16}\n"
                     "  coverage: {op: measure.coverage, low: interval.low, high: interval.high,\n"
                     "             reference: reference}\n"
                     "outputs:\n"
                     "  figures: coverage.coverage\n");
        d.input("low", "lower end of the interval (threshold.interval)");
        d.input("high", "upper end");
        d.input("reference", "the true image");
        d.input("image", "a filtered image, to hold against the bound").optional();
        d.output("coverage", "one row of figures").table();
    }

    explicit Coverage(const Params&) {}

    void plan(PlanContext& context) override
    {
        m_names = channel_names(context.input("low"), require_colours(context, "low"));
        m_channels.clear();
        for (const char* port : {"low", "high", "reference", "image"}) {
            m_channels.emplace_back();
            if (!context.has(port)) continue;
            m_channels.back() = matching_colours(context, "low", port);
            context.reduce_needs(port);
        }
        m_has_image = context.has("image");
        context.reduce(context.input("low").data, m_names.size() * 2 + 1);
    }

    void compute(const TileContext&) const override {}

    void reduce(const TileContext& row, std::span<double> sums) const override
    {
        const Region& region = row.region();
        const std::size_t n = m_names.size();
        std::size_t left_out = 0;
        for (int y = region.y0; y < region.y1; ++y)
            for (int x = region.x0; x < region.x1; ++x) {
                bool finite = true;
                std::vector<double> inside(2 * n, 0.0);
                for (std::size_t c = 0; c < n; ++c) {
                    const float low = row.input("low").at(m_channels[0][c], x, y);
                    const float high = row.input("high").at(m_channels[1][c], x, y);
                    const float truth = row.input("reference").at(m_channels[2][c], x, y);
                    const float value =
                        m_has_image ? row.input("image").at(m_channels[3][c], x, y) : truth;
                    finite = finite && std::isfinite(low) && std::isfinite(high) &&
                             std::isfinite(truth) && std::isfinite(value);
                    inside[c] = low <= truth && truth <= high ? 1.0 : 0.0;
                    inside[n + c] = std::fabs(value - truth) <= high - low ? 1.0 : 0.0;
                }
                if (!finite) {
                    ++left_out;
                    continue;
                }
                for (std::size_t i = 0; i < 2 * n; ++i) sums[i] += inside[i];
                sums[2 * n] += 1.0;
            }
        if (left_out > 0) row.count("pixels left out (not finite)", left_out);
    }

    std::map<std::string, Table, std::less<>> finish(std::span<const double> totals,
                                                     std::span<const TileContext::Input>) override
    {
        const std::size_t n = m_names.size();
        const double pixels = totals[2 * n];
        if (pixels == 0.0) throw InputError("no pixel is finite in all images");
        Table table;
        for (const bool bound : {false, true}) {
            if (bound && !m_has_image) continue;
            const std::string name = bound ? "bound" : "interval";
            double sum = 0.0;
            for (std::size_t c = 0; c < n; ++c) {
                const double share = totals[(bound ? n : 0) + c] / pixels;
                table.set(name + "_" + m_names[c], share);
                sum += share;
            }
            table.set(name, sum / static_cast<double>(n));
        }
        table.set("pixels", pixels);
        return {{"coverage", table}};
    }

private:
    std::vector<std::string> m_names;
    std::vector<std::vector<int>> m_channels; ///< of low, high, reference, image
    bool m_has_image = false;
};

RAYLOOM_NODE(Coverage);

} // namespace
} // namespace rayloom
