// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/border.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <algorithm>
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

TEST(LocalVariance, ABrightPixelIsSeenAsFarOnEachSide)
{
    const TestImage spike = make_image(
        {0, 0, 41, 41}, {"Y"}, [](int, int x, int y) { return x == 20 && y == 20 ? 1.0f : 0.0f; });
    const auto run = run_node("transform.local_variance", {}, {{"image", {&spike}}});
    const ConstImageView seen = run.image("variance").view();
    EXPECT_GT(seen.at(0, 20, 20), 0.0f);
    for (int d = 1; d <= 20; ++d) {
        EXPECT_EQ(seen.at(0, 20 - d, 20), seen.at(0, 20 + d, 20)) << d;
        EXPECT_EQ(seen.at(0, 20, 20 - d), seen.at(0, 20, 20 + d)) << d;
    }
}

TEST(LocalVariance, FollowsTheDefinitionUpToItsFactor)
{
    // Second differences across and down, the smaller square of both, its mean over what is inside.
    const Region window{0, 0, 17, 13};
    std::mt19937 random(4);
    std::normal_distribution<float> noise(0.0f, 1.0f);
    const TestImage image = make_image(window, {"R", "G", "B"}, [&](int c, int, int) {
        return static_cast<float>(1 + 3 * c) * noise(random);
    });
    const auto run =
        run_node("transform.local_variance", {{"radius", std::int64_t{2}}}, {{"image", {&image}}});
    const auto square = [&](int c, int x, int y) {
        const auto value = [&](int u, int v) {
            return static_cast<double>(
                image.view().at(c, border_index(u, 0, window.x1, Border::mirror),
                                border_index(v, 0, window.y1, Border::mirror)));
        };
        const double h = 2 * value(x, y) - value(x - 1, y) - value(x + 1, y);
        const double v = 2 * value(x, y) - value(x, y - 1) - value(x, y + 1);
        return std::min(h * h, v * v);
    };
    double factor = 0.0;
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < window.y1; ++y)
            for (int x = 0; x < window.x1; ++x) {
                const Region around =
                    Region{x, y, x + 1, y + 1}.grown(Halo::all(2)).intersect(window);
                double sum = 0.0;
                for (int v = around.y0; v < around.y1; ++v)
                    for (int u = around.x0; u < around.x1; ++u) sum += square(c, u, v);
                const double mean = sum / static_cast<double>(around.pixels());
                const double ratio =
                    static_cast<double>(run.image("variance").view().at(c, x, y)) / mean;
                if (factor == 0.0) factor = ratio;
                ASSERT_NEAR(ratio, factor, 1e-5 * factor) << c << " " << x << " " << y;
            }
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

TEST(LocalVariance, ACleanImageHasTheFloorsNoise)
{
    const TestImage image = make_image({0, 0, 40, 40}, {"R", "G", "B"},
                                       [](int c, int x, int) { return static_cast<float>(c * x); });
    const TestImage limit = make_image(image.desc.data, {"R", "G", "B"},
                                       [](int, int x, int) { return x < 20 ? 1.0f : 3.0f; });
    const auto run = run_node("transform.local_variance", {{"floor_factor", 0.25}},
                              {{"image", {&image}}, {"limit", {&limit}}});
    EXPECT_FLOAT_EQ(run.image("variance").view().at(0, 5, 20), 0.25f);
    EXPECT_FLOAT_EQ(run.image("variance").view().at(2, 35, 20), 0.75f);
    // The limit is the stronger one.
    const auto both =
        run_node("transform.local_variance", {{"floor_factor", 0.25}, {"limit_factor", 0.1}},
                 {{"image", {&image}}, {"limit", {&limit}}});
    EXPECT_FLOAT_EQ(both.image("variance").view().at(1, 5, 20), 0.1f);
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
