// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/registry.h"

#include <string>
#include <vector>

namespace rayloom
{
namespace
{

/// measure.bound: how far off a pixel may be after filtering over homogeneous pixels.
class Bound final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("measure.bound")
            .summary("The error bound of filtering over homogeneous pixels, as an image.")
            .doc("2·t·s/√n, the width of the confidence interval: with probability 1 − α (or more) "
                 "a "
                 "result that lies in the interval is off by no more than that.")
            .source("000_092f36e585912bb0.txt, theorem 3.1, appendix A")
            .accuracy("high − low in float.")
            .example("rayloom: 1\n"
                     "name: bound-example\n"
                     "inputs:\n"
                     "  mean: {doc: mean of the samples, channels: RGB}\n"
                     "  variance: {doc: their variance, channels: RGB}\n"
                     "nodes:\n"
                     "  interval: {op: threshold.interval, mean: mean, variance: variance,\n"
                     "             samples: 16}\n"
                     "  bound: {op: measure.bound, low: interval.low, high: interval.high}\n"
                     "outputs:\n"
                     "  bound: bound.bound\n");
        d.input("low", "lower end of the interval (threshold.interval)");
        d.input("high", "upper end");
        d.output("bound", "largest error to expect, radiance");
    }

    explicit Bound(const Params&) {}

    void plan(PlanContext& context) override
    {
        context.require_same_window("low", "high");
        if (context.input("low").channel_count() != context.input("high").channel_count())
            throw NodeError("low and high must have the same channels");
        context.output("bound", context.input("low"));
    }

    void compute(const TileContext& context) const override
    {
        const Region& region = context.region();
        const ImageView out = context.output("bound");
        for (int y = region.y0; y < region.y1; ++y)
            for (int c = 0; c < out.channels(); ++c) {
                const float* low = context.input("low").ptr(c, region.x0, y);
                const float* high = context.input("high").ptr(c, region.x0, y);
                float* to = out.row(c, y);
                for (int i = 0; i < region.width(); ++i) to[i] = high[i] - low[i];
            }
    }
};

RAYLOOM_NODE(Bound);

} // namespace
} // namespace rayloom
