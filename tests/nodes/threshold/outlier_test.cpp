// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace rayloom
{
namespace
{

using test::make_image;
using test::NodeRun;
using test::run_node;
using test::TestImage;

const std::vector<std::string> rgb{"R", "G", "B"};
const Region window{-3, 2, 27, 22};

/// Skewed noise of three channels that go together, some pixels far too bright.
TestImage fireflies()
{
    std::mt19937 random(4);
    std::normal_distribution<double> noise(0.0, 0.8);
    std::vector<float> values;
    for (std::size_t i = 0; i < window.pixels(); ++i) {
        const double v = std::exp(noise(random));
        values.push_back(static_cast<float>(random() % 40 == 0 ? 60.0 * v : v));
    }
    return make_image(window, rgb, [&](int c, int x, int y) {
        const std::size_t at =
            static_cast<std::size_t>(y - window.y0) * 30u + static_cast<std::size_t>(x - window.x0);
        return values[at] * (1.0f + 0.3f * static_cast<float>(c));
    });
}

/// The node's definition, plainly: sort the neighbours.
double expected_factor(const TestImage& image, const TestImage* low, int x, int y, int radius,
                       double share)
{
    double most = 0.0;
    for (int c = 0; c < 3; ++c) {
        std::vector<double> around;
        for (int v = y - radius; v <= y + radius; ++v)
            for (int u = x - radius; u <= x + radius; ++u)
                if (window.contains(u, v) && (u != x || v != y))
                    around.push_back(image.view().at(c, u, v));
        std::sort(around.rbegin(), around.rend());
        const double rank = std::max(1.0, std::ceil(share * static_cast<double>(around.size())));
        double cap = around[static_cast<std::size_t>(rank) - 1];
        if (low) cap = std::max(cap, static_cast<double>(low->view().at(c, x, y)));
        most = std::max(most, cap / static_cast<double>(image.view().at(c, x, y)));
    }
    return std::min(1.0, most);
}

TEST(Outlier, TheCapIsTheRankOfTheNeighboursOrTheLowerEnd)
{
    const TestImage image = fireflies();
    const TestImage low = make_image(window, rgb, [&](int c, int x, int y) {
        return image.view().at(c, x, y) * (x % 3 == c ? 0.9f : -0.5f);
    });
    const TestImage variance = make_image(window, rgb, [](int, int, int) { return 2.0f; });
    for (const auto& [radius, share] : {std::pair{3, 0.2}, {1, 0.5}, {2, 1e-6}, {9, 1.0}})
        for (const bool interval : {true, false}) {
            std::vector<test::NodeInput> inputs{{"image", {&image}}, {"variance", {&variance}}};
            if (interval) inputs.push_back({"low", {&low}});
            const NodeRun run = run_node(
                "threshold.outlier", {{"radius", std::int64_t{radius}}, {"share", share}}, inputs);
            std::size_t changed = 0;
            for (int y = window.y0; y < window.y1; ++y)
                for (int x = window.x0; x < window.x1; ++x) {
                    const double f =
                        expected_factor(image, interval ? &low : nullptr, x, y, radius, share);
                    if (f < 1.0) ++changed;
                    for (int c = 0; c < 3; ++c) {
                        const double value = image.view().at(c, x, y);
                        const double kept = run.image().view().at(c, x, y);
                        ASSERT_NEAR(kept, f * value, 1e-6 * value);
                        ASSERT_NEAR(run.image("variance").view().at(c, x, y), 2.0 * f * f, 1e-5);
                        ASSERT_NEAR(kept + run.image("excess").view().at(c, x, y), value,
                                    1e-7 * value);
                    }
                }
            EXPECT_GT(changed, 5u);
            EXPECT_LT(changed, window.pixels());
        }
}

TEST(Outlier, SmoothImagesAndHighlightsThatTheSamplesBearOutStay)
{
    const TestImage smooth = make_image(
        window, rgb, [](int c, int, int) { return 0.4f + 0.1f * static_cast<float>(c); });
    EXPECT_EQ(
        differing_floats(run_node("threshold.outlier", {}, {{"image", {&smooth}}}).image(), smooth),
        0u);
    const TestImage highlight =
        make_image(window, rgb, [](int, int x, int y) { return x == 5 && y == 9 ? 30.0f : 0.5f; });
    EXPECT_EQ(differing_floats(run_node("threshold.outlier", {},
                                        {{"image", {&highlight}}, {"low", {&highlight}}})
                                   .image(),
                               highlight),
              0u);
    const NodeRun alone = run_node("threshold.outlier", {}, {{"image", {&highlight}}});
    EXPECT_EQ(alone.image().view().at(1, 5, 9), 0.5f);
    EXPECT_EQ(alone.image("excess").view().at(1, 5, 9), 29.5f);
}

TEST(Outlier, ColourIsKeptAndOtherChannelsHandedOn)
{
    const TestImage image = make_image(window, {"R", "G", "B", "A"}, [](int c, int x, int y) {
        if (c == 3) return x == 5 && y == 9 ? 0.25f : 1.0f;
        return (x == 5 && y == 9 ? 20.0f : 1.0f) * (c == 0 ? 2.0f : 1.0f);
    });
    const NodeRun run = run_node("threshold.outlier", {}, {{"image", {&image}}});
    EXPECT_FLOAT_EQ(run.image().view().at(0, 5, 9) / run.image().view().at(2, 5, 9), 2.0f);
    EXPECT_EQ(run.image().view().at(3, 5, 9), 0.25f);
    EXPECT_EQ(run.image("excess").desc.channels, rgb);
    // Bright in one channel alone: the others bear it out.
    const TestImage red = make_image(
        window, rgb, [](int c, int x, int y) { return c == 0 && x == 5 && y == 9 ? 20.0f : 1.0f; });
    EXPECT_EQ(differing_floats(run_node("threshold.outlier", {}, {{"image", {&red}}}).image(), red),
              0u);
}

TEST(Outlier, ShareZeroKeepsEveryPixel)
{
    const TestImage image = fireflies();
    const NodeRun run = run_node("threshold.outlier", {{"share", 0.0}}, {{"image", {&image}}});
    EXPECT_EQ(differing_floats(run.image(), image), 0u);
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0; x < window.x1; ++x)
            ASSERT_EQ(run.image("excess").view().at(0, x, y), 0.0f);
}

TEST(Outlier, NumbersThatAreNoneStayAndDoNotSpread)
{
    TestImage image = fireflies();
    image.view().at(0, 4, 8) = std::numeric_limits<float>::quiet_NaN();
    image.view().at(1, 10, 10) = std::numeric_limits<float>::infinity();
    image.view().at(2, 20, 15) = -3.0f;
    const NodeRun run = run_node("threshold.outlier", {}, {{"image", {&image}}});
    std::size_t strange = 0;
    for (int c = 0; c < 3; ++c)
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x)
                if (!std::isfinite(run.image().view().at(c, x, y))) ++strange;
    EXPECT_EQ(strange, 2u);
    EXPECT_EQ(run.image().view().at(2, 20, 15), -3.0f);
}

TEST(Outlier, TilesChangeNoBit)
{
    const TestImage image = fireflies();
    const NodeRun whole = run_node("threshold.outlier", {}, {{"image", {&image}}});
    test::RunOptions tiles;
    tiles.tile_width = 7;
    tiles.tile_height = 5;
    const NodeRun cut = run_node("threshold.outlier", {}, {{"image", {&image}}}, tiles);
    for (const char* port : {"image", "excess"})
        EXPECT_EQ(differing_floats(cut.image(port), whole.image(port)), 0u);
}

TEST(Outlier, MistakesAreExplained)
{
    const TestImage image = fireflies();
    const TestImage grey = make_image(window, {"Y"}, [](int, int, int) { return 0.0f; });
    try {
        run_node("threshold.outlier", {}, {{"image", {&image}}, {"low", {&grey}}});
        FAIL();
    } catch (const NodeError& e) {
        EXPECT_STREQ(e.what(), "input 'low' has 1 colour channels, 'image' has 3; they must agree");
    }
}

} // namespace
} // namespace rayloom
