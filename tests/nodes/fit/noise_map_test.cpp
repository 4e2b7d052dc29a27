// SPDX-License-Identifier: Apache-2.0
#include "tests/support/log_graphs.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

namespace rayloom::test
{
namespace
{

const Region window{-20, 10, 280, 190};

MemoryImage map_of(const std::function<float(int c, int x, int y, float noise)>& value,
                   const std::string& params = "")
{
    std::mt19937 random(3);
    std::normal_distribution<float> noise(0.0f, 0.3f);
    const auto image = image_of(window, {"R", "G"},
                                [&](int c, int x, int y) { return value(c, x, y, noise(random)); });
    return run_text(graph_of("  bands: {op: multiscale.steerable, image: image, levels: 1}\n"
                             "  map: {op: fit.noise_map, band: 'bands[0]'" +
                                 params + "}\n",
                             "map"),
                    {{"image", image}});
}

/// Over columns [x0, x1).
double mean_of(const MemoryImage& map, int x0, int x1)
{
    double sum = 0.0;
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = x0; x < x1; ++x) sum += map.pixels.view().at(0, x, y);
    return sum / (x1 - x0) / window.height();
}

TEST(FitNoiseMap, FollowsTheStrengthOfTheNoiseWhateverTheChannel)
{
    // The second channel has ten times the noise, and a ramp.
    const MemoryImage map = map_of([](int c, int x, int, float noise) {
        const float size = (x < 130 ? 1.0f : 3.0f) * noise;
        return c == 0 ? size : 10.0f * size + 0.1f * static_cast<float>(x);
    });
    ASSERT_EQ(map.desc.channels, std::vector<std::string>{"strength"});
    EXPECT_EQ(map.desc.data, window);
    const double weak = mean_of(map, -20, 90), strong = mean_of(map, 170, 280);
    EXPECT_NEAR(strong / weak, 3.0, 0.1);
    // (√weak + √strong)/2 = 1.
    EXPECT_NEAR(weak, std::pow(2.0 / (1.0 + std::sqrt(3.0)), 2.0), 0.03);
}

TEST(FitNoiseMap, ALineOfEdgesCountsLittle)
{
    const MemoryImage map =
        map_of([](int, int x, int, float noise) { return noise + (x < 130 ? 0.0f : 100.0f); });
    // A second moment would be more than thirty times as large there.
    EXPECT_LT(mean_of(map, 125, 135) / mean_of(map, -20, 60), 4.0);
    EXPECT_LT(mean_of(map, 160, 280) / mean_of(map, -20, 60), 1.2);
}

TEST(FitNoiseMap, BlackIsNoEvidence)
{
    const MemoryImage map =
        map_of([](int, int x, int, float noise) { return x < 130 ? 0.0f : noise; });
    EXPECT_NEAR(mean_of(map, 140, 170), mean_of(map, 240, 280), 0.1);
    EXPECT_NEAR(mean_of(map, 240, 280), 1.0, 0.1);
    EXPECT_EQ(map.pixels.view().at(0, 0, 100), 0.25f);
}

TEST(FitNoiseMap, WhatIsNotFiniteIsNoEvidence)
{
    const auto value = [](int, int, int, float noise) { return noise; };
    const MemoryImage whole = map_of(value);
    const MemoryImage holed = map_of([](int, int x, int y, float noise) {
        if (x == 130 && y == 100) return std::numeric_limits<float>::quiet_NaN();
        return x == 50 && y == 60 ? std::numeric_limits<float>::infinity() : noise;
    });
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0; x < window.x1; ++x) {
            const float v = whole.pixels.view().at(0, x, y);
            ASSERT_NEAR(holed.pixels.view().at(0, x, y), v, 0.01f * v) << x << "," << y;
        }
    EXPECT_NEAR(mean_of(holed, -20, 280), mean_of(whole, -20, 280), 1e-4);
}

TEST(FitNoiseMap, TheMeanRootIsOneWhateverTheWidth)
{
    // All light at one end of the rows: what is left of a row behind its last whole vector counts.
    for (const int width : {9, 15, 23}) {
        const auto image = image_of({0, 0, width, 64}, {"R"}, [&](int, int x, int y) {
            return (x == width - 1 ? 8.0f : 1.0f) * static_cast<float>((x + y) % 2);
        });
        const MemoryImage map = run_text(
            graph_of("  bands: {op: multiscale.steerable, image: image, levels: 1}\n"
                     "  map: {op: fit.noise_map, band: 'bands[0]', scale: 6, least: 0.001,\n"
                     "        greatest: 1000}\n",
                     "map"),
            {{"image", image}});
        double sum = 0.0;
        for (int y = 0; y < 64; ++y)
            for (int x = 0; x < width; ++x) sum += std::sqrt(map.pixels.view().at(0, x, y));
        EXPECT_NEAR(sum / (64 * width), 1.0, 1e-6) << width;
    }
}

TEST(FitNoiseMap, BlackNearbyTakesNothingFromTheStrength)
{
    const MemoryImage map =
        map_of([](int, int x, int, float noise) { return x < 130 ? 0.0f : noise; });
    EXPECT_NEAR(mean_of(map, 132, 136) / mean_of(map, 240, 280), 1.0, 0.1);
}

TEST(FitNoiseMap, StaysBetweenItsBounds)
{
    const MemoryImage map =
        map_of([](int, int x, int, float noise) { return (x < 200 ? 0.001f : 100.0f) * noise; },
               ", least: 0.5, greatest: 2");
    EXPECT_EQ(map.pixels.view().at(0, 0, 100), 0.5f);
    EXPECT_EQ(map.pixels.view().at(0, 260, 100), 2.0f);
    const MemoryImage flat = map_of([](int, int, int, float) { return 3.0f; });
    EXPECT_EQ(flat.pixels.view().at(0, 0, 100), 0.25f);
}

TEST(FitNoiseMap, WantsTheHighPass)
{
    const auto image = image_of(window, {"R"}, [](int, int x, int) { return float(x % 3); });
    EXPECT_THROW(run_text(graph_of("  bands: {op: multiscale.steerable, image: image}\n"
                                   "  map: {op: fit.noise_map, band: 'bands[1]'}\n",
                                   "map"),
                          {{"image", image}}),
                 GraphError);
}

} // namespace
} // namespace rayloom::test
