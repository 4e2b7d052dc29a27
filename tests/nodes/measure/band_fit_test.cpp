// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/generalised_laplacian.h"
#include "tests/support/log_graphs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace rayloom::test
{
namespace
{

RunReport measure(const std::shared_ptr<MemoryImage>& band, const std::string& options)
{
    RunReport report;
    run_text(graph_of("  fit: {op: fit.laplacian, band: image}\n"
                      "  error: {op: measure.band_fit, band: image, fit: fit.figures" +
                          options + "}\n",
                      "image", "  table: error.figures\n  histogram: error.histogram\n"),
             {{"image", band}}, {}, {}, &report);
    return report;
}

TEST(BandFit, IsSmallForTheRightDistributionAndLargeForAnother)
{
    std::mt19937_64 random(2);
    std::gamma_distribution<double> gamma(1.0 / 0.8, 1.0);
    const auto right = image_of({0, 0, 600, 500}, {"high.Y"}, [&](int, int, int) {
        const double x = std::pow(gamma(random), 1.0 / 0.8);
        return static_cast<float>(random() % 2 == 0 ? x : -x);
    });
    std::uniform_real_distribution<float> even(-1.0f, 1.0f);
    const auto wrong = image_of({0, 0, 600, 500}, {"high.Y"}, [&](int, int x, int) {
        return even(random) + (x % 2 == 0 ? 2.0f : -2.0f);
    });
    const double small = measure(right, "").tables.at("table").front().number("fitting_error");
    EXPECT_LT(small, 0.1);
    EXPECT_GT(measure(wrong, "").tables.at("table").front().number("fitting_error"), 0.5);
}

TEST(BandFit, HistogramIsADensity)
{
    const auto band = image_of({0, 0, 64, 64}, {"high.Y"}, [](int, int x, int y) {
        return static_cast<float>((x * 37 + y * 11) % 64) - 31.5f;
    });
    const Table rows = measure(band, ", bins: 41, reach: 4").tables.at("histogram").front();
    ASSERT_EQ(rows.rows.size(), 41u);
    const double width = rows.number("x", 1) - rows.number("x", 0);
    double observed = 0.0, fitted = 0.0, error = 0.0;
    for (std::size_t i = 0; i < 41; ++i) {
        const double o = rows.number("observed", i), f = rows.number("fitted", i);
        observed += width * o;
        fitted += width * f;
        error += (o - f) * (o - f) / (f * f) / 41.0;
    }
    EXPECT_NEAR(observed, 1.0, 1e-9);
    EXPECT_NEAR(fitted, 1.0, 0.01);
    EXPECT_NEAR(
        measure(band, ", bins: 41, reach: 4").tables.at("table").front().number("fitting_error"),
        std::sqrt(error), 1e-12);
}

TEST(BandFit, WhatIsNotFiniteIsNotCounted)
{
    const auto tables = [](float hole) {
        return measure(image_of({0, 0, 45, 37}, {"high.Y"},
                                [=](int, int x, int y) {
                                    return (x + y) % 7 == 0
                                               ? hole
                                               : static_cast<float>((x * 37 + y * 11) % 64) - 31.5f;
                                }),
                       ", bins: 41")
            .tables;
    };
    for (const float hole : {NAN, INFINITY, -INFINITY})
        EXPECT_EQ(tables(hole), tables(0.0f)) << hole;
}

TEST(BandFit, BinsFarBeyondTheBandAreEmptyAndCountAsMissed)
{
    const auto band = image_of({0, 0, 64, 64}, {"high.Y"}, [](int, int x, int y) {
        return static_cast<float>((x * 37 + y * 11) % 64) - 31.5f;
    });
    // Nearly all of 10001 bins lie where neither the band nor a double of the distribution reaches.
    const RunReport report = measure(band, ", bins: 10001, reach: 100");
    EXPECT_NEAR(report.tables.at("table").front().number("fitting_error"), 1.0, 0.2);
}

TEST(BandFit, CountsEachChannelBinByBin)
{
    // Skewed, of unlike widths, and with values beyond a short reach, which count as values all the
    // same.
    std::mt19937 random(5);
    std::exponential_distribution<float> skewed(1.0f);
    const auto band = image_of({0, 0, 90, 80}, {"high.R", "high.G"}, [&](int c, int, int) {
        return static_cast<float>(1 + 4 * c) * (skewed(random) - 0.4f);
    });
    const RunReport report = measure(band, ", bins: 9, reach: 1.5");
    const Table rows = report.tables.at("histogram").front();
    ASSERT_EQ(rows.rows.size(), 18u);
    for (std::size_t c = 0; c < 2; ++c) {
        double squares = 0.0;
        std::vector<double> all;
        for (int y = 0; y < 80; ++y)
            for (const float v : band->pixels.view().row_span(static_cast<int>(c), y)) {
                all.push_back(v);
                squares += static_cast<double>(v) * v;
            }
        const double half = 1.5 * std::sqrt(squares / static_cast<double>(all.size()));
        const Table figures = report.tables.at("table").front();
        const GeneralisedLaplacian density{figures.number("s", c), figures.number("p", c)};
        double error = 0.0;
        for (std::size_t b = 0; b < 9; ++b) {
            const double width = 2.0 * half / 9.0, low = -half + static_cast<double>(b) * width;
            const auto inside =
                std::ranges::count_if(all, [&](double v) { return v >= low && v < low + width; });
            const double observed =
                static_cast<double>(inside) / static_cast<double>(all.size()) / width;
            // The density, by the midpoint rule.
            double fitted = 0.0;
            for (int i = 0; i < 1000; ++i)
                fitted += std::exp(density.log_density(low + (i + 0.5) / 1000.0 * width)) / 1000.0;
            EXPECT_NEAR(rows.number("observed", 9 * c + b), observed, 1e-9) << b;
            EXPECT_NEAR(rows.number("fitted", 9 * c + b), fitted, 1e-3 * fitted) << b;
            EXPECT_NEAR(rows.number("x", 9 * c + b), low + 0.5 * width, 1e-9) << b;
            error += std::pow(observed / fitted - 1.0, 2.0) / 9.0;
        }
        EXPECT_NEAR(figures.number("fitting_error", c), std::sqrt(error), 1e-3);
    }
}

TEST(BandFit, AConstantBandHasNothingToMeasure)
{
    const auto band = image_of({0, 0, 9, 9}, {"high.Y"}, [](int, int, int) { return 0.0f; });
    const RunReport report = measure(band, "");
    EXPECT_EQ(report.tables.at("table").front().number("fitting_error"), 0.0);
    EXPECT_TRUE(report.tables.at("histogram").front().rows.empty());
}

} // namespace
} // namespace rayloom::test
