// SPDX-License-Identifier: Apache-2.0
// What every node and every shipped graph must hold, by being there: the example of each registered
// node and each file in graphs/ is run on made-up input, and its pixels must not depend on tiles,
// threads, crops, shortcuts or the memory budget.
#include "rayloom/core/registry.h"
#include "rayloom/graph/reader.h"
#include "tests/support/engine_nodes_for_tests.h"
#include "tests/support/made_up_deep.h"
#include "tests/support/made_up_input.h"
#include "tests/support/subjects.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace rayloom::test
{
namespace
{

/// All images of all outputs, in order, and all figures.
struct Results {
    std::vector<MemoryImage> images;
    std::vector<MemoryDeep> deep;
    std::map<std::string, std::vector<Table>, std::less<>> tables;
};

Results run_all(const Graph& graph, const RunRequest& request, const RunOptions& options)
{
    RunReport report = run_graph(graph, request, options);
    Results results;
    for (auto& [name, list] : report.images)
        for (MemoryImage& image : list) results.images.push_back(std::move(image));
    for (auto& [name, list] : report.deep)
        for (MemoryDeep& deep : list) results.deep.push_back(std::move(deep));
    results.tables = std::move(report.tables);
    return results;
}

void expect_same(const Results& a, const Results& b, const std::string& what)
{
    ASSERT_EQ(a.images.size(), b.images.size()) << what;
    for (std::size_t i = 0; i < a.images.size(); ++i)
        EXPECT_TRUE(same_bits(a.images[i], b.images[i])) << what << ", image " << i;
    ASSERT_EQ(a.deep.size(), b.deep.size()) << what;
    for (std::size_t i = 0; i < a.deep.size(); ++i)
        EXPECT_TRUE(same_samples(a.deep[i], b.deep[i])) << what << ", deep image " << i;
    EXPECT_EQ(a.tables, b.tables) << what;
}

void expect_finite(const Results& results)
{
    for (const MemoryImage& image : results.images)
        for (int y = image.desc.data.y0; y < image.desc.data.y1; ++y)
            for (int c = 0; c < image.desc.channel_count(); ++c)
                for (const float v : image.pixels.view().row_span(c, y))
                    ASSERT_TRUE(std::isfinite(v)) << "channel " << c << ", row " << y;
    for (const MemoryDeep& deep : results.deep) ASSERT_TRUE(all_finite(deep));
}

void hold_graph(const Graph& graph, const Region& window)
{
    const RunRequest request = made_up_request(graph, window);
    RunOptions plain;
    plain.threads = 1;
    plain.tile = 8192;
    const Results all_expected = run_all(graph, request, plain);
    const std::vector<MemoryImage>& expected = all_expected.images;
    expect_finite(all_expected);
    for (const int threads : {2, 7})
        for (const int tile : {0, 16, 37}) {
            RunOptions options;
            options.threads = threads;
            options.tile = tile;
            expect_same(run_all(graph, request, options), all_expected,
                        std::to_string(threads) + " threads, tile " + std::to_string(tile));
        }
    RunOptions no_skip;
    no_skip.skip = false;
    expect_same(run_all(graph, request, no_skip), all_expected, "no shortcuts");

    // A crop of each output has the pixels of the whole.
    for (std::size_t i = 0; i < expected.size(); ++i) {
        const Region all = expected[i].desc.data;
        const Region roi{all.x0 + all.width() / 3, all.y0 + all.height() / 4,
                         all.x0 + std::max(1, 2 * all.width() / 3) + all.width() / 3,
                         all.y0 + all.height() / 4 + std::max(1, all.height() / 2)};
        if (std::ranges::any_of(
                expected, [&](const MemoryImage& e) { return e.desc.data.intersect(roi).empty(); }))
            continue;
        RunRequest crop = request;
        crop.roi = roi;
        const std::vector<MemoryImage> cropped = run_all(graph, crop, {}).images;
        ASSERT_EQ(cropped.size(), expected.size());
        MemoryImage part;
        part.desc = expected[i].desc;
        part.desc.data = all.intersect(roi);
        part.pixels = ImageBuffer(part.desc.data, part.desc.channel_count());
        copy_pixels(expected[i].pixels.view(), part.pixels.view());
        EXPECT_TRUE(same_bits(cropped[i], part)) << "crop " << roi.text();
    }

    for (std::size_t i = 0; i < all_expected.deep.size(); ++i) {
        const Region all = all_expected.deep[i].desc.data;
        RunRequest crop = request;
        crop.roi = Region{all.x0 + all.width() / 3, all.y0 + all.height() / 4, all.x1, all.y1};
        const Results part = run_all(graph, crop, {});
        ASSERT_EQ(part.deep.size(), all_expected.deep.size());
        EXPECT_TRUE(same_samples(part.deep[i], test::cropped(all_expected.deep[i], *crop.roi)))
            << "crop " << crop.roi->text();
    }

    // The tightest budget the planner accepts.
    RunOptions tight;
    tight.threads = 2;
    const std::size_t comfortable = make_schedule(make_plan(graph, request), tight).peak_bytes;
    for (std::size_t budget = comfortable / 4; budget <= comfortable;
         budget += std::max<std::size_t>(1, comfortable / 4)) {
        tight.memory = budget;
        try {
            expect_same(run_all(graph, request, tight), all_expected,
                        "budget of " + std::to_string(budget));
            break;
        } catch (const MemoryError&) {
        }
    }
}

class EveryNode : public ::testing::TestWithParam<std::string>
{
};

TEST_P(EveryNode, ExampleGivesTheSamePixelsHoweverItIsRun)
{
    const NodeInfo& node = *Registry::instance().find(GetParam());
    ASSERT_FALSE(node.example.empty()) << node.name << " has no example";
    const Graph graph = example_graph(node.name);
    EXPECT_TRUE(std::ranges::any_of(graph.nodes, [&](const GraphNode& n) {
        return n.op == node.name;
    })) << "the example does not use the node";
    if (touches_files(graph)) GTEST_SKIP() << "reads or writes files; tests/nodes/io holds it";
    for (const Region window :
         {Region{0, 0, 101, 83}, Region{-9, 17, 30, 60}, Region{4, 4, 5, 5}}) {
        SCOPED_TRACE(window.text());
        hold_graph(graph, window);
    }
}

std::string test_name(const ::testing::TestParamInfo<std::string>& info)
{
    return as_test_name(info.param);
}

INSTANTIATE_TEST_SUITE_P(Registry, EveryNode, ::testing::ValuesIn(built_in_nodes()), test_name);

class EveryGraph : public ::testing::TestWithParam<std::string>
{
};

TEST_P(EveryGraph, GivesTheSamePixelsHoweverItIsRun)
{
    const Graph graph = read_graph(GetParam());
    for (const Region window : {Region{0, 0, 75, 61}, Region{-7, 12, 33, 45}}) {
        SCOPED_TRACE(window.text());
        hold_graph(graph, window);
    }
}

INSTANTIATE_TEST_SUITE_P(Shipped, EveryGraph, ::testing::ValuesIn(shipped_graphs()), test_name);

} // namespace
} // namespace rayloom::test
