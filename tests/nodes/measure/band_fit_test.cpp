// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/generalised_laplacian.h"
#include "tests/support/log_graphs.h"

#include <gtest/gtest.h>

#include <random>

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

TEST(BandFit, AConstantBandHasNothingToMeasure)
{
    const auto band = image_of({0, 0, 9, 9}, {"high.Y"}, [](int, int, int) { return 0.0f; });
    const RunReport report = measure(band, "");
    EXPECT_EQ(report.tables.at("table").front().number("fitting_error"), 0.0);
    EXPECT_TRUE(report.tables.at("histogram").front().rows.empty());
}

} // namespace
} // namespace rayloom::test
