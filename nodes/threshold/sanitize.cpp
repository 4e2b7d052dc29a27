// SPDX-License-Identifier: Apache-2.0
#include "nodes/threshold/sanitize_kernel.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <limits>

namespace rayloom
{
namespace
{

/// threshold.sanitize: the door at which NaN and infinities stop.
class Sanitize final : public Node
{
public:
    struct Params {
        std::string mode = "neighbours";
        int reach = 3;
        bool negative = false;
        float limit = 0.0f;
    };
    static void describe(Declaration<Params>& d)
    {
        d.name("threshold.sanitize")
            .summary("Replaces NaN and infinite pixels, and counts them.")
            .doc("Every other value passes bit for bit: by default nothing finite is touched, "
                 "whatever its size. Negative colour and colour above a limit are replaced only "
                 "on request, never clamped, and each counted apart. A value is replaced channel "
                 "by channel from good values of the same channel; those that are themselves "
                 "replaced do not count, so the result does not depend on an order.")
            .accuracy("Good values are exact; means are summed in double.")
            .example("rayloom: 1\nname: sanitize\ninputs:\n  color: {doc: a render}\n"
                     "nodes:\n  clean: {op: threshold.sanitize, image: color}\n"
                     "outputs:\n  image: clean\n");
        d.input("image", "any image");
        d.output("image", "the image without NaN and infinities");
        d.param("mode", &Params::mode,
                "what stands in for a bad value: the mean of the good ones in the smallest of the "
                "windows 3×3, 5×5, … that has any (neighbours), in 3×3 (box3), or zero (black); "
                "zero too where no window has any")
            .choices({"neighbours", "box3", "black"});
        d.param("reach", &Params::reach,
                "largest distance of a neighbour in the mode neighbours: 3 goes up to 7×7")
            .range(1, 32)
            .unit("px");
        d.param("negative", &Params::negative, "treats negative colour as bad too");
        d.param("limit", &Params::limit,
                "treats colour above it as bad too (a firefly is replaced, not clamped); 0: no "
                "limit")
            .min(0.0)
            .unit("radiance");
    }
    explicit Sanitize(const Params& params) : m(params) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        const auto n = static_cast<std::size_t>(image.channel_count());
        const float most = std::numeric_limits<float>::max();
        m_rule.repair = m.mode == "black" ? Repair::black : Repair::neighbours;
        m_rule.reach = m.mode == "neighbours" ? m.reach : 1;
        m_rule.lowest.assign(n, -most);
        m_rule.highest.assign(n, most);
        for (const int c : image.colour()) {
            const auto k = static_cast<std::size_t>(c);
            if (m.negative) m_rule.lowest[k] = 0.0f;
            if (m.limit > 0.0f) m_rule.highest[k] = m.limit;
        }
        context.output("image", image);
        if (m_rule.repair == Repair::neighbours)
            context.needs("image", Halo::all(m_rule.reach));
        else
            context.in_place("image");
    }
    void compute(const TileContext& context) const override
    {
        const RepairCounts counts =
            repair_pixels(context.input("image"), m_rule, context.output("image"));
        if (counts.not_finite > 0) context.count("NaN pixels repaired", counts.not_finite);
        if (counts.too_low > 0) context.count("negative pixels repaired", counts.too_low);
        if (counts.too_high > 0) context.count("pixels above the limit repaired", counts.too_high);
    }

private:
    Params m;
    RepairRule m_rule;
};
RAYLOOM_NODE(Sanitize);

} // namespace
} // namespace rayloom
