// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/registry.h"

namespace rayloom
{
namespace
{

/// transform.halves: a stack into two means that share no sample.
class Halves final : public Node
{
public:
    struct Params {
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.halves")
            .summary("Means of the even and of the odd images of a stack, and the mean of both.")
            .doc("The two halves are independent renders of half the samples, so half their "
                 "difference is noise of the strength that the mean has. Of an odd number of "
                 "images the last one goes into both halves with half its weight, so that "
                 "mean = (a + b)/2 whatever the number; the difference then shows "
                 "√((n − 1)/n) of the noise. One image has no halves.\n\n"
                 "This node splits samples; what two halves say of the variance is the business of "
                 "transform.half_buffers, and what a whole stack says of it of "
                 "transform.statistics.")
            .source("MATH.md, section 3")
            .accuracy("Summed in double, rounded once.")
            .example("rayloom: 1\n"
                     "name: halves-example\n"
                     "doc: The two halves of a stack of renders.\n"
                     "inputs:\n"
                     "  stack: {doc: renders that differ in their seed, kind: list}\n"
                     "nodes:\n"
                     "  halves: {op: transform.halves, stack: stack}\n"
                     "outputs:\n"
                     "  a: halves.a\n"
                     "  b: halves.b\n");
        d.input("stack", "renders of one frame that differ in their seed").list();
        d.output("mean", "mean of all images");
        d.output("a", "mean of images 0, 2, 4, …").optional();
        d.output("b", "mean of images 1, 3, 5, …").optional();
    }
    explicit Halves(const Params&) {}

    void plan(PlanContext& context) override
    {
        const std::size_t n = context.count("stack");
        const ImageDesc& first = context.input("stack");
        for (std::size_t i = 1; i < n; ++i) {
            context.require_same_window("stack", "stack", 0, i);
            if (context.input("stack", i).channels != first.channels)
                throw NodeError("image " + std::to_string(i) +
                                " of the stack has other channels than image 0");
        }
        for (const char* port : {"mean", "a", "b"}) context.output(port, first);
        if (n == 1) {
            context.note("the stack is a single image; both halves are that image, and say "
                         "nothing of its noise");
            for (const char* port : {"mean", "a", "b"}) context.pass_through(port, "stack");
        }
    }

    void compute(const TileContext& context) const override
    {
        const Region& r = context.region();
        const auto width = static_cast<std::size_t>(r.width());
        const std::size_t n = context.count("stack");
        std::vector<double> sums(3 * width);
        const std::span<double> a(sums.data(), width), b(a.data() + width, width),
            mean(b.data() + width, width);
        const double share = 2.0 / static_cast<double>(n);
        const int channels = context.input("stack").channels();
        for (int y = r.y0; y < r.y1; ++y)
            for (int c = 0; c < channels; ++c) {
                std::ranges::fill(sums, 0.0);
                for (std::size_t i = 0; i < n; ++i) {
                    const float* const in = context.input("stack", i).ptr(c, r.x0, y);
                    const bool both = n % 2 == 1 && i + 1 == n;
                    const std::span<double> to = i % 2 == 0 ? a : b;
                    for (std::size_t x = 0; x < width; ++x) {
                        if (both) {
                            a[x] += 0.5 * in[x];
                            b[x] += 0.5 * in[x];
                        } else {
                            to[x] += in[x];
                        }
                    }
                }
                for (std::size_t x = 0; x < width; ++x) mean[x] = 0.5 * (a[x] + b[x]);
                const auto store = [&](std::string_view port, std::span<const double> from) {
                    if (!context.wants(port)) return;
                    float* const out = context.output(port).row(c, y);
                    for (std::size_t x = 0; x < width; ++x)
                        out[x] = static_cast<float>(from[x] * share);
                };
                store("mean", mean);
                store("a", a);
                store("b", b);
            }
    }
};

RAYLOOM_NODE(Halves);

} // namespace
} // namespace rayloom
