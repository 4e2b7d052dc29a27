// SPDX-License-Identifier: Apache-2.0
// Every registered node, by its example, and every shipped graph on every kind of hostile input: a
// finite picture or a typed error, and the same picture in tiles and on other numbers of threads.
#include "rayloom/core/registry.h"
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/stress/hostile_images.h"
#include "tests/stress/reach.h"
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
#include <functional>
#include <iomanip>
#include <optional>
#include <set>
#include <sstream>

namespace rayloom::test
{
namespace
{

/// What a run gave, or the error it ended with.
struct Outcome {
    RunReport report;
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
        outcome.report = run_graph(graph, request, options);
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

bool same_cell(const Table::Cell& a, const Table::Cell& b)
{
    const double *u = std::get_if<double>(&a), *v = std::get_if<double>(&b);
    if (!u || !v) return a == b;
    return std::bit_cast<std::uint64_t>(*u) == std::bit_cast<std::uint64_t>(*v) ||
           (std::isnan(*u) && std::isnan(*v));
}

std::string text_of(const Table::Cell& cell)
{
    const double* v = std::get_if<double>(&cell);
    if (!v) return std::get<std::string>(cell);
    std::ostringstream text;
    text << std::setprecision(17) << *v;
    return text.str();
}

std::string difference(const Table& a, const Table& b)
{
    if (a.columns != b.columns) return "other columns";
    if (a.rows.size() != b.rows.size()) return "other number of rows";
    for (std::size_t r = 0; r < a.rows.size(); ++r) {
        if (a.rows[r].size() != b.rows[r].size()) return "other number of cells";
        for (std::size_t c = 0; c < a.rows[r].size(); ++c)
            if (!same_cell(a.rows[r][c], b.rows[r][c]))
                return "row " + std::to_string(r) + " column " + a.columns.at(c) + ": " +
                       text_of(a.rows[r][c]) + " and " + text_of(b.rows[r][c]);
    }
    return {};
}

std::string difference(const MemoryDeep& a, const MemoryDeep& b)
{
    const auto same = same_samples(a, b);
    return same ? std::string{} : same.message();
}

std::string difference(const MemoryImage& a, const MemoryImage& b)
{
    if (a.desc.data != b.desc.data || a.desc.channels != b.desc.channels)
        return "other window or channels";
    const Region& r = a.desc.data;
    for (int c = 0; c < a.desc.channel_count(); ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x) {
                const float u = a.pixels.view().at(c, x, y), v = b.pixels.view().at(c, x, y);
                if (!same_value(u, v))
                    return "channel " + std::to_string(c) + " pixel " + std::to_string(x) + "," +
                           std::to_string(y) + ": " + std::to_string(u) + " and " +
                           std::to_string(v);
            }
    return {};
}

template <class T>
using Results = std::map<std::string, std::vector<T>, std::less<>>;

template <class T>
std::string difference(const Results<T>& a, const Results<T>& b)
{
    if (a.size() != b.size()) return "other number of outputs";
    for (auto p = a.begin(), q = b.begin(); p != a.end(); ++p, ++q) {
        if (p->first != q->first || p->second.size() != q->second.size())
            return "other outputs: " + p->first + " and " + q->first;
        for (std::size_t i = 0; i < p->second.size(); ++i)
            if (const std::string text = difference(p->second[i], q->second[i]); !text.empty())
                return p->first + "[" + std::to_string(i) + "] " + text;
    }
    return {};
}

/// The first difference as text, empty when there is none.
std::string difference(const Outcome& a, const Outcome& b)
{
    if (a.error != b.error) return "errors: \"" + a.error + "\" and \"" + b.error + "\"";
    for (const std::string& text :
         {difference(a.report.images, b.report.images), difference(a.report.deep, b.report.deep),
          difference(a.report.tables, b.report.tables)})
        if (!text.empty()) return text;
    return {};
}

bool may_be(double value, Demand demand)
{
    switch (demand) {
    case Demand::anything: return true;
    case Demand::no_nan: return !std::isnan(value);
    case Demand::finite:
    case Demand::hopeless:
    case Demand::confined: break;
    }
    return std::isfinite(value);
}

/// What may be other than the demand says, and why: a figure of a table, or a channel of a deep
/// image.
const std::map<std::string, std::map<std::string, std::string>> documented{
    {"measure.channels",
     {{"minimum", "of no finite value there is none"},
      {"maximum", "likewise"},
      {"mean", "likewise"},
      {"deviation", "likewise"}}},
    {"graph:deep-recolor",
     {{"A", "what the deep render holds besides colour is handed on as it is"},
      {"Z", "likewise"}}}};

/// What is exempt from demands in a graph, by the name of its figure or channel.
std::set<std::string> exempt_in(const Graph& graph, bool is_shipped)
{
    std::set<std::string> names;
    const auto add = [&](const std::string& subject) {
        if (const auto it = documented.find(subject); it != documented.end())
            for (const auto& [name, reason] : it->second) names.insert(name);
    };
    if (is_shipped) add("graph:" + graph.name);
    for (const GraphNode& node : graph.nodes) add(node.op);
    return names;
}

/// Nodes that rightly give NaN for negative input, and why.
const std::map<std::string, std::string> gives_nan{
    {"oiio.pow", "a root of a negative number is none, as in oiiotool"}};

/// Whether a pixel of an output is made from a bad pixel, as far as plans tell.
using Excuse = std::function<bool(const std::string& output, std::size_t image, int x, int y)>;

/// What is wrong with what a run gave, as text; empty when nothing is.
std::string complaint(const RunReport& report, Demand demand, const Excuse& excused,
                      const std::set<std::string>& exempt)
{
    const auto text_at = [](const std::string& output, std::size_t i, const std::string& channel,
                            int x, int y, float v) {
        std::ostringstream text;
        text << output << "[" << i << "] channel " << channel << " pixel " << x << "," << y
             << " is " << v;
        return text.str();
    };
    for (const auto& [name, list] : report.images)
        for (std::size_t i = 0; i < list.size(); ++i) {
            const Region& r = list[i].desc.data;
            std::int64_t lost = 0;
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1; ++x) {
                    bool good = true;
                    for (int c = 0; c < list[i].desc.channel_count(); ++c) {
                        const float v = list[i].pixels.view().at(c, x, y);
                        if (may_be(v, demand)) continue;
                        good = false;
                        if (!excused(name, i, x, y))
                            return text_at(name, i,
                                           list[i].desc.channels[static_cast<std::size_t>(c)], x, y,
                                           v);
                    }
                    lost += !good;
                }
            // What by its plan reaches everything from everywhere (light that is spread over the
            // whole image) must still keep to some part of it.
            if (demand == Demand::confined && 8 * lost > 7 * static_cast<std::int64_t>(r.pixels()))
                return name + ": " + std::to_string(lost) + " pixels are lost";
        }
    for (const auto& [name, list] : report.deep)
        for (std::size_t i = 0; i < list.size(); ++i) {
            const Region& r = list[i].desc.data;
            for (int c = 0; c < list[i].desc.channel_count(); ++c) {
                const std::string& channel = list[i].desc.channels[static_cast<std::size_t>(c)];
                if (exempt.contains(channel)) continue;
                for (int y = r.y0; y < r.y1; ++y)
                    for (int x = r.x0; x < r.x1; ++x)
                        for (const float v : samples_at(list[i], c, x, y))
                            if (!may_be(v, demand) && !excused(name, i, x, y))
                                return text_at(name, i, channel, x, y, v);
            }
        }
    for (const auto& [name, list] : report.tables)
        for (const Table& table : list)
            for (const auto& row : table.rows)
                for (std::size_t c = 0; c < row.size(); ++c)
                    if (const double* v = std::get_if<double>(&row[c]);
                        v && !may_be(*v, demand) && !exempt.contains(table.columns.at(c)))
                        return name + ": column " + table.columns.at(c) + " is " +
                               std::to_string(*v);
    return {};
}

bool uses(const Graph& graph, const std::map<std::string, std::string>& nodes)
{
    return std::ranges::any_of(graph.nodes,
                               [&](const GraphNode& n) { return nodes.contains(n.op); });
}

void hold(const Graph& graph, bool is_shipped, const std::vector<HostileCase>& cases)
{
    const std::set<std::string> exempt = exempt_in(graph, is_shipped);
    std::size_t turn = 0;
    for (HostileCase hostile : cases) {
        SCOPED_TRACE(hostile.name);
        const RunRequest request = hostile.request(graph);
        if (uses(graph, gives_nan) && has_negative_pixels(request))
            hostile.demand = Demand::anything;
        // A graph has a door.
        const bool confined = hostile.demand == Demand::confined && !is_shipped;
        const Outcome whole = outcome_of(graph, request, 1, 8192, true);
        std::optional<Reach> reach;
        if (confined && whole.error.empty())
            reach.emplace(graph, request, box_of_bad_pixels(request));
        const bool hopeless = hostile.demand == Demand::hopeless && !is_shipped;
        const Excuse excused = [&](const std::string& output, std::size_t image, int x, int y) {
            return hopeless || (reach && reach->reaches(output, image, x, y));
        };
        EXPECT_EQ(complaint(whole.report, hostile.demand, excused, exempt), "");
        const auto hold_same = [&](int threads, int tile, bool skip) {
            const Outcome other = outcome_of(graph, request, threads, tile, skip);
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
    hold(graph, true, hostile_cases(side()));
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

std::vector<std::string> graphs_with_deep_input()
{
    std::vector<std::string> files = shipped_graphs();
    std::erase_if(files, [](const std::string& file) {
        const Graph graph = read_graph(file);
        return std::ranges::none_of(graph.inputs,
                                    [](const GraphInput& i) { return i.kind == PortKind::deep; });
    });
    return files;
}

/// The cases as a graph takes them that has its samples from deep pixels: without the lists that
/// are another way to give them, and going on where a pixel has one sample or none.
std::vector<HostileCase> by_deep_pixels(std::vector<HostileCase> cases)
{
    for (HostileCase& hostile : cases)
        hostile.request = [request = hostile.request](const Graph& graph) {
            RunRequest deep = request(graph);
            for (const GraphInput& input : graph.inputs)
                if (input.kind == PortKind::list && !input.required) deep.inputs.erase(input.name);
            if (graph.param("too_few")) deep.params["too_few"] = std::string("neighbours");
            return deep;
        };
    return cases;
}

class HostileDeepPixelsInAGraph : public ::testing::TestWithParam<std::string>
{
};

TEST_P(HostileDeepPixelsInAGraph, GiveAFinitePictureOrATypedError)
{
    Graph graph = read_graph(GetParam());
    // Made up input has what is required, and here the deep image is.
    for (GraphInput& input : graph.inputs)
        if (input.kind == PortKind::deep) input.required = true;
    const Region window{0, 0, side(), side() - 6};
    const HostileCase plain{"", Demand::finite,
                            [=](const Graph& g) { return made_up_request(g, window); }};
    const RunRequest request = by_deep_pixels({plain}).front().request(graph);
    ASSERT_EQ(outcome_of(graph, request, 1, 0, true).error, "") << "nothing would be tried";
    hold(graph, true, by_deep_pixels(deep_cases(side())));
    hold(graph, true, by_deep_pixels(hostile_cases(side())));
}

INSTANTIATE_TEST_SUITE_P(Shipped, HostileDeepPixelsInAGraph,
                         ::testing::ValuesIn(graphs_with_deep_input()), test_name);

INSTANTIATE_TEST_SUITE_P(Shipped, HostileGraph, ::testing::ValuesIn(shipped_graphs()), test_name);

} // namespace
} // namespace rayloom::test
