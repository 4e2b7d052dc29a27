// SPDX-License-Identifier: Apache-2.0
#include "tests/support/raster.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

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

constexpr std::pair<const char*, oracle::RecombineLimit> limits[] = {
    {"none", oracle::RecombineLimit::none},
    {"range", oracle::RecombineLimit::range},
    {"share", oracle::RecombineLimit::share}};

ParamValues limit_to(const char* limit) { return {{"limit", std::string(limit)}}; }

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
        for (const auto& [limit, oracle_limit] : limits) {
            SCOPED_TRACE(limit);
            const ParamValues params = limit_to(limit);
            const NodeRun run = run_node("multiscale.recombine", params, {{"levels", list}});
            expect_near(run.image(), oracle::recombine(rasters, oracle_limit), 1e-6 * largest);
            EXPECT_EQ(run.image().desc.data, data);

            for (const int size : {1, 7, 16}) {
                test::RunOptions options;
                options.tile_width = size;
                options.tile_height = 2 * size + 1;
                const NodeRun tiled =
                    run_node("multiscale.recombine", params, {{"levels", list}}, options);
                EXPECT_EQ(differing_floats(run.image(), tiled.image()), 0u) << size;
            }
        }
    }
}

/// A lamp on a dim wall, whose coarse level is off by a few percent, as after filtering.
struct Lamp {
    TestImage fine, coarse;
};

Lamp lamp(const Region& data)
{
    const auto is_lamp = [](int x, int y) { return x >= 21 && x < 40 && y >= 17 && y < 31; };
    TestImage fine = test::make_image(data, {"R", "G"}, [&](int c, int x, int y) {
        return is_lamp(x, y) ? 16.0f : 0.08f + 0.02f * static_cast<float>(c);
    });
    const NodeRun pyramid =
        run_node("multiscale.pyramid", {{"scales", std::int64_t{2}}}, {{"image", {&fine}}});
    const TestImage& level = pyramid.image("levels", 1);
    TestImage coarse = test::make_image(level.desc.data, {"R", "G"}, [&](int c, int x, int y) {
        const float error = (x + y) % 5 < 2 ? 0.95f : 1.05f;
        const float value = level.view().at(c, x, y);
        return value > 0.2f ? error * value : value;
    });
    return {std::move(fine), std::move(coarse)};
}

TEST(Recombine, LampsLeaveNoBlotchesOnTheWall)
{
    const Lamp levels = lamp({0, 0, 60, 48});
    const auto wall_range = [&](const char* limit) {
        const NodeRun run = run_node("multiscale.recombine", limit_to(limit),
                                     {{"levels", {&levels.fine, &levels.coarse}}});
        std::pair<float, float> range{1e9f, -1e9f};
        for (int y = 0; y < 48; ++y)
            for (int x = 0; x < 60; ++x)
                if (levels.fine.view().at(0, x, y) < 1.0f) {
                    range.first = std::min(range.first, run.image().view().at(0, x, y));
                    range.second = std::max(range.second, run.image().view().at(0, x, y));
                }
        return range;
    };
    const auto none = wall_range("none"), range = wall_range("range"), share = wall_range("share");
    // The published recursion does what the limits are for.
    EXPECT_LT(none.first, -0.1f);
    EXPECT_GT(none.second, 0.2f);
    EXPECT_GE(range.first, 0.08f - 1e-6f);
    EXPECT_GT(range.second, 0.2f);
    EXPECT_GE(share.first, 0.08f - 1e-6f);
    EXPECT_LE(share.second, 0.08f * 1.15f);
}

TEST(Recombine, LimitsGiveNoNegativeValue)
{
    // Values over eight orders of magnitude, many of them 0.
    const auto wild = [](const Region& data, unsigned seed) {
        TestImage image = random_image(data, {"R", "G", "B"}, seed);
        for (int c = 0; c < 3; ++c)
            for (int y = data.y0; y < data.y1; ++y)
                for (int x = data.x0; x < data.x1; ++x) {
                    float& v = image.view().at(c, x, y);
                    v = v < 0.5f ? 0.0f : std::pow(v, 6.0f);
                }
        return image;
    };
    const TestImage fine = wild({-4, 3, 57, 50}, 1), middle = wild({0, 0, 31, 24}, 2),
                    coarse = wild({0, 0, 16, 12}, 3);
    const auto negatives = [&](const char* limit) {
        const NodeRun run = run_node("multiscale.recombine", limit_to(limit),
                                     {{"levels", {&fine, &middle, &coarse}}});
        int count = 0;
        const Region& r = run.image().desc.data;
        for (int c = 0; c < 3; ++c)
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1; ++x) {
                    EXPECT_TRUE(std::isfinite(run.image().view().at(c, x, y)));
                    count += run.image().view().at(c, x, y) < 0.0f;
                }
        return count;
    };
    EXPECT_GT(negatives("none"), 0);
    EXPECT_EQ(negatives("range"), 0);
    EXPECT_EQ(negatives("share"), 0);
}

/// Where neighbours are alike nothing is held back: a change of low frequency arrives in full.
TEST(Recombine, LimitsHoldNothingBackOnGentleSlopes)
{
    const TestImage fine = test::make_image({0, 0, 40, 30}, {"R", "G"}, [](int c, int x, int y) {
        return 1.0f + static_cast<float>(c) + 0.02f * static_cast<float>(x + 2 * y);
    });
    const NodeRun pyramid =
        run_node("multiscale.pyramid", {{"scales", std::int64_t{2}}}, {{"image", {&fine}}});
    const TestImage& level = pyramid.image("levels", 1);
    const TestImage coarse =
        test::make_image(level.desc.data, {"R", "G"},
                         [&](int c, int x, int y) { return 1.03f * level.view().at(c, x, y); });
    for (const auto& [limit, unused] : limits) {
        const NodeRun run =
            run_node("multiscale.recombine", limit_to(limit), {{"levels", {&fine, &coarse}}});
        for (int c = 0; c < 2; ++c)
            for (int y = 6; y < 24; ++y)
                for (int x = 6; x < 34; ++x)
                    ASSERT_NEAR(run.image().view().at(c, x, y), 1.03f * fine.view().at(c, x, y),
                                1e-5)
                        << limit << " " << x << " " << y;
    }
}

TEST(Recombine, TwoUnfilteredScalesAreTheImage)
{
    const TestImage image = random_image({-3, 2, 58, 43}, {"R", "G", "B"}, 5);
    const NodeRun pyramid =
        run_node("multiscale.pyramid", {{"scales", std::int64_t{2}}}, {{"image", {&image}}});
    for (const auto& [limit, unused] : limits) {
        const NodeRun run =
            run_node("multiscale.recombine", limit_to(limit),
                     {{"levels", {&pyramid.image("levels", 0), &pyramid.image("levels", 1)}}});
        expect_near(run.image(), to_raster(image), 2e-6);
    }
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
