// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/generalised_laplacian.h"
#include "tests/support/log_graphs.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace rayloom::test
{
namespace
{

/// A "high-pass" of independent draws of c + n, made without any filter.
std::shared_ptr<MemoryImage> draws(const GeneralisedLaplacian& c, const GeneralisedLaplacian& n)
{
    std::mt19937_64 random(11);
    const auto draw = [&](const GeneralisedLaplacian& d) {
        if (d.s == 0.0) return 0.0;
        std::gamma_distribution<double> gamma(1.0 / d.p, 1.0);
        const double x = d.s * std::pow(gamma(random), 1.0 / d.p);
        return random() % 2 == 0 ? x : -x;
    };
    return image_of({0, 0, 1000, 1000}, {"high.Y"},
                    [&](int, int, int) { return static_cast<float>(draw(c) + draw(n)); });
}

Table fit(const std::shared_ptr<MemoryImage>& band, const std::string& noise)
{
    RunReport report;
    run_text(graph_of((noise.empty() ? std::string()
                                     : "  noise: {op: fit.noise, band: image, noise: given, " +
                                           noise + "}\n") +
                          "  fit: {op: fit.laplacian, band: image" +
                          (noise.empty() ? "" : ", noise: noise.figures") + "}\n",
                      "image", "  figures: fit.figures\n"),
             {{"image", band}}, {}, {}, &report);
    return report.tables.at("figures").front();
}

TEST(FitLaplacian, RecoversScaleAndShapeFromAMillionDraws)
{
    const Table alone = fit(draws({0.7, 0.9}, {0.0, 2.0}), "");
    EXPECT_NEAR(alone.number("s_c"), 0.7, 0.014);
    EXPECT_NEAR(alone.number("p_c"), 0.9, 0.018);
    // Noise of the high-pass is 2s.
    const Table beneath = fit(draws({0.7, 0.9}, {0.3, 1.5}), "s: 0.15, p: 1.5");
    EXPECT_NEAR(beneath.number("s_c"), 0.7, 0.02);
    EXPECT_NEAR(beneath.number("p_c"), 0.9, 0.025);
    EXPECT_EQ(std::get<std::string>(beneath.rows[0].back()), "fitted");
}

TEST(FitLaplacian, ABandOfNoiseHasNoSignal)
{
    const Table table = fit(draws({0.0, 2.0}, {0.3, 1.5}), "s: 0.15, p: 1.5");
    EXPECT_EQ(table.number("s_c"), 0.0);
    EXPECT_EQ(std::get<std::string>(table.rows[0].back()), "all noise");
}

TEST(FitLaplacian, AConstantBandIsFitted)
{
    const auto band = image_of({0, 0, 9, 9}, {"high.Y"}, [](int, int, int) { return 0.0f; });
    EXPECT_EQ(fit(band, "s: 0.1").number("s_c"), 0.0);
    EXPECT_EQ(fit(band, "").number("s_c"), 0.0);
}

/// A band with holes of this value where x + y is divisible by 7.
std::shared_ptr<MemoryImage> with_holes(float hole)
{
    return image_of({0, 0, 45, 37}, {"high.Y"}, [=](int, int x, int y) {
        return (x + y) % 7 == 0 ? hole : static_cast<float>((x * 37 + y * 11) % 64) - 31.5f;
    });
}

TEST(FitLaplacian, WhatIsNotFiniteIsNotCounted)
{
    const Table expected = fit(with_holes(0.0f), "");
    for (const float hole : {NAN, INFINITY, -INFINITY})
        EXPECT_EQ(fit(with_holes(hole), ""), expected) << hole;
}

TEST(FitLaplacian, EveryPixelCountsWhateverTheWidth)
{
    for (const int width : {1, 7, 8, 13, 17}) {
        const auto value = [](int x, int y) { return 0.5f + static_cast<float>(x * x + 3 * y); };
        const auto band =
            image_of({0, 0, width, 5}, {"high.Y"}, [&](int, int x, int y) { return value(x, y); });
        double second = 0.0, fourth = 0.0;
        for (int y = 0; y < 5; ++y)
            for (int x = 0; x < width; ++x) {
                second += std::pow(value(x, y), 2.0) / (5 * width);
                fourth += std::pow(value(x, y), 4.0) / (5 * width);
            }
        const Table table = fit(band, "");
        EXPECT_NEAR(table.number("deviation"), std::sqrt(second), 1e-12 * std::sqrt(second));
        EXPECT_NEAR(table.number("kurtosis"), fourth / (second * second), 1e-12);
        EXPECT_EQ(table.number("greatest"), value(width - 1, 4));
    }
}

TEST(FitLaplacian, EachChannelIsMeasuredOverTheImageAlone)
{
    // Coarse bands reach beyond the image; what is there was made up by the border.
    std::mt19937 random(2);
    std::normal_distribution<float> noise(0.0f, 1.0f);
    const Region window{-3, 4, 61, 57};
    const auto image = image_of(window, {"R", "G"}, [&](int c, int x, int) {
        return static_cast<float>(c + 1) * (noise(random) + 0.1f * static_cast<float>(x));
    });
    RunReport report;
    const MemoryImage band =
        run_text(graph_of("  bands: {op: multiscale.steerable, image: image, levels: 3}\n"
                          "  fit: {op: fit.laplacian, band: bands}\n",
                          "'bands[9]'", "  figures: 'fit.figures[9]'\n"),
                 {{"image", image}}, {}, {}, &report);
    const Table figures = report.tables.at("figures").front();
    ASSERT_NE(band.desc.data, window);
    for (int c = 0; c < 2; ++c) {
        // Exact zeros (here the column on the mirror) are no evidence.
        double sum = 0.0, count = 0.0;
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x) {
                const float v = band.pixels.view().at(c, x, y);
                sum += static_cast<double>(v) * v;
                count += v != 0.0f ? 1.0 : 0.0;
            }
        EXPECT_NEAR(figures.number("deviation", static_cast<std::size_t>(c)),
                    std::sqrt(sum / count), 1e-12);
    }
}

TEST(FitLaplacian, AnImageThatIsNoBandIsRefused)
{
    const auto image = image_of({0, 0, 9, 9}, {"Y"}, [](int, int, int) { return 0.0f; });
    EXPECT_THROW(fit(image, ""), GraphError);
}

} // namespace
} // namespace rayloom::test
