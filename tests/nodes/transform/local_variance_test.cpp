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

TestImage noisy_ramp(double sigma)
{
    std::mt19937 random(3);
    std::normal_distribution<double> noise(0.0, sigma);
    return make_image({-7, 5, 193, 205}, {"R", "G", "B", "A"}, [&](int c, int x, int y) {
        return static_cast<float>((c + 1) * 0.3 * x - 0.2 * y + noise(random));
    });
}

double mean_of(const TestImage& image, int channel)
{
    double sum = 0.0;
    for (int y = image.desc.data.y0; y < image.desc.data.y1; ++y)
        for (const float v : image.view().row_span(channel, y)) sum += static_cast<double>(v);
    return sum / static_cast<double>(image.desc.data.pixels());
}

TEST(LocalVariance, IsUnbiasedForNormalNoiseOnARamp)
{
    const TestImage image = noisy_ramp(0.5);
    const auto run = run_node("transform.local_variance", {}, {{"image", {&image}}});
    ASSERT_EQ(run.image("variance").desc.channels, (std::vector<std::string>{"R", "G", "B"}));
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(mean_of(run.image("variance"), c), 0.25, 0.01);
}

TEST(LocalVariance, EdgesInOneDirectionAreNotNoise)
{
    const TestImage edge =
        make_image({0, 0, 40, 40}, {"Y"}, [](int, int x, int) { return x < 20 ? 0.0f : 100.0f; });
    const auto run = run_node("transform.local_variance", {}, {{"image", {&edge}}});
    EXPECT_EQ(mean_of(run.image("variance"), 0), 0.0);
}

TEST(LocalVariance, TheLimitHolds)
{
    const TestImage image = noisy_ramp(0.5);
    const TestImage limit = make_image(image.desc.data, {"R", "G", "B"},
                                       [](int c, int, int) { return c == 0 ? 0.01f : 10.0f; });
    const auto run =
        run_node("transform.local_variance", {}, {{"image", {&image}}, {"limit", {&limit}}});
    const auto free = run_node("transform.local_variance", {}, {{"image", {&image}}});
    EXPECT_NEAR(mean_of(run.image("variance"), 0), 0.01, 1e-6);
    EXPECT_EQ(mean_of(run.image("variance"), 1), mean_of(free.image("variance"), 1));
}

TEST(LocalVariance, TilesChangeNoBit)
{
    const TestImage image = noisy_ramp(1.0);
    test::RunOptions tiles;
    tiles.tile_width = 33;
    tiles.tile_height = 21;
    EXPECT_EQ(test::differing_floats(
                  run_node("transform.local_variance", {}, {{"image", {&image}}}).image("variance"),
                  run_node("transform.local_variance", {}, {{"image", {&image}}}, tiles)
                      .image("variance")),
              0u);
}

} // namespace
} // namespace rayloom
