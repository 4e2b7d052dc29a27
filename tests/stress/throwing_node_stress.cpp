// SPDX-License-Identifier: Apache-2.0
// Nodes somebody else wrote, which throw what they like wherever they like: the run ends with an
// error that says which node, and the earlier file stays.
#include "rayloom/core/registry.h"
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/support/command.h"
#include "tests/support/made_up_input.h"

#include <gtest/gtest.h>

#include <fstream>
#include <stdexcept>

namespace rayloom::test
{
namespace
{

/// Throws `what` at the `place` its parameters name.
class Throws final : public Node
{
public:
    struct Params {
        std::string place = "compute", what = "runtime_error";
    };
    static void describe(Declaration<Params>& d)
    {
        d.name("mock.throws").summary("Throws.");
        d.input("image", "any image");
        d.output("image", "the same");
        d.param("place", &Params::place, "where")
            .choices({"create", "plan", "reduce", "finish", "compute"});
        d.param("what", &Params::what, "what")
            .choices({"runtime_error", "bad_alloc", "int", "logic_error"});
    }
    explicit Throws(const Params& params) : m(params) { at("create"); }
    void plan(PlanContext& context) override
    {
        at("plan");
        context.output("image", context.input("image"));
        context.reduce(context.input("image").data, 1);
        context.reduce_needs("image");
    }
    void reduce(const TileContext&, std::span<double>) const override { at("reduce"); }
    std::map<std::string, Table, std::less<>> finish(std::span<const double>,
                                                     std::span<const TileContext::Input>) override
    {
        at("finish");
        return {};
    }
    void compute(const TileContext& context) const override
    {
        if (context.region().y1 > 20) at("compute");
        copy_pixels(context.input("image").crop(context.region()), context.output("image"));
    }

private:
    void at(const char* place) const
    {
        if (m.place != place) return;
        if (m.what == "bad_alloc") throw std::bad_alloc();
        if (m.what == "int") throw 42;
        if (m.what == "logic_error") throw std::out_of_range("out of somewhere");
        throw std::runtime_error("no good");
    }
    Params m;
};

TEST(ThrowingNode, EndsTheRunWithAnErrorThatNamesIt)
{
    static const bool registered = (Registry::instance().add(node_info<Throws>()), true);
    ASSERT_TRUE(registered);
    const TemporaryFolder folder;
    const std::string file = (folder.path() / "out.exr").string();
    for (const char* place : {"create", "plan", "reduce", "finish", "compute"})
        for (const char* what : {"runtime_error", "bad_alloc", "int", "logic_error"}) {
            SCOPED_TRACE(std::string(what) + " in " + place);
            std::ofstream(file) << "the earlier file";
            const Graph graph = parse_graph(
                std::string(
                    "rayloom: 1\nname: throws\ninputs: {color: {channels: RGB}}\nnodes: {bad: "
                    "{op: mock.throws, image: color, place: ") +
                    place + ", what: " + what + "}}\noutputs: {image: bad}\n",
                "throws");
            RunRequest request = made_up_request(graph, {0, 0, 40, 40});
            request.outputs["image"].path = file;
            RunOptions options;
            options.threads = 3;
            options.tile = 8;
            try {
                run_graph(graph, request, options);
                ADD_FAILURE() << "it did not throw";
            } catch (const Error& e) {
                EXPECT_NE(std::string(e.what()).find("bad"), std::string::npos) << e.what();
                EXPECT_EQ(e.exit_code(), std::string(what) == "bad_alloc" ? 5 : 70) << e.what();
            }
            std::ifstream in(file);
            EXPECT_EQ(std::string(std::istreambuf_iterator<char>(in), {}), "the earlier file");
            EXPECT_EQ(folder.names(), std::vector<std::string>{"out.exr"});
        }
}

} // namespace
} // namespace rayloom::test
