// SPDX-License-Identifier: Apache-2.0
#include "tests/support/log_graphs.h"

#include <gtest/gtest.h>

#include <random>

namespace rayloom::test
{
namespace
{

/// Texture and independent noise; `first` and `second` share the texture alone.
std::shared_ptr<MemoryImage> noisy(unsigned seed, float sigma)
{
    std::mt19937 random(seed);
    std::normal_distribution<float> noise(0.0f, sigma);
    return image_of({0, 0, 300, 240}, {"R", "G"}, [&](int c, int x, int y) {
        return std::sin(0.05f * static_cast<float>(x + 2 * y)) +
               static_cast<float>((x / 40 + y / 40 + c) % 2) + noise(random);
    });
}

std::vector<Table> tables_of(const std::string& nodes, const std::string& inputs,
                             std::map<std::string, std::shared_ptr<const MemoryImage>> images)
{
    RunReport report;
    run_text("rayloom: 1\nname: test\ninputs:\n" + inputs + "nodes:\n" + nodes +
                 "outputs:\n  image: image\n  figures: noise.figures\n",
             std::move(images), {}, {}, &report);
    return report.tables.at("figures");
}

TEST(FitNoise, HalvesShowTheNoiseOfTheirMean)
{
    // Each half has deviation 0.4, the mean of both 0.4/√2; the texture drops out.
    const auto a = noisy(1, 0.4f), b = noisy(2, 0.4f);
    const auto figures =
        tables_of("  bands: {op: multiscale.steerable, image: image}\n"
                  "  difference: {op: oiio.sub, image: a, other: b}\n"
                  "  half: {op: oiio.mul, image: difference, value: [0.5]}\n"
                  "  noise: {op: fit.noise, band: bands, difference: half, excess: 0,\n"
                  "          least_shape: 0.3}\n",
                  "  image: any\n  a: any\n  b: any\n", {{"image", a}, {"a", a}, {"b", b}});
    ASSERT_EQ(figures.size(), 14u);
    for (std::size_t i = 0; i < 13; ++i) {
        const double gain = i == 0 ? std::sqrt(41.0 / 64.0) : i % 2 == 1 ? std::sqrt(0.125) : 0.25;
        for (std::size_t c = 0; c < 2; ++c) {
            EXPECT_NEAR(figures[i].number("deviation", c), gain * 0.4 / std::sqrt(2.0),
                        gain * 0.4 * (i < 9 ? 0.05 : 0.12))
                << i;
            EXPECT_NEAR(figures[i].number("p_n", c), 2.0, i < 5 ? 0.15 : 0.8) << i;
        }
    }
    EXPECT_EQ(figures[13].number("s_n", 0), 0.0);
}

TEST(FitNoise, TheHighPassOfOneImageWillDo)
{
    const auto image = noisy(3, 0.4f);
    const auto figures = tables_of("  bands: {op: multiscale.steerable, image: image, levels: 2}\n"
                                   "  high: {op: fit.noise, band: 'bands[0]', excess: 0}\n"
                                   "  noise: {op: fit.noise, band: bands, high: high.figures,\n"
                                   "          growth: 0}\n",
                                   "  image: any\n", {{"image", image}});
    for (std::size_t i = 0; i < 9; ++i) {
        const double gain = i == 0 ? std::sqrt(41.0 / 64.0) : i % 2 == 1 ? std::sqrt(0.125) : 0.25;
        // The edges of the texture add a little.
        EXPECT_NEAR(figures[i].number("deviation", 1), gain * 0.4, gain * 0.4 * 0.15) << i;
    }
}

TEST(FitNoise, WhatIsNotFiniteIsNotCounted)
{
    const auto figures = [](float hole) {
        const auto band = image_of({0, 0, 45, 37}, {"high.Y"}, [=](int, int x, int y) {
            return (x + y) % 3 != 0 ? hole : static_cast<float>((x * 37 + y * 11) % 64) - 31.5f;
        });
        return tables_of("  noise: {op: fit.noise, band: image}\n", "  image: any\n",
                         {{"image", band}});
    };
    EXPECT_GT(figures(0.0f).front().number("deviation"), 1.0);
    for (const float hole : {NAN, INFINITY, -INFINITY})
        EXPECT_EQ(figures(hole), figures(0.0f)) << hole;
}

TEST(FitNoise, EachChannelsHighPassStandsForItsOwnBands)
{
    std::mt19937 random(7);
    std::normal_distribution<float> noise(0.0f, 0.1f);
    const auto image = image_of({0, 0, 300, 240}, {"R", "G"}, [&](int c, int, int) {
        return static_cast<float>(1 + 3 * c) * noise(random);
    });
    const auto figures = tables_of("  bands: {op: multiscale.steerable, image: image, levels: 2}\n"
                                   "  high: {op: fit.noise, band: 'bands[0]', excess: 0}\n"
                                   "  noise: {op: fit.noise, band: bands, high: high.figures,\n"
                                   "          growth: 0}\n",
                                   "  image: any\n", {{"image", image}});
    for (std::size_t i = 0; i < 9; ++i)
        EXPECT_NEAR(figures[i].number("s_n", 1), 4.0 * figures[i].number("s_n", 0),
                    0.1 * figures[i].number("s_n", 0))
            << i;
}

TEST(FitNoise, EdgesOfACleanImageAreNotNoise)
{
    // Smooth but for edges: the high-pass is large along them and next to nothing elsewhere.
    const auto clean = image_of({0, 0, 300, 240}, {"R"}, [](int, int x, int y) {
        return std::sin(0.02f * static_cast<float>(x)) +
               static_cast<float>((x / 40 + (x + 2 * y) / 60) % 2);
    });
    const auto figures = tables_of("  bands: {op: multiscale.steerable, image: image}\n"
                                   "  high: {op: fit.noise, band: 'bands[0]'}\n"
                                   "  noise: {op: fit.noise, band: bands, high: high.figures}\n",
                                   "  image: any\n", {{"image", clean}});
    for (std::size_t i = 0; i < 13; ++i) EXPECT_LT(figures[i].number("deviation"), 0.002) << i;
}

TEST(FitNoise, MarginGrowthAndLeastShape)
{
    // A tenth of the pixels is much noisier than the rest: long tails, though no pixel has them.
    std::mt19937 random(6);
    std::normal_distribution<float> noise(0.0f, 1.0f);
    const auto image = image_of({0, 0, 200, 200}, {"R"}, [&](int, int x, int) {
        return x < 50 ? 0.0f : noise(random) * (x < 65 ? 1.0f : 0.1f);
    });
    const auto run = [&](const std::string& high, const std::string& bands) {
        return tables_of("  bands: {op: multiscale.steerable, image: image}\n"
                         "  high: {op: fit.noise, band: 'bands[0]'" +
                             high +
                             "}\n"
                             "  noise: {op: fit.noise, band: bands, high: high.figures" +
                             bands + "}\n",
                         "  image: any\n", {{"image", image}});
    };
    const auto plain = run(", excess: 0, least_shape: 0.3", ", growth: 0"),
               least = run(", excess: 0", ", growth: 0"),
               all = run(", excess: 0, margin: 1.5, least_shape: 0.3", ", growth: 0.25");
    // The black quarter is not counted.
    EXPECT_NEAR(plain[0].number("deviation"), 0.8 * std::sqrt((15.0 + 135.0 * 0.01) / 150.0), 0.02);
    EXPECT_LT(plain[0].number("p_n"), 1.0);
    EXPECT_GT(plain[0].number("kurtosis"), 10.0);
    EXPECT_EQ(least[0].number("p_n"), 2.0);
    EXPECT_NEAR(least[5].number("deviation"), plain[5].number("deviation"), 1e-9);
    const auto stronger = run(", excess: 2, least_shape: 0.3", ", growth: 0");
    const double variance = std::pow(plain[0].number("deviation"), 2.0) / (41.0 / 64.0);
    EXPECT_NEAR(stronger[3].number("deviation"),
                (1.0 + 2.0 * variance) * plain[3].number("deviation"), 1e-9);
    for (const std::size_t i : {0u, 1u, 6u, 12u}) {
        const int level = i == 0 ? 0 : static_cast<int>((i - 1) / 4) + 1;
        EXPECT_NEAR(all[i].number("deviation"),
                    1.5 * std::sqrt(1.0 + 0.25 * std::pow(4.0, level)) *
                        plain[i].number("deviation"),
                    1e-9);
    }
}

TEST(FitNoise, GivenFiguresAreDoubledInTheHighPass)
{
    const auto image = noisy(4, 0.1f);
    const auto figures =
        tables_of("  bands: {op: multiscale.steerable, image: image, levels: 1}\n"
                  "  noise: {op: fit.noise, band: bands, noise: given, s: 0.25, p: 1.25}\n",
                  "  image: any\n", {{"image", image}});
    EXPECT_EQ(figures[0].number("s_n", 0), 0.5);
    EXPECT_EQ(figures[1].number("s_n", 1), 0.25);
    EXPECT_EQ(figures[1].number("p_n", 1), 1.25);
}

TEST(FitNoise, NothingToMeasureByIsAnError)
{
    const auto image = noisy(5, 0.1f);
    EXPECT_THROW(tables_of("  bands: {op: multiscale.steerable, image: image}\n"
                           "  noise: {op: fit.noise, band: bands}\n",
                           "  image: any\n", {{"image", image}}),
                 GraphError);
    EXPECT_THROW(tables_of("  bands: {op: multiscale.steerable, image: image}\n"
                           "  other: {op: oiio.crop, image: image, width: 200, height: 200}\n"
                           "  noise: {op: fit.noise, band: 'bands[5]', difference: other}\n",
                           "  image: any\n", {{"image", image}}),
                 GraphError);
    EXPECT_THROW(tables_of("  bands: {op: multiscale.steerable, image: image}\n"
                           "  noise: {op: fit.noise, band: 'bands[1]'}\n",
                           "  image: any\n", {{"image", image}}),
                 GraphError);
}

} // namespace
} // namespace rayloom::test
