// SPDX-License-Identifier: Apache-2.0
#include "tests/support/raster.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace rayloom
{
namespace
{

using test::make_image;
using test::random_image;
using test::run_node;
using test::TestImage;

const Region window{-4, 3, 29, 24};

Table figures_of(const TestImage& image)
{
    return run_node("measure.channels", {}, {{"image", {&image}}}).tables.at("figures");
}

TEST(MeasureChannels, AgreesWithTwoPassesInDouble)
{
    const TestImage image = random_image(window, {"R", "G", "B", "A"}, 7);
    const Table figures = figures_of(image);
    ASSERT_EQ(figures.rows.size(), 4u);
    const auto n = static_cast<double>(window.pixels());
    for (int c = 0; c < 4; ++c) {
        const auto each_pixel = [&](const auto& use) {
            for (int y = window.y0; y < window.y1; ++y)
                for (int x = window.x0; x < window.x1; ++x)
                    use(static_cast<double>(image.view().at(c, x, y)));
        };
        double sum = 0.0, squares = 0.0, lowest = 1e30, highest = -1e30;
        each_pixel([&](double v) {
            sum += v;
            lowest = std::min(lowest, v);
            highest = std::max(highest, v);
        });
        const double mean = sum / n;
        each_pixel([&](double v) { squares += (v - mean) * (v - mean); });
        const auto row = static_cast<std::size_t>(c);
        EXPECT_EQ(figures.number("minimum", row), lowest);
        EXPECT_EQ(figures.number("maximum", row), highest);
        EXPECT_NEAR(figures.number("mean", row), mean, 1e-12 * std::abs(mean));
        const double deviation = std::sqrt(squares / n);
        EXPECT_NEAR(figures.number("deviation", row), deviation, 1e-12 * deviation);
        EXPECT_EQ(figures.number("finite", row), n);
        EXPECT_EQ(std::get<std::string>(figures.rows[row][0]), image.desc.channels[row]);
    }
}

TEST(MeasureChannels, KeepsASmallSpreadOverALargeMean)
{
    const TestImage image = make_image({0, 0, 100, 50}, {"Y"}, [](int, int x, int) {
        return x % 2 == 0 ? 65536.0f : 65536.0078125f;
    });
    const Table figures = figures_of(image);
    EXPECT_NEAR(figures.number("mean"), 65536.00390625, 1e-7);
    EXPECT_NEAR(figures.number("deviation"), 0.00390625, 1e-9);
}

TEST(MeasureChannels, CountsWhatIsNotFinite)
{
    constexpr float infinity = std::numeric_limits<float>::infinity();
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const TestImage image = make_image({0, 0, 3, 50}, {"mixed", "none"}, [&](int c, int x, int) {
        if (c == 1) return x == 0 ? nan : -infinity;
        return x == 0 ? nan : x == 1 ? infinity : 2.0f;
    });
    // More rows than are counted at once.
    const Table figures = figures_of(image);
    EXPECT_EQ(figures.number("minimum", 0), 2.0);
    EXPECT_EQ(figures.number("maximum", 0), 2.0);
    EXPECT_EQ(figures.number("deviation", 0), 0.0);
    EXPECT_EQ(figures.number("nan", 0), 50.0);
    EXPECT_EQ(figures.number("infinite", 0), 50.0);
    EXPECT_EQ(figures.number("finite", 1), 0.0);
    EXPECT_EQ(figures.number("infinite", 1), 100.0);
    EXPECT_TRUE(std::isnan(figures.number("mean", 1)));
    EXPECT_NE(figures.json().find("\"mean\": null"), std::string::npos);
}

} // namespace
} // namespace rayloom
