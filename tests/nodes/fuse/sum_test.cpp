// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/raster.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

namespace rayloom
{
namespace
{

using test::NodeRun;
using test::random_image;
using test::run_node;
using test::TestImage;

const Region window{-4, 3, 29, 24};

TEST(FuseSum, AddsColoursAndKeepsAlphaOfTheBase)
{
    const TestImage base = random_image(window, {"R", "G", "B", "A"}, 1),
                    a = random_image(window, {"R", "G", "B"}, 2),
                    b = random_image(window, {"R", "G", "B"}, 3);
    const NodeRun run =
        run_node("fuse.sum", {}, {{"images", {&a, &b}, nullptr, true}, {"base", {&base}}});
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0; x < window.x1; ++x) {
            for (int c = 0; c < 3; ++c)
                EXPECT_EQ(run.image().view().at(c, x, y),
                          static_cast<float>(static_cast<double>(base.view().at(c, x, y)) +
                                             static_cast<double>(a.view().at(c, x, y)) +
                                             static_cast<double>(b.view().at(c, x, y))));
            EXPECT_EQ(run.image().view().at(3, x, y), base.view().at(3, x, y));
        }
}

TEST(FuseSum, OneImageIsPassedOn)
{
    const TestImage a = random_image(window, {"R", "G", "B"}, 2);
    const NodeRun run = run_node("fuse.sum", {}, {{"images", {&a}, nullptr, true}});
    ASSERT_EQ(run.plan.aliases.size(), 1u);
    EXPECT_EQ(run.plan.aliases[0].input, "images");
}

TEST(FuseSum, RefusesNothingAndUnlike)
{
    const TestImage a = random_image(window, {"R", "G", "B"}, 2),
                    one = random_image(window, {"Y"}, 3),
                    small = random_image({0, 0, 3, 3}, {"R", "G", "B"}, 3);
    EXPECT_THROW(run_node("fuse.sum", {}, {}), NodeError);
    EXPECT_THROW(run_node("fuse.sum", {}, {{"images", {&a, &one}, nullptr, true}}), NodeError);
    EXPECT_THROW(run_node("fuse.sum", {}, {{"images", {&a, &small}, nullptr, true}}), NodeError);
}

} // namespace
} // namespace rayloom
