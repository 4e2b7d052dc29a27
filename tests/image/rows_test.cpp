// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/rows.h"

#include <gtest/gtest.h>

namespace rayloom
{
namespace
{

TEST(Rows, AnyRegionOfAnImageAndZerosBeyond)
{
    const Region window{-3, 2, 9, 8};
    ImageBuffer image(window, 2);
    const auto value = [](int c, int x, int y) {
        return static_cast<float>(1 + 100 * c + 10 * (y + 4) + x + 4);
    };
    for (int c = 0; c < 2; ++c)
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x) image.view().at(c, x, y) = value(c, x, y);
    for (const Region region : {window, Region{-1, 4, 5, 6}, Region{-6, 0, 4, 12},
                                Region{2, 3, 14, 4}, Region{20, 3, 24, 4}}) {
        Rows rows(image.view(), region);
        for (int c = 0; c < 2; ++c)
            for (int y = region.y0; y < region.y1; ++y) {
                const float* row = rows.row(c, y);
                for (int x = region.x0; x < region.x1; ++x)
                    EXPECT_EQ(row[x - region.x0],
                              window.contains(Region{x, y, x + 1, y + 1}) ? value(c, x, y) : 0.0f)
                        << region.text() << " " << c << " " << x << " " << y;
            }
    }
    Rows constants(std::vector<float>{3.0f, 5.0f}, Region{2, 3, 6, 4});
    for (int i = 0; i < 4; ++i) {
        EXPECT_EQ(constants.row(0, 3)[i], 3.0f);
        EXPECT_EQ(constants.row(1, 3)[i], 5.0f);
    }
}

} // namespace
} // namespace rayloom
