// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/histogram_fusion.h"
#include "tests/support/sample_stack.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace rayloom
{
namespace
{

using test::deep_of;
using test::make_image;
using test::NodeRun;
using test::pointers;
using test::random_stack;
using test::run_node;
using test::TestDeep;
using test::TestImage;

TEST(TransformHistogram, FollowsTheOracle)
{
    const Region data{-2, 3, 31, 20};
    for (const auto& [bins, gamma, max] :
         {std::tuple{20, 2.2, 2.5}, {7, 1.0, 4.0}, {3, 2.2, 2.5}, {64, 3.0, 1.0}}) {
        const auto stack = random_stack(data, 24, true);
        const NodeRun run = run_node("transform.histogram",
                                     {{"bins", std::int64_t{bins}}, {"gamma", gamma}, {"max", max}},
                                     {{"stack", pointers(stack)}});
        const TestImage& histogram = run.image("histogram");
        ASSERT_EQ(histogram.desc.channel_count(), 3 * bins + 1);
        EXPECT_EQ(histogram.desc.channels.front(), "Bin_0000");
        if (bins == 20) {
            EXPECT_EQ(histogram.desc.channels.back(), "Bin_0060");
        }
        for (int y = data.y0; y < data.y1; ++y)
            for (int x = data.x0; x < data.x1; ++x) {
                std::vector<double> expected(static_cast<std::size_t>(3 * bins + 1), 0.0);
                for (const TestImage& image : stack) {
                    const double colour[] = {image.view().at(0, x, y), image.view().at(1, x, y),
                                             image.view().at(2, x, y)};
                    oracle::add_sample(expected, colour, bins, gamma, max);
                }
                double total = 0.0;
                for (int i = 0; i <= 3 * bins; ++i) {
                    ASSERT_NEAR(histogram.view().at(i, x, y), expected[static_cast<std::size_t>(i)],
                                24 * 1e-5)
                        << i;
                    if (i < 3 * bins) total += histogram.view().at(i, x, y);
                }
                ASSERT_EQ(histogram.view().at(3 * bins, x, y), 24.0f);
                ASSERT_NEAR(total, 72.0, 1e-3);
            }
    }
}

TEST(TransformHistogram, DeepPixelsCountLikeAStack)
{
    const auto stack = random_stack({4, -6, 21, 5}, 9, false);
    const TestDeep deep = deep_of(stack);
    const NodeRun a = run_node("transform.histogram", {}, {{"stack", pointers(stack)}});
    test::RunOptions tiles;
    tiles.tile_width = 5;
    tiles.tile_height = 3;
    const NodeRun b = run_node("transform.histogram", {}, {{"deep", {}, &deep}}, tiles);
    EXPECT_EQ(differing_floats(a.image("histogram"), b.image("histogram")), 0u);
}

TEST(TransformHistogram, SaturatesAndNeverBreaks)
{
    const float inf = std::numeric_limits<float>::infinity();
    const float values[] = {inf,
                            -inf,
                            std::numeric_limits<float>::quiet_NaN(),
                            std::numeric_limits<float>::max(),
                            std::numeric_limits<float>::denorm_min(),
                            0.0f};
    const TestImage image =
        make_image({0, 0, 6, 1}, {"Y"}, [&](int, int x, int) { return values[x]; });
    const NodeRun run = run_node("transform.histogram", {}, {{"stack", {&image}}});
    const auto bin = [&](int i, int x) { return run.image("histogram").view().at(i, x, 0); };
    for (int x = 0; x < 6; ++x) {
        const bool bright = x == 0 || x == 3;
        EXPECT_NEAR(bin(0, x), bright ? 0.0 : 1.0, 1e-6) << x;
        EXPECT_EQ(bin(19, x), bright ? 1.0f : 0.0f) << x;
        EXPECT_EQ(bin(20, x), 1.0f);
    }
}

TEST(TransformHistogram, MistakesAreRefused)
{
    const auto stack = random_stack({0, 0, 4, 4}, 2, false);
    const TestDeep deep = deep_of(stack);
    EXPECT_THROW(run_node("transform.histogram", {}, {}), NodeError);
    EXPECT_THROW(
        run_node("transform.histogram", {}, {{"stack", pointers(stack)}, {"deep", {}, &deep}}),
        NodeError);
    const TestImage larger =
        make_image({0, 0, 5, 4}, {"R", "G", "B"}, [](int, int, int) { return 0.0f; });
    EXPECT_THROW(run_node("transform.histogram", {}, {{"stack", {&stack[0], &larger}}}), NodeError);
    const TestImage grey = make_image({0, 0, 4, 4}, {"Y"}, [](int, int, int) { return 0.0f; });
    EXPECT_THROW(run_node("transform.histogram", {}, {{"stack", {&stack[0], &grey}}}), NodeError);
}

} // namespace
} // namespace rayloom
