// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/border.h"
#include "rayloom/image/view.h"

#include <gtest/gtest.h>

namespace rayloom
{
namespace
{

TEST(Region, HullIntersectGrow)
{
    const Region a{-4, -2, 6, 3}, b{2, 1, 10, 9};
    EXPECT_EQ(a.intersect(b), (Region{2, 1, 6, 3}));
    EXPECT_EQ(a.hull(b), (Region{-4, -2, 10, 9}));
    EXPECT_EQ(a.hull({}), a);
    EXPECT_TRUE(a.intersect({6, 0, 9, 9}).empty());
    EXPECT_EQ(a.grown({1, 2, 3, 4}), (Region{-5, -5, 8, 7}));
    EXPECT_EQ(a.text(), "10x5-4-2");
}

TEST(Border, MirrorRepeatsTheEdgePixel)
{
    const int expected[] = {2, 1, 0, 0, 1, 2, 2, 1, 0, 0};
    for (int i = -3; i < 7; ++i)
        EXPECT_EQ(border_index(i + 5, 5, 8, Border::mirror), 5 + expected[i + 3]) << i;
}

TEST(Border, RangeHoldsEveryMappedIndex)
{
    for (const Border border : {Border::mirror, Border::clamp})
        for (int n = 1; n < 6; ++n)
            for (int a = -12; a < 12; ++a)
                for (int b = a + 1; b < 14; ++b) {
                    const IndexRange r = border_range(a, b, 0, n, border);
                    for (int i = a; i < b; ++i) {
                        EXPECT_GE(border_index(i, 0, n, border), r.begin);
                        EXPECT_LT(border_index(i, 0, n, border), r.end);
                    }
                    EXPECT_GE(r.begin, 0);
                    EXPECT_LE(r.end, n);
                }
}

TEST(ImageBuffer, RowsAreAlignedAndCropsPointInside)
{
    ImageBuffer image({-3, 7, 30, 12}, 3);
    for (int y = 7; y < 12; ++y)
        for (int c = 0; c < 3; ++c) {
            EXPECT_EQ(reinterpret_cast<std::uintptr_t>(image.view().row(c, y)) % 64, 0u);
            for (int x = -3; x < 30; ++x)
                image.view().at(c, x, y) = static_cast<float>(x + 100 * y + 1000 * c);
        }
    const ConstImageView part = image.view().crop({0, 8, 5, 10});
    EXPECT_EQ(part.at(2, 4, 9), 2904.0f);
    EXPECT_EQ(part.row(1, 8)[0], 1800.0f);
}

} // namespace
} // namespace rayloom
