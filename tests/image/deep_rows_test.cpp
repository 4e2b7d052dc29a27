// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/deep_rows.h"

#include <gtest/gtest.h>

#include <array>
#include <limits>

namespace rayloom
{
namespace
{

/// Four pixels of 2, 0, 3 and 1 samples in two channels.
DeepRow four_pixels()
{
    DeepRow row;
    row.first = {0, 2, 2, 5, 6};
    row.samples = {{1, 2, 3, 4, 5, 6}, {10, 20, 30, 40, 50, 60}};
    return row;
}

TEST(DeepRows, ColumnsKeepTheirSamples)
{
    const DeepRow part = deep_columns(four_pixels(), 1, 3);
    EXPECT_EQ(part.first, (std::vector<std::uint32_t>{0, 0, 3}));
    ASSERT_EQ(part.samples.size(), 2u);
    EXPECT_EQ(part.samples[0], (std::vector<float>{3, 4, 5}));
    EXPECT_EQ(part.samples[1], (std::vector<float>{30, 40, 50}));
    EXPECT_TRUE(deep_row_fits(part, 2, 2));
    EXPECT_FALSE(deep_row_fits(part, 3, 2));
    EXPECT_FALSE(deep_row_fits(part, 2, 3));
    const DeepRow all = deep_columns(four_pixels(), 0, 4);
    EXPECT_EQ(all.first, four_pixels().first);
    EXPECT_EQ(all.samples, four_pixels().samples);
}

// A float holds whole numbers up to 2^24; what it leaves out travels beside it.
TEST(DeepRows, IdsComeBackWhole)
{
    const std::array<std::uint32_t, 6> ids = {
        0, 1, (1u << 24) + 1, 3000000001u, 4294967167u, std::numeric_limits<std::uint32_t>::max()};
    DeepRow row;
    std::vector<std::vector<float>> rest;
    add_id_channel(row, ids, rest);
    ASSERT_EQ(row.samples.size(), 1u);
    ASSERT_EQ(rest.size(), 1u);
    for (std::size_t i = 0; i < ids.size(); ++i)
        EXPECT_EQ(id_of(row.samples[0][i], rest[0][i]), ids[i]);
    EXPECT_EQ(id_of(-3.0f, 0.0f), 0u);
    EXPECT_EQ(id_of(std::numeric_limits<float>::quiet_NaN(), 0.0f), 0u);
    EXPECT_EQ(id_of(1e30f, 0.0f), std::numeric_limits<std::uint32_t>::max());
}

} // namespace
} // namespace rayloom
