// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"
#include "rayloom/image/window_sums.h"

#include <algorithm>
#include <vector>

namespace rayloom
{
namespace
{

/// transform.half_buffers: mean and variance of two renders of half the samples each.
class HalfBuffers final : public Node
{
public:
    struct Params {
        int radius = 2;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.half_buffers")
            .summary("Mean and variance of the mean from two renders with disjoint samples.")
            .doc(
                "mean = (a + b)/2. ((a − b)/2)² is an unbiased estimate of the variance of that "
                "mean with a single degree of freedom, too rough to use by itself: it is averaged "
                "over a square, clipped at the border. `count` is 1 + the pixels of a full square: "
                "the count whose Student factor the averaged variance deserves (threshold.interval "
                "with variance_of: mean). For renderers that write two half buffers; a stack of "
                "renders is better served by transform.statistics, and transform.halves makes "
                "halves of one.")
            .source("MATH.md, shared notation")
            .accuracy("Averages in double.")
            .example("rayloom: 1\n"
                     "name: half-buffers-example\n"
                     "inputs:\n"
                     "  a: {doc: one half of the samples, channels: RGB}\n"
                     "  b: {doc: the other half, channels: RGB}\n"
                     "nodes:\n"
                     "  halves: {op: transform.half_buffers, a: a, b: b}\n"
                     "  interval: {op: threshold.interval, mean: halves.mean,\n"
                     "             variance: halves.variance, count: halves.count,\n"
                     "             variance_of: mean}\n"
                     "outputs:\n"
                     "  width: interval.half_width\n");
        d.input("a", "one half of the samples");
        d.input("b", "the other half");
        d.output("mean", "(a + b)/2, every channel").optional();
        d.output("variance", "variance of the mean, colour channels").optional();
        d.output("count", "effective number of samples of that variance").optional();
        d.param("radius", &Params::radius, "Half-size of the square the variance is averaged over.")
            .range(0, 64)
            .unit("px");
    }

    explicit HalfBuffers(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        context.require_same_window("a", "b");
        const ImageDesc& a = context.input("a");
        if (a.channels != context.input("b").channels)
            throw NodeError(
                "a and b have different channels; they must be two halves of one render");
        m_window = a.data;
        m_channels = a.colour();
        context.output("mean", a);
        context.output("variance", a.with_channels(channel_names(a, m_channels)));
        context.output("count", a.with_channels({"count"}));
        const int side = 2 * m.radius + 1;
        context.constant("count", static_cast<float>(side * side + 1));
        for (const char* port : {"a", "b"}) context.needs(port, Halo::all(m.radius));
    }

    void compute(const TileContext& context) const override
    {
        const Region& region = context.region();
        const ConstImageView a = context.input("a"), b = context.input("b");
        if (context.wants("count"))
            for (int y = region.y0; y < region.y1; ++y) {
                const int side = 2 * m.radius + 1;
                std::fill_n(context.output("count").row(0, y), region.width(),
                            static_cast<float>(side * side + 1));
            }
        if (context.wants("mean"))
            for (int y = region.y0; y < region.y1; ++y)
                for (int c = 0; c < a.channels(); ++c) {
                    const float *from_a = a.ptr(c, region.x0, y), *from_b = b.ptr(c, region.x0, y);
                    float* to = context.output("mean").row(c, y);
                    for (int i = 0; i < region.width(); ++i) to[i] = 0.5f * (from_a[i] + from_b[i]);
                }
        if (!context.wants("variance")) return;
        const Region wide = region.grown(Halo::all(m.radius)).intersect(m_window);
        std::vector<double> column(static_cast<std::size_t>(wide.width()));
        std::vector<double> means(static_cast<std::size_t>(region.width()));
        for (std::size_t c = 0; c < m_channels.size(); ++c)
            for (int y = region.y0; y < region.y1; ++y) {
                const int v0 = std::max(y - m.radius, wide.y0),
                          v1 = std::min(y + m.radius + 1, wide.y1);
                std::fill(column.begin(), column.end(), 0.0);
                for (int v = v0; v < v1; ++v) {
                    const float* from_a = a.ptr(m_channels[c], wide.x0, v);
                    const float* from_b = b.ptr(m_channels[c], wide.x0, v);
                    for (std::size_t i = 0; i < column.size(); ++i) {
                        const double e =
                            0.5 * (static_cast<double>(from_a[i]) - static_cast<double>(from_b[i]));
                        column[i] += e * e;
                    }
                }
                window_means(column, v1 - v0, region.x0 - wide.x0, m.radius, means);
                std::ranges::transform(means,
                                       context.output("variance").row(static_cast<int>(c), y),
                                       [](double mean) { return static_cast<float>(mean); });
            }
    }

private:
    Params m;
    Region m_window;
    std::vector<int> m_channels;
};

RAYLOOM_NODE(HalfBuffers);

} // namespace
} // namespace rayloom
