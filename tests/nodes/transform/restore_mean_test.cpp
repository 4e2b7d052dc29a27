// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/oracle/restore_mean.h"
#include "tests/support/raster.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace rayloom
{
namespace
{

using oracle::Raster;
using oracle::spread;
using test::make_image;
using test::NodeRun;
using test::run_node;
using test::TestImage;
using test::to_raster;

TestImage positive(const Region& window, unsigned seed)
{
    std::mt19937 random(seed);
    std::exponential_distribution<float> value(1.0f);
    return make_image(window, {"R"}, [&](int, int, int) { return value(random); });
}

NodeRun restore(const TestImage& image, const TestImage& reference, int scale)
{
    return run_node("transform.restore_mean", {{"scale", std::int64_t{scale}}},
                    {{"image", {&image}}, {"reference", {&reference}}});
}

double sum(const TestImage& image)
{
    double total = 0.0;
    const Region& r = image.desc.data;
    for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x) total += image.view().at(0, x, y);
    return total;
}

/// Fails the test where a pixel is further than `tolerance`·(1 + value) from what is expected.
void expect_close(const TestImage& image, const Raster<double>& expected, double tolerance)
{
    const Region& r = image.desc.data;
    for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x) {
            const double value = expected.at(0, x - r.x0, y - r.y0);
            ASSERT_NEAR(image.view().at(0, x, y), value, tolerance * (1.0 + value))
                << x << "," << y;
        }
}

TEST(RestoreMean, EachColourIsRestoredByItsOwnReference)
{
    const Region window{0, 0, 23, 17};
    const auto colours = [&](unsigned seed) {
        std::mt19937 random(seed);
        std::exponential_distribution<float> value(1.0f);
        return make_image(window, {"R", "G", "B"}, [&](int, int, int) { return value(random); });
    };
    const TestImage image = colours(1), reference = colours(2);
    const NodeRun all = restore(image, reference, 3);
    for (int c = 0; c < 3; ++c) {
        const auto one = [&](const TestImage& from) {
            return make_image(window, {"R"},
                              [&](int, int x, int y) { return from.view().at(c, x, y); });
        };
        const NodeRun alone = restore(one(image), one(reference), 3);
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x)
                ASSERT_EQ(all.image().view().at(c, x, y), alone.image().view().at(0, x, y))
                    << c << " " << x << " " << y;
    }
}

TEST(RestoreMean, FollowsItsDefinition)
{
    for (const Region& window : {Region{-4, 2, 27, 21}, Region{0, 0, 1, 13}, Region{3, 3, 4, 4}}) {
        const TestImage image = positive(window, 1), reference = positive(window, 2);
        const NodeRun run = restore(image, reference, 3);
        expect_close(run.image(), oracle::restore_share(to_raster(image), to_raster(reference), 3),
                     1e-5);
    }
}

NodeRun balance(const TestImage& image, const TestImage& reference, const TestImage& weight,
                int scale)
{
    return run_node("transform.restore_mean",
                    {{"scale", std::int64_t{scale}}, {"mode", std::string("balance")}},
                    {{"image", {&image}}, {"reference", {&reference}}, {"weight", {&weight}}});
}

/// f + f / K(w f) · K(w (n − f) / K(w f / K(w f))), before it is kept from going below zero.
Raster<double> plain_balance(const TestImage& image, const TestImage& reference,
                             const TestImage& weight, int scale)
{
    const Raster<double> f = to_raster(image), n = to_raster(reference), w = to_raster(weight);
    const auto each = [&](const auto& value) {
        Raster<double> out = f;
        for (std::size_t i = 0; i < out.values.size(); ++i) out.values[i] = value(i);
        return out;
    };
    const Raster<double> wf = each([&](auto i) { return w.values[i] * f.values[i]; });
    const Raster<double> mean = spread(wf, scale);
    const Raster<double> shares =
        spread(each([&](auto i) { return wf.values[i] / mean.values[i]; }), scale);
    const Raster<double> handed = spread(
        each([&](auto i) { return w.values[i] * (n.values[i] - f.values[i]) / shares.values[i]; }),
        scale);
    return each(
        [&](auto i) { return f.values[i] + f.values[i] / mean.values[i] * handed.values[i]; });
}

TEST(RestoreMean, BalanceFollowsItsDefinition)
{
    for (const Region& window : {Region{-4, 2, 27, 21}, Region{0, 0, 1, 13}, Region{3, 3, 4, 4}}) {
        const TestImage image = positive(window, 1), reference = positive(window, 2),
                        weight = positive(window, 3);
        Raster<double> expected = plain_balance(image, reference, weight, 3);
        for (double& v : expected.values) v = std::max(v, 0.0);
        expect_close(balance(image, reference, weight, 3).image(), expected, 2e-5);
    }
}

TEST(RestoreMean, BalanceNeverTakesMoreThanThereIs)
{
    // A filtered image that is much too bright has light to give back, in places more than it has.
    const Region window{-4, 2, 27, 21};
    const TestImage image = positive(window, 1), weight = positive(window, 3);
    const TestImage dark = make_image(window, {"R"}, [](int, int, int) { return 0.0f; });
    Raster<double> expected = plain_balance(image, dark, weight, 3);
    EXPECT_GT(std::ranges::count_if(expected.values, [](double v) { return v < -0.01; }), 5);
    const NodeRun run = balance(image, dark, weight, 3);
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0; x < window.x1; ++x) {
            const double plain = expected.at(0, x - window.x0, y - window.y0);
            ASSERT_NEAR(run.image().view().at(0, x, y), std::max(plain, 0.0), 1e-4);
        }
}

TEST(RestoreMean, BalanceKeepsTheWeightedSum)
{
    const Region window{0, 0, 131, 89};
    TestImage image = positive(window, 3), reference = positive(window, 4),
              weight = positive(window, 5);
    reference.view().at(0, 60, 50) = 1e5f;
    for (int y = 0; y < 89; ++y)
        for (int x = 0; x < 131; ++x) {
            // What is filtered is below what it is made from, as after averaging logarithms.
            image.view().at(0, x, y) = 0.2f + 0.1f * std::sin(0.1f * static_cast<float>(x + y));
            reference.view().at(0, x, y) += 0.4f;
            if (x > 100) weight.view().at(0, x, y) = 0.0f;
        }
    for (const int scale : {1, 3}) {
        const NodeRun run = balance(image, reference, weight, scale);
        double have = 0.0, want = 0.0;
        for (int y = 0; y < 89; ++y)
            for (int x = 0; x < 131; ++x) {
                const double w = weight.view().at(0, x, y);
                have += w * static_cast<double>(run.image().view().at(0, x, y));
                want += w * static_cast<double>(reference.view().at(0, x, y));
            }
        EXPECT_NEAR(have / want, 1.0, 2e-6);
        // What counts nothing stays as it was.
        EXPECT_EQ(run.image().view().at(0, 105, 40), reference.view().at(0, 105, 40));
    }
}

TEST(RestoreMean, BalanceLeavesWhatLostNothingToTheLastBit)
{
    const Region window{0, 0, 61, 47};
    const TestImage image = positive(window, 6), weight = positive(window, 7);
    EXPECT_EQ(differing_floats(balance(image, image, weight, 3).image(), image), 0u);
}

TEST(RestoreMean, ABrightLeftEdgeLeavesTheRightEdgeUntouched)
{
    const Region window{0, 0, 160, 20};
    const TestImage reference = positive(window, 8), weight = positive(window, 9);
    TestImage image = positive(window, 10), bright = positive(window, 10);
    TestImage bright_reference = positive(window, 8);
    for (int y = 0; y < 20; ++y)
        bright.view().at(0, 0, y) = bright_reference.view().at(0, 0, y) = 1e6f;
    const NodeRun dim = balance(image, reference, weight, 3),
                  other = balance(bright, bright_reference, weight, 3);
    // K is applied three times, and reaches 14 pixels.
    for (int y = 0; y < 20; ++y)
        for (int x = 43; x < 160; ++x)
            ASSERT_EQ(dim.image().view().at(0, x, y), other.image().view().at(0, x, y)) << x;
}

TEST(RestoreMean, KeepsTheSum)
{
    const Region window{0, 0, 131, 89};
    TestImage image = positive(window, 3), reference = positive(window, 4);
    reference.view().at(0, 2, 1) = 1e5f;
    for (int y = 0; y < 60; ++y)
        for (int x = 40; x < 120; ++x) image.view().at(0, x, y) = y % 3 == 0 ? -1.0f : 0.0f;
    for (const int scale : {1, 3, 5})
        EXPECT_NEAR(sum(restore(image, reference, scale).image()) / sum(reference), 1.0, 2e-6);
}

TEST(RestoreMean, ASlowFactorCancels)
{
    const Region window{0, 0, 64, 64};
    const auto wave = [](int x) { return 2.0f + std::sin(0.03f * static_cast<float>(x)); };
    const TestImage truth = make_image(window, {"R"}, [&](int, int x, int) { return wave(x); });
    const TestImage dark =
        make_image(window, {"R"}, [&](int, int x, int) { return 0.3f * wave(x); });
    const NodeRun run = restore(dark, truth, 3);
    for (int y = 0; y < 64; ++y)
        for (int x = 0; x < 64; ++x)
            ASSERT_NEAR(run.image().view().at(0, x, y), truth.view().at(0, x, y),
                        0.03 * truth.view().at(0, x, y));
}

TEST(RestoreMean, WhereTheFilteredImageIsBlackTheReferenceStays)
{
    const Region window{0, 0, 30, 30};
    const TestImage black = make_image(window, {"R"}, [](int, int, int) { return 0.0f; });
    const TestImage reference = positive(window, 5);
    EXPECT_EQ(differing_floats(restore(black, reference, 2).image(), reference), 0u);
    const TestImage all = make_image(window, {"R"}, [](int, int, int) { return 1.0f; });
    EXPECT_EQ(differing_floats(balance(black, reference, all, 2).image(), reference), 0u);
}

TEST(RestoreMean, ChannelsMustAgree)
{
    const TestImage one = positive({0, 0, 8, 8}, 6);
    const TestImage three =
        make_image({0, 0, 8, 8}, {"R", "G", "B"}, [](int, int, int) { return 1.0f; });
    EXPECT_THROW(restore(one, three, 2), NodeError);
}

TEST(RestoreMean, ScalesByTheRatioOfTheMeans)
{
    const Region window{-2, 3, 29, 25};
    const TestImage image = positive(window, 3), reference = positive(window, 4);
    const NodeRun run = run_node("transform.restore_mean",
                                 {{"scale", std::int64_t{2}}, {"mode", std::string("scale")}},
                                 {{"image", {&image}}, {"reference", {&reference}}});
    Raster<double> expected = to_raster(image);
    const Raster<double> kf = spread(expected, 2), kn = spread(to_raster(reference), 2);
    for (std::size_t i = 0; i < expected.values.size(); ++i)
        expected.values[i] *= kn.values[i] / kf.values[i];
    expect_close(run.image("image"), expected, 1e-5);
}

TEST(RestoreMean, AlphaPassesThrough)
{
    const Region window{0, 0, 12, 9};
    const TestImage image = make_image(window, {"R", "A"}, [](int c, int x, int y) {
        return c == 0 ? 1.0f : static_cast<float>(x * y) / 100.0f;
    });
    const TestImage reference = make_image(window, {"R", "A"}, [](int, int, int) { return 2.0f; });
    const NodeRun run = restore(image, reference, 2);
    EXPECT_NEAR(run.image("image").view().at(0, 5, 5), 2.0f, 1e-5);
    EXPECT_EQ(run.image("image").view().at(1, 5, 5), 0.25f);
}

} // namespace
} // namespace rayloom
