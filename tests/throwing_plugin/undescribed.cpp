// SPDX-License-Identifier: Apache-2.0
// A node that throws while it is described, which is while its library is loaded.
#include <rayloom/core/registry.h>

#include <stdexcept>

using namespace rayloom;

namespace
{
struct Undescribed final : Node {
    struct Params {
    };
    static void describe(Declaration<Params>& d)
    {
        d.name("example.undescribed").summary("Cannot be described.");
        throw std::runtime_error("no description today");
    }
    explicit Undescribed(const Params&) {}
    void plan(PlanContext&) override {}
    void compute(const TileContext&) const override {}
};
} // namespace
RAYLOOM_NODE(Undescribed);
