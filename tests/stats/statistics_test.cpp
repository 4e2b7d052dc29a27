// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "rayloom/stats/generalised_laplacian.h"
#include "rayloom/stats/moments.h"
#include "rayloom/stats/quantiles.h"
#include "rayloom/stats/sums.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace rayloom
{
namespace
{

TEST(Moments, MergedPartsEqualTwoPasses)
{
    std::mt19937 random(4);
    std::exponential_distribution<double> value(0.3);
    std::vector<double> samples;
    for (int i = 0; i < 1000; ++i) samples.push_back(1e6 + value(random));
    double mean = 0.0, m2 = 0.0;
    for (const double x : samples) mean += (x - 1e6) / 1000.0;
    mean += 1e6;
    for (const double x : samples) {
        const double d = x - mean;
        m2 += d * d;
    }
    for (const std::size_t cut : {0u, 1u, 500u, 999u, 1000u}) {
        Moments<double> a, b;
        for (std::size_t i = 0; i < samples.size(); ++i) (i < cut ? a : b).add(samples[i]);
        a.merge(b);
        EXPECT_EQ(a.count, 1000);
        EXPECT_NEAR(a.mean, mean, 1e-8);
        EXPECT_NEAR(a.variance(), m2 / 999.0, 1e-8);
        EXPECT_NEAR(a.variance_of_mean(), m2 / 999.0 / 1000.0, 1e-11);
    }
    EXPECT_EQ(Moments<double>{}.variance(), 0.0);
    Moments<double> two;
    two.add(1.0);
    EXPECT_EQ(two.variance(), 0.0);
    two.add(4.0);
    EXPECT_EQ(two.variance(), 4.5);
    EXPECT_EQ(two.variance_of_mean(), 2.25);
}

// A bright pixel with little noise, where the mean of squares minus the square of the mean is lost.
TEST(Moments, SmallNoiseOnABrightPixelSurvivesInFloat)
{
    Moments<float> m;
    for (int i = 0; i < 64; ++i) m.add(10000.0f + (i % 2 == 0 ? 0.125f : -0.125f));
    EXPECT_NEAR(m.variance(), 0.015625f * 64.0f / 63.0f, 2e-4f);
}

TEST(Quantiles, StudentFactorsMatchPrintedTables)
{
    EXPECT_NEAR(student_t_factor(2, 0.05), 12.706, 5e-4);
    EXPECT_NEAR(student_t_factor(16, 0.05), 2.131, 5e-4);
    EXPECT_NEAR(student_t_factor(16, 0.01), 2.947, 5e-4);
    EXPECT_NEAR(student_t_factor(31, 0.002), 3.385, 5e-4);
    EXPECT_NEAR(student_t_factor(1e9, 0.05), 1.95996, 1e-5);
    const StudentTable table(0.01, 64);
    for (const int n : {2, 3, 16, 64}) EXPECT_EQ(table(n), student_t_factor(n, 0.01));
    EXPECT_EQ(table(1000), table(64));
    EXPECT_EQ(table(0), table(2));
    EXPECT_EQ(table.as_floats().size(), 63u);
    EXPECT_EQ(table.as_floats()[14], static_cast<float>(table(16)));
    EXPECT_THROW(student_t_factor(1, 0.05), NodeError);
    EXPECT_THROW(StudentTable(1.0, 8), NodeError);
    EXPECT_THROW(StudentTable(0.1, 1), NodeError);
}

TEST(Quantiles, ChiSquaredAndNormalMatchPrintedTables)
{
    EXPECT_NEAR(chi_squared_quantile(0.95, 1), 3.841, 5e-4);
    EXPECT_NEAR(chi_squared_quantile(0.99, 20), 37.566, 5e-4);
    EXPECT_NEAR(chi_squared_tail(18.307, 10), 0.05, 1e-5);
    EXPECT_EQ(chi_squared_tail(-1.0, 3), 1.0);
    EXPECT_NEAR(normal_quantile(0.975), 1.95996, 1e-5);
    EXPECT_THROW(chi_squared_quantile(0.5, 0), NodeError);
    EXPECT_THROW(normal_quantile(0.0), NodeError);
}

TEST(Quantiles, WelchDegreesLieBetweenTheSmallerAndTheSum)
{
    EXPECT_NEAR(welch_degrees(1, 16, 1, 16), 30.0, 1e-12); // equal: both sets together
    EXPECT_NEAR(welch_degrees(1, 16, 0, 4), 15.0, 1e-12);  // one is exact: the other alone
    EXPECT_NEAR(welch_degrees(0, 16, 1, 4), 3.0, 1e-12);
    // (3 + 1)² / (3²/9 + 1²/4) = 12.8.
    EXPECT_NEAR(welch_degrees(3, 10, 1, 5), 12.8, 1e-12);
    EXPECT_EQ(welch_degrees(0, 16, 0, 4), 3.0);
}

TEST(GeneralisedLaplacian, MomentsOfKnownShapes)
{
    const GeneralisedLaplacian gauss{std::sqrt(2.0) * 3.0, 2.0}, laplace{0.5, 1.0};
    EXPECT_NEAR(gauss.variance(), 9.0, 1e-12);
    EXPECT_NEAR(gauss.fourth_moment(), 3.0 * 81.0, 1e-10);
    EXPECT_NEAR(gauss.log_density(1.5), -0.125 - std::log(3.0 * std::sqrt(2.0 * M_PI)), 1e-12);
    EXPECT_NEAR(laplace.variance(), 0.5, 1e-13);
    EXPECT_NEAR(laplace.fourth_moment(), 24.0 * 0.0625, 1e-12);
    EXPECT_NEAR(generalised_laplacian_kurtosis(2.0), 3.0, 1e-12);
    EXPECT_NEAR(generalised_laplacian_kurtosis(1.0), 6.0, 1e-11);
    EXPECT_NEAR(generalised_laplacian_kurtosis(1e5), 1.8, 1e-4);
}

TEST(GeneralisedLaplacian, FitRecoversScaleAndShape)
{
    for (const double p : {0.3, 0.5, 1.0, 1.5, 2.0, 3.9})
        for (const double s : {1e-4, 0.19, 50.0}) {
            const GeneralisedLaplacian truth{s, p};
            const auto fit = fit_generalised_laplacian(truth.variance(), truth.fourth_moment());
            EXPECT_NEAR(fit.density.p, p, 1e-9 * p);
            EXPECT_NEAR(fit.density.s, s, 1e-7 * s);
        }
    const auto heavy = fit_generalised_laplacian(2.0, 4e6),
               flat = fit_generalised_laplacian(2.0, 4.0);
    EXPECT_TRUE(heavy.clamped && flat.clamped);
    EXPECT_EQ(heavy.density.p, 0.3);
    EXPECT_EQ(flat.density.p, 4.0);
    EXPECT_NEAR(flat.density.variance(), 2.0, 1e-12);
    EXPECT_THROW(fit_generalised_laplacian(0.0, 1.0), NodeError);
}

TEST(GeneralisedLaplacian, FitRecoversFromDraws)
{
    // |x/s|^p of a draw is Gamma(1/p) distributed.
    std::mt19937_64 random(12);
    for (const double p : {0.7, 1.5}) {
        const double s = 0.19;
        std::gamma_distribution<double> gamma(1.0 / p, 1.0);
        constexpr int n = 1000000;
        double second = 0.0, fourth = 0.0;
        for (int i = 0; i < n; ++i) {
            const double square = std::pow(s * std::pow(gamma(random), 1.0 / p), 2);
            second += square / n;
            fourth += square * square / n;
        }
        const auto fit = fit_generalised_laplacian(second, fourth);
        EXPECT_NEAR(fit.density.p, p, 0.02 * p);
        EXPECT_NEAR(fit.density.s, s, 0.02 * s);
    }
}

TEST(Sums, PairwiseKeepsWhatARunningSumLoses)
{
    const std::vector<double> values(1 << 20, 0.1);
    double running = 0.0;
    for (const double v : values) running += v;
    const double exact = 0.1 * static_cast<double>(values.size());
    EXPECT_GT(std::abs(running - exact), 1e-7);
    EXPECT_LT(std::abs(pairwise_sum(values) - exact), 1e-9);
    EXPECT_EQ(pairwise_sum({}), 0.0);
}

TEST(Sums, TreeCombineFoldsEveryRecordOnce)
{
    for (std::size_t count = 1; count < 20; ++count) {
        std::vector<double> records;
        for (std::size_t i = 0; i < count; ++i) {
            records.push_back(static_cast<double>(i + 1));
            records.push_back(static_cast<double>(i));
        }
        tree_combine(records, 2, [](std::span<double> into, std::span<const double> other) {
            into[0] += other[0];
            into[1] = std::max(into[1], other[1]);
        });
        EXPECT_EQ(records[0], static_cast<double>(count * (count + 1) / 2));
        EXPECT_EQ(records[1], static_cast<double>(count - 1));
    }
}

} // namespace
} // namespace rayloom
