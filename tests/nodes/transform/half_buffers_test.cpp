// SPDX-License-Identifier: Apache-2.0
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <random>

namespace rayloom
{
namespace
{

using test::make_image;
using test::run_node;
using test::TestImage;

TestImage half(unsigned seed, const Region& window = {3, -4, 103, 96})
{
    std::mt19937 random(seed);
    std::normal_distribution<float> noise(0.0f, 0.4f);
    return make_image(window, {"R", "G", "B", "A"}, [&](int c, int x, int) {
        return c == 3 ? 1.0f : static_cast<float>(x) + noise(random);
    });
}

TEST(HalfBuffers, MeanAndVarianceOfTheMean)
{
    const TestImage a = half(1), b = half(2);
    const auto run = run_node("transform.half_buffers", {}, {{"a", {&a}}, {"b", {&b}}});
    EXPECT_EQ(run.image("mean").view().at(1, 40, 40),
              0.5f * (a.view().at(1, 40, 40) + b.view().at(1, 40, 40)));
    double sum = 0.0;
    const ConstImageView variance = run.image("variance").view();
    ASSERT_EQ(variance.channels(), 3);
    for (int y = -4; y < 96; ++y)
        for (const float v : variance.row_span(0, y)) sum += static_cast<double>(v);
    EXPECT_NEAR(sum / 10000.0, 0.4 * 0.4 / 2.0, 0.004);
    EXPECT_EQ(run.image("count").view().at(0, 10, 10), 26.0f);
    double expected = 0.0;
    for (int y = -4; y < -1; ++y)
        for (int x = 3; x < 6; ++x) {
            const double e = 0.5 * (static_cast<double>(a.view().at(2, x, y)) -
                                    static_cast<double>(b.view().at(2, x, y)));
            expected += e * e / 9.0;
        }
    EXPECT_NEAR(variance.at(2, 3, -4), expected, 1e-6);
}

TEST(HalfBuffers, TilesChangeNoBit)
{
    const TestImage a = half(1), b = half(2);
    test::RunOptions tiles;
    tiles.tile_width = 17;
    tiles.tile_height = 9;
    EXPECT_EQ(
        test::differing_floats(
            run_node("transform.half_buffers", {}, {{"a", {&a}}, {"b", {&b}}}).image("variance"),
            run_node("transform.half_buffers", {}, {{"a", {&a}}, {"b", {&b}}}, tiles)
                .image("variance")),
        0u);
}

TEST(HalfBuffers, HalvesMustMatch)
{
    const TestImage a = half(1), b = half(2, {3, -4, 103, 95});
    EXPECT_THROW(run_node("transform.half_buffers", {}, {{"a", {&a}}, {"b", {&b}}}), NodeError);
}

} // namespace
} // namespace rayloom
