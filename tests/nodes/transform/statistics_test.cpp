// SPDX-License-Identifier: Apache-2.0
#include "tests/support/sample_stack.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace rayloom
{
namespace
{

using test::deep_of;
using test::NodeRun;
using test::pointers;
using test::random_stack;
using test::run_node;
using test::TestDeep;
using test::TestImage;

TEST(TransformStatistics, FollowTwoPassesInDouble)
{
    const Region data{-2, 3, 31, 20};
    auto stack = random_stack(data, 11, true);
    // Bright pixels with little noise: where E[x²] − E[x]² would be garbage.
    std::mt19937 random(5);
    std::normal_distribution<float> noise(30000.0f, 0.25f);
    for (TestImage& image : stack)
        for (int x = data.x0; x < data.x1; ++x) image.view().at(1, x, 5) = noise(random);
    const TestDeep deep = deep_of(stack);
    const NodeRun a = run_node("transform.statistics", {}, {{"stack", pointers(stack)}});
    test::RunOptions tiles;
    tiles.tile_width = 5;
    tiles.tile_height = 3;
    const NodeRun b = run_node("transform.statistics", {}, {{"deep", {}, &deep}}, tiles);
    EXPECT_EQ(a.image("mean").desc.channels, (std::vector<std::string>{"R", "G", "B", "A"}));
    EXPECT_EQ(a.image("variance").desc.channels, (std::vector<std::string>{"R", "G", "B"}));
    for (const NodeRun* run : {&a, &b})
        for (int c = 0; c < 4; ++c)
            for (int y = data.y0; y < data.y1; ++y)
                for (int x = data.x0; x < data.x1; ++x) {
                    double mean = 0.0, variance = 0.0;
                    for (const TestImage& image : stack) mean += image.view().at(c, x, y) / 11.0;
                    for (const TestImage& image : stack)
                        variance += std::pow(image.view().at(c, x, y) - mean, 2) / 10.0;
                    ASSERT_NEAR(run->image("mean").view().at(c, x, y), mean, 1e-6 * std::abs(mean));
                    if (c < 3) {
                        ASSERT_NEAR(run->image("variance").view().at(c, x, y), variance,
                                    1e-6 * variance);
                    }
                    ASSERT_EQ(run->image("count").view().at(0, x, y), 11.0f);
                }
    ASSERT_EQ(a.plan.constants.size(), 1u);
    EXPECT_EQ(a.plan.constants[0].value, 11.0f);
}

TEST(TransformStatistics, OutputsNobodyWantsAreLeftOut)
{
    const auto stack = random_stack({0, 0, 12, 9}, 4, false);
    const NodeRun all = run_node("transform.statistics", {}, {{"stack", pointers(stack)}});
    for (const char* port : {"mean", "variance", "count"}) {
        test::RunOptions options;
        options.wanted = {port};
        const NodeRun one =
            run_node("transform.statistics", {}, {{"stack", pointers(stack)}}, options);
        EXPECT_EQ(one.outputs.size(), 1u);
        EXPECT_EQ(differing_floats(one.image(port), all.image(port)), 0u);
    }
}

TEST(TransformStatistics, FewSamples)
{
    const auto stack = random_stack({0, 0, 3, 1}, 2, false);
    EXPECT_THROW(run_node("transform.statistics", {}, {{"stack", {&stack[0]}}}), NodeError);
    TestDeep deep;
    deep.desc = stack[0].desc;
    auto row = std::make_shared<DeepRow>();
    row->first = {0, 0, 1, 3}; // none, one and two samples
    row->samples = {{5, 1, 3}, {5, 1, 3}, {5, 1, 3}};
    deep.rows = {row};
    const NodeRun run = run_node("transform.statistics", {}, {{"deep", {}, &deep}});
    const float mean[] = {0, 5, 2}, variance[] = {0, 0, 2};
    for (int x = 0; x < 3; ++x) {
        EXPECT_EQ(run.image("mean").view().at(1, x, 0), mean[x]);
        EXPECT_EQ(run.image("variance").view().at(1, x, 0), variance[x]);
        EXPECT_EQ(run.image("count").view().at(0, x, 0), static_cast<float>(x));
    }
    EXPECT_EQ(run.counted.at("pixels with fewer than two samples"), 2u);
}

} // namespace
} // namespace rayloom
