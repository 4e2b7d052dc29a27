// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/raster.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <cmath>

namespace rayloom
{
namespace
{

using test::NodeRun;
using test::random_image;
using test::run_node;
using test::TestImage;

const Region window{-4, 3, 29, 24};

TEST(Remainder, WithThePartsItIsTheBeauty)
{
    const TestImage beauty = random_image(window, {"R", "G", "B", "A"}, 1);
    TestImage a = random_image(window, {"R", "G", "B"}, 2);
    const TestImage b = random_image(window, {"R", "G", "B"}, 3);
    a.view().at(1, 4, 9) = std::nanf("");
    const NodeRun run = run_node("transform.remainder", {},
                                 {{"image", {&beauty}}, {"parts", {&a, &b}, nullptr, true}});
    std::size_t below = 0;
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0; x < window.x1; ++x) {
            for (int c = 0; c < 3; ++c) {
                const float part =
                    std::isfinite(a.view().at(c, x, y)) ? a.view().at(c, x, y) : 0.0f;
                const float l = beauty.view().at(c, x, y), rest = run.image().view().at(c, x, y);
                EXPECT_NEAR(rest + part + b.view().at(c, x, y), l, 3e-6f);
                below += rest < -0.01f * l - 1e-4f ? 1 : 0;
            }
            EXPECT_EQ(run.image().view().at(3, x, y), beauty.view().at(3, x, y));
        }
    EXPECT_GT(below, 0u);
    EXPECT_EQ(run.counted.at("values whose passes hold more than the beauty"), below);
}

TEST(Remainder, WithoutPartsItIsTheBeautyItself)
{
    const TestImage beauty = random_image(window, {"R", "G", "B"}, 1),
                    small = random_image({0, 0, 2, 2}, {"R", "G", "B"}, 1);
    EXPECT_EQ(run_node("transform.remainder", {}, {{"image", {&beauty}}}).plan.aliases.size(), 1u);
    EXPECT_THROW(run_node("transform.remainder", {},
                          {{"image", {&beauty}}, {"parts", {&small}, nullptr, true}}),
                 NodeError);
}

} // namespace
} // namespace rayloom
