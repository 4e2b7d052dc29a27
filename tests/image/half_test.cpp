// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/half.h"

#include <OpenImageIO/fmath.h>
#include <OpenImageIO/half.h>

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <vector>

namespace rayloom
{
namespace
{
TEST(Half, EveryHalfBecomesTheSameFloatAsInOpenExr)
{
    std::vector<std::uint16_t> all(65536 + 3);
    std::iota(all.begin(), all.end(), std::uint16_t{0});
    std::vector<float> one_by_one(all.size()), at_once(all.size());
    half_to_float(all.data(), at_once.data(), all.size());
    for (std::size_t i = 0; i < all.size(); ++i) half_to_float(&all[i], &one_by_one[i], 1);
    for (std::size_t i = 0; i < all.size(); ++i) {
        half reference;
        reference.setBits(all[i]);
        const auto a = std::bit_cast<std::uint32_t>(at_once[i]);
        EXPECT_EQ(a, std::bit_cast<std::uint32_t>(one_by_one[i])) << "whatever the run length";
        if (reference.isNan())
            EXPECT_TRUE(std::isnan(at_once[i]));
        else
            EXPECT_EQ(a, std::bit_cast<std::uint32_t>(static_cast<float>(reference))) << i;
    }
}

// Every half and the points between neighbours: where rounding is decided.
TEST(Half, RoundsToTheNearestEven)
{
    std::vector<float> values;
    for (std::uint32_t h = 0; h < 0x7c00u; ++h) {
        const auto bits = static_cast<std::uint16_t>(h);
        float a = 0, b = 65536.0f;
        half_to_float(&bits, &a, 1);
        const auto next = static_cast<std::uint16_t>(h + 1);
        if (h + 1 < 0x7c00u) half_to_float(&next, &b, 1);
        const float middle = 0.5f * (a + b);
        for (const float v :
             {a, middle, std::nextafter(middle, 0.0f), std::nextafter(middle, 1e9f)})
            for (const float s : {1.0f, -1.0f}) values.push_back(s * v);
    }
    values.push_back(std::numeric_limits<float>::denorm_min());
    values.push_back(1e30f);
    std::size_t overflows = 0;
    std::vector<std::uint16_t> at_once(values.size());
    const HalfCounts counts = float_to_half(values.data(), at_once.data(), values.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
        std::uint16_t alone = 0;
        overflows += float_to_half(&values[i], &alone, 1).overflows;
        EXPECT_EQ(at_once[i], alone) << values[i];
        const half reference(values[i]);
        if (reference.isInfinity())
            EXPECT_EQ(at_once[i] & 0x7fff, 0x7bff) << values[i];
        else
            EXPECT_EQ(at_once[i], reference.bits()) << values[i];
    }
    EXPECT_EQ(counts.overflows, overflows);
    EXPECT_EQ(counts.overflows, 5u) << "±65520, just above it, and 1e30";
}

TEST(Half, NonFiniteValuesAreKeptAndCounted)
{
    std::vector<float> values(21, 1.0f);
    values[3] = std::numeric_limits<float>::infinity();
    values[9] = -std::numeric_limits<float>::infinity();
    values[20] = std::numeric_limits<float>::quiet_NaN();
    std::vector<std::uint16_t> halves(values.size());
    const HalfCounts counts = float_to_half(values.data(), halves.data(), values.size());
    EXPECT_EQ(counts.non_finite, 3u);
    EXPECT_EQ(counts.overflows, 0u);
    EXPECT_EQ(halves[3], 0x7c00);
    EXPECT_EQ(halves[9], 0xfc00);
    EXPECT_GT(halves[20] & 0x7fff, 0x7c00);
    EXPECT_EQ(halves[19], 0x3c00);
}

} // namespace
} // namespace rayloom
