// SPDX-License-Identifier: Apache-2.0
// A node somebody else compiled, which throws what it likes wherever it likes.
#include <rayloom/core/registry.h>

#include <new>
#include <stdexcept>
#include <string>

using namespace rayloom;

namespace
{
/// Known to this library alone.
struct Mine final : std::exception {
    const char* what() const noexcept override { return "all mine"; }
};

struct Throws final : Node {
    struct Params {
        std::string place = "compute", what = "mine";
    };
    static void describe(Declaration<Params>& d)
    {
        d.name("example.throws").summary("Throws.");
        d.input("image", "any image");
        d.output("image", "the same");
        d.param("place", &Params::place, "where").choices({"create", "plan", "compute"});
        d.param("what", &Params::what, "what").choices({"mine", "bad_alloc", "int"});
    }
    explicit Throws(const Params& p) : params(p) { at("create"); }
    void plan(PlanContext& context) override
    {
        at("plan");
        context.output("image", context.input("image"));
    }
    void compute(const TileContext&) const override { at("compute"); }
    void at(const char* place) const
    {
        if (params.place != place) return;
        if (params.what == "bad_alloc") throw std::bad_alloc();
        if (params.what == "int") throw 42;
        throw Mine();
    }
    Params params;
};
} // namespace
RAYLOOM_NODE(Throws);
