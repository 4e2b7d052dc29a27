// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <cmath>

namespace rayloom
{
namespace
{

using test::make_image;
using test::NodeRun;
using test::run_node;
using test::TestImage;

const Region window{0, 0, 20, 12};

const TestImage& blank()
{
    static const TestImage image = make_image(window, {"R"}, [](int, int, int) { return 0.0f; });
    return image;
}

/// Columns of row 6 that are marked.
std::vector<int> marked(const NodeRun& run)
{
    std::vector<int> columns;
    for (int x = 0; x < 20; ++x)
        if (run.image("boundary").view().at(0, x, 6) == 1.0f) columns.push_back(x);
    return columns;
}

TEST(Boundary, PartsBesideTheirBorder)
{
    const TestImage parts = make_image(window, {"id0", "coverage0"}, [](int c, int x, int) {
        return c == 1 ? 1.0f : x < 8 ? 1.0f : 2.0f;
    });
    const std::vector<test::NodeInput> inputs{{"image", {&blank()}}, {"parts", {&parts}}};
    EXPECT_EQ(marked(run_node("threshold.boundary", {}, inputs)), (std::vector<int>{7, 8}));
    EXPECT_EQ(marked(run_node("threshold.boundary", {{"radius", std::int64_t{2}}}, inputs)),
              (std::vector<int>{5, 6, 7, 8, 9, 10}));
}

TEST(Boundary, TilesThatBeginAtABorderSeeIt)
{
    // Squares, so that tiles of any size begin at a border along x, along y or both.
    const TestImage parts = make_image(window, {"id0", "coverage0"}, [](int c, int x, int y) {
        return c == 1 ? 1.0f : static_cast<float>((x + 40) / 4 * 100 + (y + 40) / 4);
    });
    const std::vector<test::NodeInput> inputs{{"image", {&blank()}}, {"parts", {&parts}}};
    const NodeRun whole = run_node("threshold.boundary", {}, inputs);
    for (int y = window.y0 + 1; y < window.y1 - 1; ++y)
        for (int x = window.x0 + 1; x < window.x1 - 1; ++x) {
            const auto beside = [](int v) { return (v + 40) % 4 == 0 || (v + 40) % 4 == 3; };
            ASSERT_EQ(whole.image("boundary").view().at(0, x, y),
                      beside(x) || beside(y) ? 1.0f : 0.0f);
        }
    for (const int size : {1, 3, 4, 5}) {
        test::RunOptions tiles;
        tiles.tile_width = tiles.tile_height = size;
        const NodeRun cut = run_node("threshold.boundary", {}, inputs, tiles);
        EXPECT_EQ(differing_floats(cut.image("boundary"), whole.image("boundary")), 0u) << size;
    }
}

TEST(Boundary, LeapOfDepthButNoSlope)
{
    const TestImage depth = make_image(window, {"Z"}, [](int, int x, int) {
        // A steep floor, then a wall far behind.
        return x < 12 ? 2.0f + 0.5f * static_cast<float>(x) : 30.0f;
    });
    EXPECT_EQ(
        marked(run_node("threshold.boundary", {}, {{"image", {&blank()}}, {"depth", {&depth}}})),
        (std::vector<int>{11, 12}));
    const TestImage sky = make_image(window, {"Z"}, [](int, int x, int) {
        return x < 5 ? 1e10f : x < 9 ? std::nanf("") : 3.0f;
    });
    EXPECT_EQ(
        marked(run_node("threshold.boundary", {}, {{"image", {&blank()}}, {"depth", {&sky}}})),
        (std::vector<int>{8, 9}));
}

TEST(Boundary, NormalsThatTurn)
{
    const TestImage normal = make_image(window, {"X", "Y", "Z"}, [](int c, int x, int) {
        const float angle = x < 10 ? 0.0f : 1.3f;
        if (x >= 15) return 0.0f;
        return c == 0 ? 0.7f * std::sin(angle) : c == 1 ? 0.0f : 0.7f * std::cos(angle);
    });
    EXPECT_EQ(
        marked(run_node("threshold.boundary", {}, {{"image", {&blank()}}, {"normal", {&normal}}})),
        (std::vector<int>{9, 10, 14, 15}));
    EXPECT_EQ(marked(run_node("threshold.boundary", {{"normal_angle", 80.0}},
                              {{"image", {&blank()}}, {"normal", {&normal}}})),
              (std::vector<int>{14, 15}));
}

TEST(Boundary, NothingToGoByIsZero)
{
    const NodeRun run = run_node("threshold.boundary", {}, {{"image", {&blank()}}});
    ASSERT_EQ(run.plan.constants.size(), 1u);
    EXPECT_EQ(run.plan.constants[0].value, 0.0f);
    EXPECT_THROW(
        run_node("threshold.boundary", {}, {{"image", {&blank()}}, {"normal", {&blank()}}}),
        NodeError);
}

} // namespace
} // namespace rayloom
