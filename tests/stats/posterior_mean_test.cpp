// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/posterior_mean.h"

#include "tests/oracle/posterior_mean.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace rayloom
{
namespace
{

TEST(PosteriorMean, TableAndQuadratureFollowTheOracle)
{
    std::mt19937 random(7);
    for (const double ratio : {0.05, 1.0, 20.0})
        for (const double signal_p : {0.3, 0.6, 1.0, 2.0, 4.0})
            for (const double noise_p : {0.3, 0.6, 1.0, 2.0, 4.0}) {
                const double s_n = 0.19;
                const GeneralisedLaplacian signal{ratio * s_n, signal_p}, noise{s_n, noise_p};
                const PosteriorMeanTable table(signal, noise, 100.0 * s_n);
                std::uniform_real_distribution<double> power(-5.0, 2.0);
                for (int i = 0; i < 2; ++i) {
                    const auto y = static_cast<float>(i == 0 ? 100.0 * s_n
                                                             : s_n * std::pow(10.0, power(random)));
                    const double expected =
                        oracle::posterior_mean(y, signal.s, signal_p, s_n, noise_p);
                    EXPECT_NEAR(posterior_mean(y, signal, noise), expected, 1e-5 * s_n)
                        << "s_c/s_n " << ratio << ", p_c " << signal_p << ", p_n " << noise_p
                        << ", y/s_n " << y / s_n;
                    EXPECT_NEAR(table(y), expected, 1e-4 * s_n)
                        << "s_c/s_n " << ratio << ", p_c " << signal_p << ", p_n " << noise_p
                        << ", y/s_n " << y / s_n;
                }
            }
}

TEST(PosteriorMean, TableFollowsTheQuadratureEverywhere)
{
    std::mt19937 random(8);
    for (const double ratio : {0.3, 3.0})
        for (const double signal_p : {0.3, 1.0, 1.5})
            for (const double noise_p : {0.3, 0.7, 1.5, 4.0}) {
                const GeneralisedLaplacian signal{ratio, signal_p}, noise{1.0, noise_p};
                const PosteriorMeanTable table(signal, noise, 100.0);
                std::uniform_real_distribution<double> power(-5.0, 2.0);
                for (int i = 0; i < 300; ++i) {
                    const auto y = static_cast<float>(std::pow(10.0, power(random)));
                    ASSERT_NEAR(table(y), posterior_mean(y, signal, noise), 1e-4)
                        << "s_c/s_n " << ratio << ", p_c " << signal_p << ", p_n " << noise_p
                        << ", y/s_n " << y;
                }
            }
}

TEST(PosteriorMean, GaussianSignalAndNoiseGiveTheWienerFactor)
{
    for (const double ratio : {0.1, 0.7, 5.0}) {
        const GeneralisedLaplacian signal{0.3 * ratio, 2.0}, noise{0.3, 2.0};
        const double factor = signal.variance() / (signal.variance() + noise.variance());
        const PosteriorMeanTable table(signal, noise, 30.0);
        for (const float y : {1e-6f, 1e-3f, 0.1f, 0.3f, 1.7f, 29.0f}) {
            EXPECT_NEAR(table(y) / y, factor, 1e-5) << y;
            EXPECT_NEAR(posterior_mean(y, signal, noise) / y, factor, 1e-6) << y;
        }
    }
}

TEST(PosteriorMean, IsOddAndNeverGrowsAndRisesWhereNoiseIsLogConcave)
{
    for (const double signal_p : {0.3, 0.7, 1.0, 2.0})
        for (const double noise_p : {0.4, 1.0, 1.5, 2.0}) {
            const PosteriorMeanTable table({0.8, signal_p}, {0.5, noise_p}, 20.0);
            float before = 0.0f;
            for (float y = 1e-6f; y < 60.0f; y *= 1.003f) { // beyond the table, too
                const float c = table(y);
                ASSERT_EQ(table(-y), -c) << y;
                ASSERT_LE(c, y) << y;
                ASSERT_GE(c, 0.0f) << y;
                if (noise_p >= 1.0) {
                    ASSERT_GE(c, before) << "p_c " << signal_p << " p_n " << noise_p << " y " << y;
                }
                before = c * (1.0f - 2e-7f);
            }
            EXPECT_EQ(table(0.0f), 0.0f);
        }
}

TEST(PosteriorMean, NoiseWithLongTailsExplainsOutliersAway)
{
    // What an estimator cannot be: rising for every shape.
    const GeneralisedLaplacian signal{1.0, 2.0}, noise{1.0, 0.4};
    EXPECT_LT(posterior_mean(30.0, signal, noise), posterior_mean(2.0, signal, noise));
}

TEST(PosteriorMean, WithoutNoiseOrSignal)
{
    EXPECT_TRUE(PosteriorMeanTable({1.0, 1.0}, {0.0, 2.0}, 5.0).identity());
    EXPECT_TRUE(PosteriorMeanTable({0.0, 1.0}, {0.3, 2.0}, 5.0).zero());
    const PosteriorMeanTable faint({1.0, 0.7}, {1e-7, 1.5}, 5.0);
    for (const float y : {1e-4f, 0.5f, -4.9f}) EXPECT_NEAR(faint(y), y, 1e-6f);
    EXPECT_EQ(posterior_mean(0.7, {1.0, 1.0}, {0.0, 2.0}), 0.7);
    EXPECT_EQ(posterior_mean(0.7, {0.0, 1.0}, {0.3, 2.0}), 0.0);
}

TEST(PosteriorMeanTable, BeyondItsEndAsMuchIsTakenAsThere)
{
    // Long tails in Gaussian noise: something is taken from every value, the less the larger it is.
    const float greatest = 5.0f;
    const PosteriorMeanTable table({0.4, 0.8}, {0.5, 2.0}, greatest);
    // The table ends where the octave's next sample is, a little above `greatest`.
    const float loss = 100.0f - table(100.0f);
    EXPECT_LT(loss, greatest - table(greatest));
    EXPECT_GT(loss, 0.8f * (greatest - table(greatest)));
    for (const float y : {8.0f, 20.0f, 1000.0f})
        for (const float sign : {1.0f, -1.0f})
            EXPECT_NEAR(sign * table(sign * y), y - loss, 1e-6f * (y + 100.0f)) << y;
}

TEST(PosteriorMeanTable, WhatIsNoNumberStaysOutOfTheTable)
{
    const PosteriorMeanTable table({0.4, 0.8}, {0.19, 1.5}, 5.0);
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const float infinity = std::numeric_limits<float>::infinity();
    EXPECT_TRUE(std::isnan(table(nan)));
    EXPECT_EQ(table(infinity), infinity);
    EXPECT_EQ(table(-infinity), -infinity);
    EXPECT_TRUE(std::isfinite(table(std::numeric_limits<float>::max())));
}

TEST(SignalFit, RecoversSignalBeneathNoise)
{
    std::mt19937_64 random(3);
    const auto draw = [&](const GeneralisedLaplacian& d) {
        std::gamma_distribution<double> gamma(1.0 / d.p, 1.0);
        const double x = d.s * std::pow(gamma(random), 1.0 / d.p);
        return random() % 2 == 0 ? x : -x;
    };
    const GeneralisedLaplacian signal{0.4, 0.8}, noise{0.19, 1.5};
    double second = 0.0, fourth = 0.0;
    constexpr int n = 1000000;
    for (int i = 0; i < n; ++i) {
        const double y = draw(signal) + draw(noise);
        second += y * y / n;
        fourth += y * y * y * y / n;
    }
    const SignalFit fit = fit_signal(second, fourth, noise);
    EXPECT_EQ(fit.status, SignalStatus::fitted);
    EXPECT_NEAR(fit.density.s, signal.s, 0.02 * signal.s);
    EXPECT_NEAR(fit.density.p, signal.p, 0.02 * signal.p);
}

TEST(SignalFit, MomentsOfTheSumGiveBackTheSignal)
{
    const GeneralisedLaplacian signal{0.7, 0.9};
    for (const GeneralisedLaplacian noise :
         {GeneralisedLaplacian{0.3, 1.5}, GeneralisedLaplacian{2.0, 2.0}}) {
        // E(c + n)² and E(c + n)⁴ of independent c and n without odd moments.
        const double second = signal.variance() + noise.variance();
        const double fourth = signal.fourth_moment() + noise.fourth_moment() +
                              6.0 * signal.variance() * noise.variance();
        const SignalFit fit = fit_signal(second, fourth, noise);
        EXPECT_EQ(fit.status, SignalStatus::fitted);
        EXPECT_NEAR(fit.density.s, signal.s, 1e-6);
        EXPECT_NEAR(fit.density.p, signal.p, 1e-6);
    }
}

TEST(SignalFit, SaysWhatItCouldNotMeet)
{
    const GeneralisedLaplacian noise{0.5, 2.0};
    EXPECT_EQ(fit_signal(0.9 * noise.variance(), 1.0, noise).status, SignalStatus::no_signal);
    EXPECT_EQ(fit_signal(0.9 * noise.variance(), 1.0, noise).density.s, 0.0);
    EXPECT_EQ(fit_signal(1.001 * noise.variance(), 1.0, noise, 0.01).status,
              SignalStatus::no_signal);
    EXPECT_EQ(fit_signal(1.0, 1e9, noise).status, SignalStatus::shape_low);
    const SignalFit flat = fit_signal(1.0, 1e-9, noise);
    EXPECT_EQ(flat.status, SignalStatus::shape_high);
    EXPECT_NEAR(flat.density.variance() + noise.variance(), 1.0, 1e-9);
    EXPECT_EQ(fit_signal(0.0, 0.0, {0.0, 2.0}).status, SignalStatus::no_signal);
}

} // namespace
} // namespace rayloom
