// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/window_sums.h"

#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <random>
#include <vector>

namespace rayloom
{
namespace
{

TEST(WindowSums, EveryWindowEveryCutBitForBit)
{
    std::mt19937 random(7);
    std::uniform_real_distribution<float> value(-1.0f, 1.0f);
    for (const int n : {1, 2, 7, 40})
        for (const int radius : {0, 1, 3, 20, 64})
            for (int first = 0; first < n; first += 3)
                for (int count = 1; first + count <= n; count += 2) {
                    std::vector<float> values(static_cast<std::size_t>(n));
                    for (float& v : values) v = value(random) * 1e3f;
                    values[static_cast<std::size_t>(n / 2)] = 1e-3f;
                    std::vector<float> sums(static_cast<std::size_t>(count), -9.0f);
                    window_sums<float>(values, first, radius, sums);
                    for (int i = 0; i < count; ++i) {
                        float expected = 0.0f;
                        for (int j = 0; j < n; ++j)
                            if (j >= first + i - radius && j <= first + i + radius)
                                expected += values[static_cast<std::size_t>(j)];
                        EXPECT_EQ(std::bit_cast<std::uint32_t>(sums[static_cast<std::size_t>(i)]),
                                  std::bit_cast<std::uint32_t>(expected))
                            << n << " " << radius << " " << first << " " << i;
                    }
                }
}

TEST(WindowSums, InfinityStaysInItsWindows)
{
    std::vector<double> values(9, 1.0), sums(9);
    values[4] = std::numeric_limits<double>::infinity();
    window_sums<double>(values, 0, 1, sums);
    EXPECT_EQ(sums[2], 3.0);
    EXPECT_EQ(sums[3], values[4]);
    EXPECT_EQ(sums[6], 3.0);
    EXPECT_EQ(sums[8], 2.0);
}

TEST(WindowMeans, SumsOverThePixelsThereAre)
{
    std::mt19937 random(11);
    std::uniform_real_distribution<double> value(0.0, 1e3);
    for (const int n : {1, 2, 9, 40})
        for (const int radius : {0, 1, 3, 20, 64})
            for (int first = 0; first < n; first += 2) {
                std::vector<double> values(static_cast<std::size_t>(n));
                for (double& v : values) v = value(random);
                const std::size_t count = static_cast<std::size_t>((n - first + 1) / 2);
                std::vector<double> sums(count), means(count);
                window_sums<double>(values, first, radius, sums);
                window_means(values, 3, first, radius, means);
                for (std::size_t i = 0; i < count; ++i) {
                    int pixels = 0;
                    for (int j = 0; j < n; ++j)
                        pixels += 3 * (std::abs(j - first - static_cast<int>(i)) <= radius);
                    EXPECT_EQ(means[i], sums[i] / pixels) << n << " " << radius << " " << first;
                }
            }
}

} // namespace
} // namespace rayloom
