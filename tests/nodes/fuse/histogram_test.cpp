// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/histogram_fusion.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace rayloom
{
namespace
{

using oracle::FusionSettings;
using oracle::Raster;
using test::make_image;
using test::NodeRun;
using test::run_node;
using test::TestImage;

struct Case {
    TestImage image, histogram;
};

/// Two regions of different histograms with noise of the given size, counts around `samples`.
Case random_case(const Region& data, int bins, double samples, unsigned seed, bool equal_counts,
                 bool alpha = false)
{
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    std::vector<std::string> channels{"R", "G", "B"};
    if (alpha) channels.push_back("A");
    Case c;
    c.image = make_image(data, channels, [&](int, int, int) { return unit(random); });
    if (alpha)
        for (int y = data.y0; y < data.y1; ++y)
            for (int x = data.x0; x < data.x1; ++x) {
                float& a = c.image.view().at(3, x, y);
                a = a < 0.2f ? 0.0f : a > 0.7f ? 1.0f : a;
                for (int k = 0; k < 3; ++k) c.image.view().at(k, x, y) *= a;
            }
    std::vector<std::string> names;
    for (int i = 0; i <= bins; ++i) names.push_back("Bin_" + std::to_string(i));
    c.histogram = make_image(data, names, [](int, int, int) { return 0.0f; });
    for (int y = data.y0; y < data.y1; ++y)
        for (int x = data.x0; x < data.x1; ++x) {
            const double n = equal_counts ? samples : samples * (0.5 + unit(random));
            const bool empty = !equal_counts && unit(random) < 0.03f;
            c.histogram.view().at(bins, x, y) = empty ? 0.0f : static_cast<float>(n);
            if (empty) continue;
            const double centre = (x + 2 * y) % 23 < 12 ? 0.3 * bins : 0.55 * bins;
            for (int i = 0; i < bins; ++i) {
                const double d = (i - centre) / (0.15 * bins);
                c.histogram.view().at(i, x, y) = static_cast<float>(
                    n / (0.38 * bins) * std::exp(-0.5 * d * d) * (0.5 + unit(random)));
            }
        }
    return c;
}

template <class Real>
Raster<Real> to_raster(const TestImage& image)
{
    const Region& r = image.desc.data;
    Raster<Real> raster(r.width(), r.height(), image.desc.channel_count());
    for (int c = 0; c < raster.channels; ++c)
        for (int y = 0; y < raster.height; ++y)
            for (int x = 0; x < raster.width; ++x)
                raster.at(c, x, y) = image.view().at(c, r.x0 + x, r.y0 + y);
    return raster;
}

ParamValues params(double kappa, int window, int patch, int min_patches)
{
    return {{"kappa", kappa},
            {"window", std::int64_t{window}},
            {"patch", std::int64_t{patch}},
            {"min_patches", std::int64_t{min_patches}}};
}

NodeRun fuse(const Case& c, const ParamValues& p, const test::RunOptions& options = {})
{
    return run_node("fuse.histogram", p, {{"image", {&c.image}}, {"histogram", {&c.histogram}}},
                    options);
}

struct OracleCase {
    const char* name;
    Region data;
    int bins;
    double samples;
    bool equal_counts, alpha;
    double kappa;
    int window, patch, min_patches;
};

class AgainstOracle : public testing::TestWithParam<OracleCase>
{
};

TEST_P(AgainstOracle, SameMatchesAndPixels)
{
    const OracleCase& o = GetParam();
    const Case c = random_case(o.data, o.bins, o.samples, 7, o.equal_counts, o.alpha);
    const NodeRun run = fuse(c, params(o.kappa, o.window, o.patch, o.min_patches));
    const FusionSettings settings{o.kappa, o.window / 2, o.patch / 2, o.min_patches};
    Raster<double> matches;
    const auto expected = fuse_histogram(to_raster<double>(c.image), to_raster<double>(c.histogram),
                                         settings, o.alpha ? 3 : -1, &matches);
    double accepted = 0.0;
    for (int y = 0; y < o.data.height(); ++y)
        for (int x = 0; x < o.data.width(); ++x) {
            ASSERT_EQ(run.image("matches").view().at(0, o.data.x0 + x, o.data.y0 + y),
                      matches.at(0, x, y))
                << x << " " << y;
            accepted += matches.at(0, x, y);
            for (int k = 0; k < expected.channels; ++k) {
                const double e = expected.at(k, x, y);
                ASSERT_NEAR(run.image().view().at(k, o.data.x0 + x, o.data.y0 + y), e,
                            3e-6 * std::max(1.0, o.window / 13.0) * std::abs(e) + 1e-7)
                    << x << " " << y << " " << k;
            }
        }
    // The case must have something to decide.
    if (o.data.pixels() > 100 && o.kappa > 0 && o.kappa < 10) {
        const double share = accepted / static_cast<double>(o.data.pixels());
        EXPECT_GT(share, 1.5);
        EXPECT_LT(share, 0.9 * o.window * o.window);
    }
}

INSTANTIATE_TEST_SUITE_P(
    Cases, AgainstOracle,
    testing::Values(
        OracleCase{"Default", {0, 0, 40, 30}, 60, 64, false, false, 1.0, 13, 3, 0},
        OracleCase{"EqualCounts", {0, 0, 40, 30}, 60, 64, true, false, 1.0, 13, 3, 0},
        OracleCase{"NearestTwo", {0, 0, 30, 26}, 60, 64, false, false, 0.6, 13, 3, 2},
        OracleCase{"NearestMany", {0, 0, 20, 20}, 20, 32, false, false, 0.5, 7, 3, 9},
        OracleCase{"NearestOnly", {0, 0, 20, 20}, 20, 32, false, false, 0.0, 7, 3, 3},
        OracleCase{"Alpha", {-7, 5, 28, 29}, 30, 64, false, true, 1.0, 9, 3, 1},
        OracleCase{"Strips", {1000, -20, 1240, -11}, 12, 48, false, false, 1.0, 7, 3, 0},
        OracleCase{"SinglePixelPatch", {0, 0, 33, 17}, 61, 64, true, false, 1.2, 5, 1, 0},
        OracleCase{"LargePatch", {0, 0, 29, 31}, 16, 64, false, false, 1.0, 7, 7, 0},
        OracleCase{"LargeWindow", {0, 0, 48, 40}, 10, 64, false, false, 1.0, 37, 3, 0},
        OracleCase{"WindowBeyondImage", {0, 0, 7, 5}, 20, 64, false, false, 1.5, 13, 3, 0},
        OracleCase{"ManyBins", {0, 0, 20, 12}, 300, 900, false, false, 1.0, 5, 3, 0},
        OracleCase{"Row", {3, 3, 60, 4}, 20, 64, false, false, 1.0, 13, 3, 0},
        OracleCase{"Pixel", {3, 3, 4, 4}, 20, 64, true, false, 1.0, 13, 3, 2}),
    [](const auto& test) { return test.param.name; });

TEST(FuseHistogram, TilesAndTargetsChangeNoBit)
{
    const Case c = random_case({-5, 9, 140, 64}, 60, 64, 3, false, true);
    const ParamValues p = params(1.0, 13, 3, 2);
    const NodeRun whole = fuse(c, p);
    for (const auto& [w, h] : {std::pair{7, 11}, {33, 64}, {113, 5}, {1, 40}}) {
        test::RunOptions options;
        options.tile_width = w;
        options.tile_height = h;
        const NodeRun tiled = fuse(c, p, options);
        EXPECT_EQ(differing_floats(whole.image(), tiled.image()), 0u) << w << "x" << h;
        EXPECT_EQ(differing_floats(whole.image("matches"), tiled.image("matches")), 0u);
    }
    int tried = 0;
    for (std::int64_t left = hwy::SupportedTargets(); left != 0; left &= left - 1) {
        const std::int64_t target = left & -left;
        hwy::SetSupportedTargetsForTest(target);
        const NodeRun other = fuse(c, p);
        hwy::SetSupportedTargetsForTest(0);
        EXPECT_EQ(differing_floats(whole.image(), other.image()), 0u) << hwy::TargetName(target);
        ++tried;
    }
    EXPECT_GE(tried, 1);
}

TEST(FuseHistogram, OneOutputAtATimeGivesTheSameBits)
{
    const Case c = random_case({0, 0, 40, 30}, 30, 64, 5, false);
    const ParamValues p = params(1.0, 9, 3, 0);
    const NodeRun both = fuse(c, p);
    for (const char* port : {"image", "matches"}) {
        test::RunOptions options;
        options.wanted = {port};
        EXPECT_EQ(differing_floats(fuse(c, p, options).image(port), both.image(port)), 0u) << port;
    }
}

TEST(FuseHistogram, NothingAcceptedReturnsTheInput)
{
    const Case c = random_case({0, 0, 40, 30}, 30, 64, 5, false, true);
    const NodeRun run = fuse(c, params(0.0, 13, 3, 0));
    ASSERT_EQ(run.plan.aliases.size(), 1u);
    EXPECT_EQ(run.plan.aliases[0].output, "image");
    EXPECT_EQ(run.plan.aliases[0].input, "image");
    EXPECT_EQ(differing_floats(run.image(), c.image), 0u);
    // A threshold nothing passes keeps every pixel too.
    EXPECT_EQ(differing_floats(fuse(c, params(1e-6, 13, 3, 0)).image(), c.image), 0u);
    EXPECT_TRUE(fuse(c, params(1e-6, 13, 3, 0)).plan.aliases.empty());
}

TEST(FuseHistogram, ConstantImageStaysConstant)
{
    Case c = random_case({0, 0, 60, 40}, 30, 64, 5, false);
    for (float value : {0.7f, 12345.678f, -3.0f}) {
        c.image =
            make_image(c.image.desc.data, {"R", "G", "B"}, [&](int, int, int) { return value; });
        const NodeRun run = fuse(c, params(1.0, 13, 3, 2));
        for (int y = 0; y < 40; ++y)
            for (int x = 0; x < 60; ++x)
                ASSERT_NEAR(run.image().view().at(1, x, y), value, 3e-6f * std::abs(value));
    }
}

TEST(FuseHistogram, OpaqueAlphaIsNoAlpha)
{
    const Case plain = random_case({0, 0, 40, 30}, 30, 64, 5, false);
    Case opaque = random_case({0, 0, 40, 30}, 30, 64, 5, false);
    opaque.image = make_image({0, 0, 40, 30}, {"R", "G", "B", "A"}, [&](int k, int x, int y) {
        return k == 3 ? 1.0f : plain.image.view().at(k, x, y);
    });
    const NodeRun a = fuse(plain, params(1.0, 9, 3, 0)), b = fuse(opaque, params(1.0, 9, 3, 0));
    for (int k = 0; k < 3; ++k)
        for (int y = 0; y < 30; ++y)
            for (int x = 0; x < 40; ++x)
                ASSERT_EQ(a.image().view().at(k, x, y), b.image().view().at(k, x, y));
    ASSERT_EQ(b.plan.channel_aliases.size(), 1u);
    EXPECT_EQ(b.plan.channel_aliases[0].output_channel, 3);
}

/// χ² is proportional to the counts once every bin holds evidence: n times the samples is a
/// threshold n times as strict.
TEST(FuseHistogram, ScalingCountsScalesTheThreshold)
{
    Case c = random_case({0, 0, 40, 30}, 20, 64, 11, false);
    for (int y = 0; y < 30; ++y)
        for (int x = 0; x < 40; ++x)
            for (int i = 0; i < 20; ++i) c.histogram.view().at(i, x, y) += 2.0f;
    const NodeRun one = fuse(c, params(0.75, 9, 3, 0));
    for (int i = 0; i <= 20; ++i)
        for (int y = 0; y < 30; ++y)
            for (int x = 0; x < 40; ++x) c.histogram.view().at(i, x, y) *= 8.0f;
    const NodeRun eight = fuse(c, params(6.0, 9, 3, 0));
    EXPECT_EQ(differing_floats(one.image("matches"), eight.image("matches")), 0u);
    EXPECT_EQ(differing_floats(one.image(), eight.image()), 0u);
    EXPECT_GT(
        differing_floats(one.image("matches"), fuse(c, params(0.75, 9, 3, 0)).image("matches")),
        100u);
}

TEST(FuseHistogram, WhatIsNotFiniteStaysWhereItMatches)
{
    Case c = random_case({0, 0, 40, 30}, 20, 64, 11, false);
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const float inf = std::numeric_limits<float>::infinity();
    c.histogram.view().at(4, 20, 15) = nan;
    c.histogram.view().at(20, 8, 8) = nan;
    c.histogram.view().at(5, 30, 20) = inf;
    // With a patch of one pixel nothing but the pixel itself takes it in.
    const NodeRun single = fuse(c, params(0.9, 9, 1, 0));
    EXPECT_EQ(single.image("matches").view().at(0, 8, 8), 1.0f);
    EXPECT_EQ(single.image("matches").view().at(0, 30, 20), 1.0f);
    c.image.view().at(1, 8, 8) = nan;
    c.image.view().at(2, 30, 20) = inf;
    for (const auto& options : {test::RunOptions{}, test::RunOptions{7, 9, true, {}}}) {
        const NodeRun run = fuse(c, params(0.9, 9, 1, 0), options);
        for (int k = 0; k < 3; ++k)
            for (int y = 0; y < 30; ++y)
                for (int x = 0; x < 40; ++x) {
                    if ((x == 8 && y == 8) || (x == 30 && y == 20)) continue;
                    ASSERT_TRUE(std::isfinite(run.image().view().at(k, x, y))) << x << " " << y;
                }
    }
}

TEST(FuseHistogram, BlackTilesAreSkippedWithTheSameBits)
{
    Case c = random_case({0, 0, 96, 32}, 20, 64, 11, false, true);
    for (int k = 0; k < 3; ++k)
        for (int y = 0; y < 32; ++y)
            for (int x = 0; x < 60; ++x) c.image.view().at(k, x, y) = 0.0f;
    test::RunOptions options;
    options.tile_width = options.tile_height = 16;
    options.wanted = {"image"};
    const NodeRun skipped = fuse(c, params(0.9, 9, 3, 0), options);
    EXPECT_EQ(skipped.skipped.at("black"), 3u * 16u * 32u);
    options.may_skip = false;
    const NodeRun full = fuse(c, params(0.9, 9, 3, 0), options);
    EXPECT_TRUE(full.skipped.empty());
    EXPECT_EQ(differing_floats(skipped.image(), full.image()), 0u);

    // Light below zero is none, but it is not black.
    for (const float value : {-0.25f, -0.0f}) {
        for (int y = 0; y < 32; ++y)
            for (int x = 0; x < 60; ++x) c.image.view().at(1, x, y) = value;
        options.may_skip = true;
        EXPECT_TRUE(fuse(c, params(0.9, 9, 3, 0), options).skipped.empty()) << value;
    }
}

std::string plan_error(const Case& c, const ParamValues& p)
{
    try {
        fuse(c, p);
    } catch (const NodeError& e) {
        return e.what();
    }
    return "";
}

TEST(FuseHistogram, MistakesSayWhatToDo)
{
    Case c = random_case({0, 0, 8, 8}, 20, 64, 11, false);
    EXPECT_NE(plan_error(c, params(1, 12, 3, 0)).find("try 13"), std::string::npos);
    EXPECT_NE(plan_error(c, params(1, 13, 2, 0)).find("try 3"), std::string::npos);
    c.histogram.desc.channels = {"R", "G", "B", "A"};
    c.histogram.pixels = ImageBuffer(c.histogram.desc.data, 4);
    EXPECT_NE(plan_error(c, params(1, 13, 3, 0)).find("that is a picture"), std::string::npos);
    EXPECT_NE(plan_error(c, params(-1, 13, 3, 0)), "");
    Case shifted = random_case({1, 0, 9, 8}, 20, 64, 11, false);
    std::swap(shifted.image, c.image);
    EXPECT_NE(plan_error(c, params(1, 13, 3, 0)).find("same pixels"), std::string::npos);
    Case single = random_case({0, 0, 8, 8}, 20, 64, 11, false);
    single.histogram = make_image({0, 0, 8, 8}, {"n"}, [](int, int, int) { return 1.0f; });
    EXPECT_NE(plan_error(single, params(1, 13, 3, 0)), "");
}

} // namespace
} // namespace rayloom
