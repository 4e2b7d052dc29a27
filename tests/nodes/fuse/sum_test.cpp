// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/raster.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

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
    // Rows of several blocks, the last of them short.
    const Region wide{-4, 3, 295, 9};
    const TestImage base = random_image(wide, {"R", "G", "B", "A"}, 1),
                    a = random_image(wide, {"R", "G", "B"}, 2),
                    b = random_image(wide, {"R", "G", "B"}, 3);
    const NodeRun run =
        run_node("fuse.sum", {}, {{"images", {&a, &b}, nullptr, true}, {"base", {&base}}});
    for (int y = wide.y0; y < wide.y1; ++y)
        for (int x = wide.x0; x < wide.x1; ++x) {
            for (int c = 0; c < 3; ++c)
                EXPECT_EQ(run.image().view().at(c, x, y),
                          static_cast<float>(static_cast<double>(base.view().at(c, x, y)) +
                                             static_cast<double>(a.view().at(c, x, y)) +
                                             static_cast<double>(b.view().at(c, x, y))));
            EXPECT_EQ(run.image().view().at(3, x, y), base.view().at(3, x, y));
        }
}

/// Of two images float's own sum is the one of double rounded once, bit for bit.
TEST(FuseSum, TwoImagesHaveTheBitsOfDouble)
{
    TestImage a = random_image(window, {"R", "G", "B"}, 2),
              b = random_image(window, {"R", "G", "B"}, 3);
    const std::vector<float> odd{0.0f,        -0.0f,       1.0f,       -1.0f,   1e-45f, 3e38f,
                                 16777216.0f, 16777217.0f, 0.5f,       0.3f,    1e8f,   5.9e-8f,
                                 -1e-40f,     -3e38f,      1.0000001f, INFINITY};
    const auto side = static_cast<int>(odd.size());
    for (int i = 0; i < side; ++i)
        for (int j = 0; j < side; ++j) {
            a.view().at(i % 3, window.x0 + i, window.y0 + j) = odd[static_cast<std::size_t>(i)];
            b.view().at(i % 3, window.x0 + i, window.y0 + j) = odd[static_cast<std::size_t>(j)];
        }
    std::mt19937 random(4);
    std::uniform_int_distribution<int> exponent(-60, 60);
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0 + side; x < window.x1; ++x)
            for (int c = 0; c < 3; ++c)
                b.view().at(c, x, y) = std::ldexp(b.view().at(c, x, y), exponent(random));
    const NodeRun run = run_node("fuse.sum", {}, {{"images", {&a, &b}, nullptr, true}});
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0; x < window.x1; ++x)
            for (int c = 0; c < 3; ++c)
                EXPECT_EQ(std::bit_cast<std::uint32_t>(run.image().view().at(c, x, y)),
                          std::bit_cast<std::uint32_t>(
                              static_cast<float>(0.0 + static_cast<double>(a.view().at(c, x, y)) +
                                                 static_cast<double>(b.view().at(c, x, y)))))
                    << a.view().at(c, x, y) << " + " << b.view().at(c, x, y);
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
