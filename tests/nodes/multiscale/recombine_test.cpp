// SPDX-License-Identifier: Apache-2.0
#include "tests/support/raster.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace rayloom
{
namespace
{

using oracle::Raster;
using test::expect_near;
using test::NodeRun;
using test::random_image;
using test::run_node;
using test::TestImage;
using test::to_raster;

TEST(Recombine, FollowsTheOracle)
{
    for (const Region& data :
         {Region{0, 0, 40, 32}, {-11, 7, 26, 30}, {5, 5, 6, 6}, {0, 0, 3, 50}}) {
        const TestImage image = random_image(data, {"R", "G", "B"}, 3);
        const NodeRun pyramid =
            run_node("multiscale.pyramid", {{"scales", std::int64_t{4}}}, {{"image", {&image}}});
        // Other content at every level, as after filtering.
        std::vector<TestImage> levels;
        std::vector<const TestImage*> list;
        std::vector<Raster<double>> rasters;
        for (unsigned s = 0; s < 4; ++s)
            levels.push_back(
                random_image(pyramid.image("levels", s).desc.data, {"R", "G", "B"}, 20 + s));
        double largest = 0.0;
        for (const TestImage& level : levels) {
            list.push_back(&level);
            rasters.push_back(to_raster(level));
            for (const double v : rasters.back().values) largest = std::max(largest, v);
        }
        const NodeRun run = run_node("multiscale.recombine", {}, {{"levels", list}});
        expect_near(run.image(), oracle::recombine(rasters), 1e-6 * largest);
        EXPECT_EQ(run.image().desc.data, data);

        for (const int size : {1, 7, 16}) {
            test::RunOptions options;
            options.tile_width = size;
            options.tile_height = 2 * size + 1;
            const NodeRun tiled = run_node("multiscale.recombine", {}, {{"levels", list}}, options);
            EXPECT_EQ(differing_floats(run.image(), tiled.image()), 0u) << size;
        }
    }
}

TEST(Recombine, TwoUnfilteredScalesAreTheImage)
{
    const TestImage image = random_image({-3, 2, 58, 43}, {"R", "G", "B"}, 5);
    const NodeRun pyramid =
        run_node("multiscale.pyramid", {{"scales", std::int64_t{2}}}, {{"image", {&image}}});
    const NodeRun run =
        run_node("multiscale.recombine", {},
                 {{"levels", {&pyramid.image("levels", 0), &pyramid.image("levels", 1)}}});
    expect_near(run.image(), to_raster(image), 2e-6);
}

TEST(Recombine, OneLevelPassesThrough)
{
    const TestImage image = random_image({-3, 2, 58, 43}, {"R", "G", "B"}, 5);
    const NodeRun run = run_node("multiscale.recombine", {}, {{"levels", {&image}}});
    ASSERT_EQ(run.plan.aliases.size(), 1u);
    EXPECT_EQ(differing_floats(run.image(), image), 0u);
}

TEST(Recombine, AlphaIsTheFinestLevels)
{
    TestImage fine = random_image({0, 0, 30, 20}, {"R", "A"}, 5);
    const TestImage coarse = random_image({0, 0, 15, 10}, {"R", "A"}, 6);
    for (int y = 0; y < 20; ++y)
        for (int x = 0; x < 12; ++x) fine.view().at(0, x, y) = fine.view().at(1, x, y) = 0.0f;
    const NodeRun run = run_node("multiscale.recombine", {}, {{"levels", {&fine, &coarse}}});
    for (int y = 0; y < 20; ++y)
        for (int x = 0; x < 30; ++x) {
            ASSERT_EQ(run.image().view().at(1, x, y), fine.view().at(1, x, y));
            if (x < 12) {
                ASSERT_EQ(run.image().view().at(0, x, y), 0.0f);
            }
        }
    EXPECT_EQ(run.plan.channel_aliases.size(), 1u);
}

TEST(Recombine, RefusesLevelsThatDoNotFit)
{
    const TestImage fine = random_image({0, 0, 30, 21}, {"R"}, 5);
    const TestImage short_by_one = random_image({0, 0, 15, 10}, {"R"}, 6);
    const TestImage other_channels = random_image({0, 0, 15, 11}, {"G"}, 6);
    EXPECT_THROW(run_node("multiscale.recombine", {}, {{"levels", {&fine, &short_by_one}}}),
                 NodeError);
    EXPECT_THROW(run_node("multiscale.recombine", {}, {{"levels", {&fine, &other_channels}}}),
                 NodeError);
}

} // namespace
} // namespace rayloom
