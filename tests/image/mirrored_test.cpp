// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/border.h"
#include "rayloom/image/mirrored.h"
#include "tests/support/raster.h"

#include <gtest/gtest.h>

#include <vector>

namespace rayloom
{
namespace
{

TEST(Mirrored, RowsAndTheirRegionAreThoseOfTheBorder)
{
    for (const Region& window : {Region{-3, 2, 9, 7}, Region{4, 4, 5, 11}, Region{0, 0, 1, 1}}) {
        const test::TestImage image = test::random_image(window, {"Y"}, 1);
        const Region wide{window.x0 - 20, window.y0 - 9, window.x1 + 17, window.y1 + 30};
        std::vector<float> row(static_cast<std::size_t>(wide.width()));
        for (int y = wide.y0; y < wide.y1; ++y) {
            load_mirrored_row(image.view(), window, y, wide, row.data());
            for (int x = wide.x0; x < wide.x1; ++x) {
                const int u = border_index(x, window.x0, window.x1, Border::mirror);
                const int v = border_index(y, window.y0, window.y1, Border::mirror);
                ASSERT_EQ(row[static_cast<std::size_t>(x - wide.x0)], image.view().at(0, u, v));
            }
        }
    }
}

TEST(Mirrored, ARegionHoldsAllThatIsRead)
{
    const Region window{0, 0, 10, 8};
    for (const Region& region :
         {Region{-3, 2, 4, 6}, Region{8, -2, 14, 12}, Region{-12, 3, -4, 5}, Region{2, 2, 5, 5}}) {
        const Region read = mirrored_region(region, window);
        Region seen{window.x1, window.y1, window.x0, window.y0};
        for (int y = region.y0; y < region.y1; ++y)
            for (int x = region.x0; x < region.x1; ++x) {
                const int u = border_index(x, window.x0, window.x1, Border::mirror);
                const int v = border_index(y, window.y0, window.y1, Border::mirror);
                seen = {std::min(seen.x0, u), std::min(seen.y0, v), std::max(seen.x1, u + 1),
                        std::max(seen.y1, v + 1)};
            }
        EXPECT_TRUE(read.contains(seen)) << region.text() << read.text() << seen.text();
        EXPECT_TRUE(window.contains(read));
    }
    EXPECT_EQ(mirrored_region({2, 2, 5, 5}, window), (Region{2, 2, 5, 5}));
    EXPECT_EQ(mirrored_region({-3, 2, 2, 6}, window), (Region{0, 2, 3, 6}));
}

} // namespace
} // namespace rayloom
