// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/histogram_fusion.h"
#include "tests/support/raster.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace rayloom
{
namespace
{

using oracle::Raster;
using test::expect_near;
using test::make_image;
using test::NodeRun;
using test::random_image;
using test::run_node;
using test::TestImage;
using test::to_raster;

ParamValues scales(int n, const char* conserve = "none")
{
    return {{"scales", std::int64_t{n}}, {"conserve", std::string(conserve)}};
}

const Region windows[] = {{0, 0, 40, 32}, {-11, 7, 26, 30}, {5, 5, 6, 6}, {0, 0, 3, 50}};

TEST(Pyramid, FollowsTheOracle)
{
    for (const Region& data : windows) {
        const TestImage image = random_image(data, {"R", "G", "B", "n"}, 3);
        const Raster<double> full = to_raster(image);
        const NodeRun plain = run_node("multiscale.pyramid", scales(4), {{"image", {&image}}});
        const NodeRun conserved =
            run_node("multiscale.pyramid", scales(4, "sum"), {{"image", {&image}}});
        EXPECT_EQ(differing_floats(plain.image("levels"), image), 0u);
        for (int s = 1; s < 4; ++s) {
            const auto level = static_cast<std::size_t>(s);
            Raster<double> expected = oracle::downsample(full, s);
            const double largest = *std::max_element(full.values.begin(), full.values.end());
            expect_near(plain.image("levels", level), expected, 1e-6 * largest);
            EXPECT_EQ(plain.image("levels", level).desc.data,
                      (Region{0, 0, (data.width() + (1 << s) - 1) >> s,
                              (data.height() + (1 << s) - 1) >> s}));
            oracle::conserve_count(full, expected);
            const double scaled = *std::max_element(expected.values.begin(), expected.values.end());
            expect_near(conserved.image("levels", level), expected,
                        1e-6 * std::max(largest, scaled));
        }
    }
}

TEST(Pyramid, SumOfTheLastChannelIsConserved)
{
    const TestImage image = random_image({0, 0, 77, 45}, {"a", "n"}, 9);
    const NodeRun run = run_node("multiscale.pyramid", scales(3, "sum"), {{"image", {&image}}});
    const auto sum = [](const TestImage& level) {
        double total = 0.0;
        const Region& r = level.desc.data;
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x) total += level.view().at(1, x, y);
        return total;
    };
    const double full = sum(image);
    for (std::size_t s = 1; s < 3; ++s) EXPECT_NEAR(sum(run.image("levels", s)), full, 1e-5 * full);
}

TEST(Pyramid, NoSamplesAtAllIsNoDivisionByZero)
{
    const TestImage image = make_image({0, 0, 9, 9}, {"n"}, [](int, int, int) { return 0.0f; });
    const NodeRun run = run_node("multiscale.pyramid", scales(2, "sum"), {{"image", {&image}}});
    EXPECT_EQ(run.image("levels", 1).view().at(0, 2, 2), 0.0f);
}

TEST(Pyramid, TilesChangeNoBitAndTheFinestPassesThrough)
{
    const TestImage image = random_image({-3, 2, 58, 43}, {"R", "G", "B"}, 5);
    const NodeRun whole = run_node("multiscale.pyramid", scales(3, "sum"), {{"image", {&image}}});
    ASSERT_EQ(whole.plan.aliases.size(), 1u);
    EXPECT_EQ(whole.plan.aliases[0].output_element, 0u);
    for (const int size : {1, 4, 13}) {
        test::RunOptions options;
        options.tile_width = size;
        options.tile_height = size + 2;
        const NodeRun tiled =
            run_node("multiscale.pyramid", scales(3, "sum"), {{"image", {&image}}}, options);
        for (std::size_t s = 0; s < 3; ++s)
            EXPECT_EQ(differing_floats(whole.image("levels", s), tiled.image("levels", s)), 0u);
    }
}

} // namespace
} // namespace rayloom
