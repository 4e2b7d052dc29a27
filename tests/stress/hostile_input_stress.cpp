// SPDX-License-Identifier: Apache-2.0
// Every registered node, by its example, and every shipped graph on every kind of hostile input: a
// finite picture or a typed error, and the same picture in tiles and on other numbers of threads.
#include "rayloom/core/registry.h"
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/stress/hostile_images.h"
#include "tests/stress/soak.h"
#include "tests/support/engine_nodes_for_tests.h"
#include "tests/support/made_up_deep.h"
#include "tests/support/made_up_input.h"
#include "tests/support/subjects.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <set>

namespace rayloom::test
{
namespace
{

/// What a run gave: pictures, or the error it ended with.
struct Outcome {
    std::vector<MemoryImage> images;
    std::vector<MemoryDeep> deep;
    std::map<std::string, std::vector<Table>, std::less<>> tables;
    std::string error;
};

Outcome outcome_of(const Graph& graph, const RunRequest& request, int threads, int tile, bool skip)
{
    RunOptions options;
    options.threads = threads;
    options.tile = tile;
    options.skip = skip;
    Outcome outcome;
    try {
        RunReport report = run_graph(graph, request, options);
        for (auto& [name, list] : report.images)
            for (MemoryImage& image : list) outcome.images.push_back(std::move(image));
        for (auto& [name, list] : report.deep)
            for (MemoryDeep& deep : list) outcome.deep.push_back(std::move(deep));
        outcome.tables = std::move(report.tables);
    } catch (const Error& e) {
        outcome.error = e.what();
        EXPECT_NE(e.exit_code(), 70) << "not a typed error: " << e.what();
        EXPECT_FALSE(outcome.error.empty());
    }
    return outcome;
}

/// Two NaN are one answer, whichever of their bits differ.
bool same_value(float a, float b)
{
    return std::bit_cast<std::uint32_t>(a) == std::bit_cast<std::uint32_t>(b) ||
           (std::isnan(a) && std::isnan(b));
}

/// The first difference as text, empty when there is none.
std::string difference(const Outcome& a, const Outcome& b)
{
    if (a.error.empty() != b.error.empty()) return "fails one way only: " + a.error + b.error;
    if (a.images.size() != b.images.size() || a.deep.size() != b.deep.size())
        return "other number of images";
    for (std::size_t i = 0; i < a.deep.size(); ++i)
        if (const auto same = same_samples(a.deep[i], b.deep[i]); !same) return same.message();
    for (std::size_t i = 0; i < a.images.size(); ++i) {
        const MemoryImage &p = a.images[i], &q = b.images[i];
        if (p.desc.data != q.desc.data || p.desc.channels != q.desc.channels)
            return "other window or channels";
        const Region& r = p.desc.data;
        for (int c = 0; c < p.desc.channel_count(); ++c)
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1; ++x) {
                    const float u = p.pixels.view().at(c, x, y), v = q.pixels.view().at(c, x, y);
                    if (!same_value(u, v))
                        return "image " + std::to_string(i) + " channel " + std::to_string(c) +
                               " pixel " + std::to_string(x) + "," + std::to_string(y) + ": " +
                               std::to_string(u) + " and " + std::to_string(v);
                }
    }
    return {};
}

/// What is wrong with a picture under a demand, as text; empty when nothing is.
std::string complaint(const MemoryImage& image, Demand demand, bool of_graph)
{
    const Region& r = image.desc.data;
    if (r.empty() || demand == Demand::anything) return {};
    const ConstImageView view = image.pixels.view();
    if (demand == Demand::confined && !of_graph) {
        for (int c = 0; c < view.channels(); ++c)
            if (!std::isfinite(view.at(c, r.x0, r.y0)) &&
                !std::isfinite(view.at(c, r.x1 - 1, r.y0)) &&
                !std::isfinite(view.at(c, r.x0, r.y1 - 1)) &&
                !std::isfinite(view.at(c, r.x1 - 1, r.y1 - 1)))
                return "no corner of channel " + std::to_string(c) + " is finite";
        return {};
    }
    for (int c = 0; c < view.channels(); ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x) {
                const float v = view.at(c, x, y);
                if (demand == Demand::no_nan ? std::isnan(v) : !std::isfinite(v))
                    return "channel " + std::to_string(c) + " pixel " + std::to_string(x) + "," +
                           std::to_string(y) + " is " + std::to_string(v);
            }
    return {};
}

/// Nodes that rightly give NaN for finite input, and why.
const std::map<std::string, std::string> gives_nan{
    {"oiio.pow", "a root of a negative number is none, as in oiiotool"}};

/// Graphs that are nodes of others, which have the door.
const std::set<std::string> inner_graphs{"nlm-first-step", "nlm-image"};

bool uses(const Graph& graph, const std::map<std::string, std::string>& nodes)
{
    return std::ranges::any_of(graph.nodes,
                               [&](const GraphNode& n) { return nodes.contains(n.op); });
}

void hold(const Graph& graph, bool has_door, const std::vector<HostileCase>& cases)
{
    std::size_t turn = 0;
    for (HostileCase hostile : cases) {
        SCOPED_TRACE(hostile.name);
        if (!has_door && uses(graph, gives_nan)) hostile.demand = Demand::anything;
        const RunRequest request = hostile.request(graph);
        const Outcome whole = outcome_of(graph, request, 1, 8192, true);
        for (std::size_t i = 0; i < whole.images.size(); ++i)
            EXPECT_EQ(complaint(whole.images[i], hostile.demand, has_door), "") << "image " << i;
        if (hostile.demand == Demand::finite) {
            for (const MemoryDeep& deep : whole.deep) EXPECT_TRUE(all_finite(deep));
        }
        const auto hold_same = [&](int threads, int tile, bool skip) {
            const Outcome other = outcome_of(graph, request, threads, tile, skip);
            // Without shortcuts branches run that nobody needs, and refuse what they cannot do.
            if (!skip && whole.error.empty() && !other.error.empty()) return;
            EXPECT_EQ(difference(other, whole), "")
                << threads << " threads, tiles of " << tile << (skip ? "" : ", no shortcuts");
        };
        // In the short version the ways take turns.
        ++turn;
        if (soaking() || turn % 2 == 0) hold_same(2, 11, true);
        if (soaking() || turn % 2 == 1) hold_same(7, 16, false);
        if (!soaking()) continue;
        for (const int threads : {1, 2, 7})
            for (const int tile : {0, 8, 37}) hold_same(threads, tile, true);
    }
}

int side() { return soaking() ? 83 : 23; }

std::string test_name(const ::testing::TestParamInfo<std::string>& info)
{
    return as_test_name(info.param);
}

class HostileNode : public ::testing::TestWithParam<std::string>
{
};

TEST_P(HostileNode, GivesAFinitePictureOrATypedError)
{
    const Graph graph = example_graph(GetParam());
    if (touches_files(graph)) GTEST_SKIP() << "reads or writes files";
    hold(graph, false, hostile_cases(side()));
}

INSTANTIATE_TEST_SUITE_P(Registry, HostileNode, ::testing::ValuesIn(built_in_nodes()), test_name);

class HostileGraph : public ::testing::TestWithParam<std::string>
{
};

TEST_P(HostileGraph, GivesAFinitePictureOrATypedError)
{
    Graph graph = read_graph(GetParam());
    // A file that is filtered hands on what it holds besides: its own NaN with the rest.
    std::erase_if(graph.outputs, [](const GraphOutput& o) { return o.name == "render"; });
    hold(graph, !inner_graphs.contains(graph.name), hostile_cases(side()));
}

std::vector<std::string> nodes_with_deep_input()
{
    std::vector<std::string> names = built_in_nodes();
    std::erase_if(names, [](const std::string& name) {
        return name.starts_with("io.") ||
               std::ranges::none_of(Registry::instance().find(name)->inputs,
                                    [](const PortInfo& p) { return p.kind == PortKind::deep; });
    });
    return names;
}

/// The node with its deep input, what it cannot do without, and all its outputs: an example may
/// show another way to use it.
Graph graph_of_deep_input(const NodeInfo& node)
{
    std::string inputs, ports, outputs;
    for (const PortInfo& port : node.inputs) {
        if (port.kind != PortKind::deep && !port.required) continue;
        inputs +=
            "  " + port.name + ": " + (port.kind == PortKind::deep ? "{kind: deep}" : "{}") + "\n";
        ports += ", " + port.name + ": " + port.name;
    }
    for (const PortInfo& port : node.outputs)
        outputs += "  " + port.name + ": n." + port.name + "\n";
    return parse_graph("rayloom: 1\nname: deep-input\ninputs:\n" + inputs +
                           "nodes:\n  n: {op: " + node.name + ports + "}\noutputs:\n" + outputs,
                       node.name);
}

class HostileDeepPixels : public ::testing::TestWithParam<std::string>
{
};

TEST_P(HostileDeepPixels, GiveAFinitePictureOrATypedError)
{
    const Graph graph = graph_of_deep_input(*Registry::instance().find(GetParam()));
    const RunRequest plain = made_up_request(graph, {0, 0, side(), side()});
    ASSERT_EQ(outcome_of(graph, plain, 1, 0, true).error, "") << "nothing would be tried";
    hold(graph, false, deep_cases(side()));
    hold(graph, false, hostile_cases(side()));
}

INSTANTIATE_TEST_SUITE_P(Registry, HostileDeepPixels, ::testing::ValuesIn(nodes_with_deep_input()),
                         test_name);

INSTANTIATE_TEST_SUITE_P(Shipped, HostileGraph, ::testing::ValuesIn(shipped_graphs()), test_name);

} // namespace
} // namespace rayloom::test
