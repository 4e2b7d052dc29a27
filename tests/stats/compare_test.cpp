// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/compare.h"

#include "rayloom/core/error.h"
#include "rayloom/stats/colour_map.h"

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <limits>
#include <vector>

namespace rayloom
{
namespace
{

ImageBuffer grey(float value, int width = 24)
{
    ImageBuffer image(Region{0, 0, width, 20}, 3);
    image.fill(value);
    return image;
}

TEST(Compare, TwoImagesAgainstAReference)
{
    const ImageBuffer a = grey(0.55f), b = grey(0.6f), reference = grey(0.5f);
    const Comparison c = compare_images(a.view(), b.view(), reference.view());
    EXPECT_NEAR(c.equal_error_sample_factor(), 4.0, 1e-5); // half the error: a quarter, squared
    const YAML::Node json = YAML::Load(c.json());
    EXPECT_NEAR(json["a_over_b"]["rmse"].as<double>(), 0.5, 1e-6);
    EXPECT_NEAR(json["a_over_b"]["relmse"].as<double>(), 0.25, 1e-6);
    EXPECT_NEAR(json["psnr_gain"].as<double>(), 20.0 * std::log10(2.0), 1e-5);
    EXPECT_NEAR(json["equal_error_sample_factor"].as<double>(), 4.0, 1e-5);
    EXPECT_NEAR(json["a"]["rmse"].as<double>(), 0.05, 1e-7);
    EXPECT_NEAR(json["b"]["rmse"].as<double>(), 0.1, 1e-7);
    EXPECT_NE(c.text().find("equal_error_sample_factor"), std::string::npos);
}

TEST(Compare, TwoImagesAlone)
{
    const ImageBuffer a = grey(0.55f), b = grey(0.5f);
    const Comparison c = compare_images(a.view(), b.view());
    EXPECT_FALSE(c.b.has_value());
    EXPECT_TRUE(std::isnan(c.equal_error_sample_factor()));
    const YAML::Node json = YAML::Load(c.json());
    EXPECT_NEAR(json["rmse"].as<double>(), 0.05, 1e-7);
    EXPECT_EQ(c.text().find("equal_error"), std::string::npos);
    // Equal images: PSNR is infinite, which JSON does not have.
    const Comparison same = compare_images(a.view(), a.view(), a.view());
    EXPECT_TRUE(YAML::Load(same.json())["a"]["psnr"].IsNull());
    EXPECT_FALSE(YAML::Load(same.json())["a_over_b"]["rmse"].IsDefined());
    EXPECT_THROW(compare_images(a.view(), grey(0.5f, 25).view()), InputError);
}

TEST(Compare, LimitsAreReadAndHeld)
{
    EXPECT_EQ(parse_error_limit("flip=0.05").value, 0.05);
    EXPECT_THROW(parse_error_limit("flip"), UsageError);
    EXPECT_THROW(parse_error_limit("flip=five"), UsageError);
    EXPECT_THROW(parse_error_limit("flip=0.5x"), UsageError);
    try {
        parse_error_limit("rmsee=1");
        FAIL();
    } catch (const UsageError& e) {
        EXPECT_NE(std::string(e.what()).find("did you mean 'rmse'"), std::string::npos);
    }
    const ImageBuffer a = grey(0.6f), b = grey(0.5f);
    const ErrorMeasures m = measure_errors(a.view(), b.view());
    const std::vector<ErrorLimit> held{{"rmse", 0.11}, {"psnr", 19.9}, {"ssim", 0.9}};
    EXPECT_TRUE(broken_limits(m, held).empty());
    const std::vector<ErrorLimit> broken{{"rmse", 0.09}, {"psnr", 20.1}, {"ssim", 1.0}};
    EXPECT_EQ(broken_limits(m, broken).size(), 3u);
    ErrorMeasures nothing;
    EXPECT_EQ(broken_limits(nothing, held).size(), 3u);
}

TEST(Compare, PixelsThatAreNotFiniteBreakALimit)
{
    ImageBuffer a = grey(0.6f);
    a.view().at(1, 3, 4) = std::numeric_limits<float>::quiet_NaN();
    const ImageBuffer b = grey(0.5f);
    const ErrorMeasures m = measure_errors(a.view(), b.view());
    EXPECT_TRUE(broken_limits(m, {}).empty());
    EXPECT_EQ(broken_limits(m, std::vector<ErrorLimit>{{"rmse", 10}}).size(), 1u);
    const ErrorLimit one = parse_error_limit("non_finite_pixels=1"), none{one.measure, 0.0};
    EXPECT_TRUE(broken_limits(m, std::vector{one}).empty());
    EXPECT_EQ(broken_limits(m, std::vector{none}).size(), 1u);
}

TEST(Compare, ARatioOfNoErrorToSomeIsNought)
{
    const ImageBuffer reference = grey(0.5f), b = grey(0.6f);
    const YAML::Node json =
        YAML::Load(compare_images(reference.view(), b.view(), reference.view()).json());
    ASSERT_TRUE(json["a_over_b"]["rmse"].IsDefined());
    EXPECT_EQ(json["a_over_b"]["rmse"].as<double>(), 0.0);
}

TEST(Compare, ThePicturesRangeCountsEveryRow)
{
    const ImageBuffer reference = grey(0.5f);
    for (const int row : {0, 19}) {
        ImageBuffer image = grey(0.5f);
        for (int x = 0; x < 24; ++x) image.view().at(0, x, row) = 0.8f;
        const ErrorPicture p = error_picture(image.view(), reference.view(), ErrorMap::absolute);
        EXPECT_NEAR(p.high, 0.1, 1e-6) << row;
    }
}

TEST(Compare, PictureSpreadsTheErrorsAndIgnoresOneFireFly)
{
    const ImageBuffer reference = grey(0.5f);
    ImageBuffer image = grey(0.5f);
    for (int y = 0; y < 20; ++y) image.view().at(0, 3, y) = 0.8f;
    image.view().at(1, 9, 9) = 1e6f;
    const ErrorPicture p = error_picture(image.view(), reference.view(), ErrorMap::absolute);
    EXPECT_NEAR(p.high, 0.1, 1e-6);
    const auto darkest = map_colour(0.0), brightest = map_colour(1.0);
    for (int c = 0; c < 3; ++c) {
        EXPECT_EQ(p.srgb.view().at(c, 15, 15), darkest[static_cast<std::size_t>(c)]);
        EXPECT_EQ(p.srgb.view().at(c, 3, 4), brightest[static_cast<std::size_t>(c)]);
        EXPECT_EQ(p.srgb.view().at(c, 9, 9), brightest[static_cast<std::size_t>(c)]);
    }
    EXPECT_EQ(error_picture(image.view(), reference.view(), ErrorMap::flip).high, 1.0);
    EXPECT_GT(error_picture(reference.view(), reference.view(), ErrorMap::relative).high, 0.0);
}

std::array<double, 3> lab_of(std::array<double, 3> linear)
{
    const double x = (0.4124 * linear[0] + 0.3576 * linear[1] + 0.1805 * linear[2]) / 0.9505;
    const double y = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
    const double z = (0.0193 * linear[0] + 0.1192 * linear[1] + 0.9505 * linear[2]) / 1.089;
    const auto f = [](double t) { return t > 0.008856 ? std::cbrt(t) : 7.787 * t + 16.0 / 116.0; };
    return {116 * f(y) - 16, 500 * (f(x) - f(y)), 200 * (f(y) - f(z))};
}

TEST(ColourMap, ARangeIsSpreadOverAllOfIt)
{
    ImageBuffer image(Region{-1, 2, 4, 3}, 1);
    const float values[] = {1.0f, 2.0f, 5.0f, 6.0f, 9.0f};
    for (int x = -1; x < 4; ++x) image.view().at(0, x, 2) = values[x + 1];
    const ImageBuffer colours = map_colours(image.view(), 2.0, 6.0);
    const double places[] = {0.0, 0.0, 0.75, 1.0, 1.0};
    for (int x = -1; x < 4; ++x)
        for (int c = 0; c < 3; ++c)
            EXPECT_EQ(colours.view().at(c, x, 2),
                      map_colour(places[x + 1])[static_cast<std::size_t>(c)])
                << x << " " << c;
}

TEST(ColourMap, StepsAreEvenAndSurviveColourBlindness)
{
    // Deuteranopia and protanopia after Viénot, Brettel and Mollon (1999), on linear sRGB.
    const std::array<std::array<double, 3>, 3> normal{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}},
        deuteranope{{{0.29275, 0.70725, 0}, {0.29275, 0.70725, 0}, {-0.02234, 0.02234, 1}}},
        protanope{{{0.11238, 0.88762, 0}, {0.11238, 0.88762, 0}, {0.00401, -0.00401, 1}}};
    for (const auto& sight : {normal, deuteranope, protanope}) {
        double shortest = 1e9, longest = 0.0;
        std::array<double, 3> last{};
        constexpr int steps = 32;
        for (int i = 0; i <= steps; ++i) {
            const auto srgb = map_colour(static_cast<double>(i) / steps);
            std::array<double, 3> linear{}, seen{};
            for (std::size_t c = 0; c < 3; ++c) {
                const double v = srgb[c];
                linear[c] = v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
            }
            for (std::size_t r = 0; r < 3; ++r)
                for (std::size_t c = 0; c < 3; ++c) seen[r] += sight[r][c] * linear[c];
            const auto lab = lab_of(seen);
            if (i > 0) {
                EXPECT_GT(lab[0], last[0] + 1.0) << "lightness rises in every step, step " << i;
                const double step =
                    std::hypot(lab[0] - last[0], lab[1] - last[1], lab[2] - last[2]);
                shortest = std::min(shortest, step);
                longest = std::max(longest, step);
            }
            last = lab;
        }
        if (sight == normal) {
            EXPECT_LT(longest / shortest, 1.08);
        }
        EXPECT_LT(longest / shortest, 3.0);
    }
    EXPECT_EQ(map_colour(std::nan("")), map_colour(0.0));
    EXPECT_EQ(map_colour(7.0), map_colour(1.0));
}

} // namespace
} // namespace rayloom
