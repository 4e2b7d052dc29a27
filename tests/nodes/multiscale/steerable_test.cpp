// SPDX-License-Identifier: Apache-2.0
#include "nodes/multiscale/steerable_kernel.h"
#include "rayloom/core/error.h"
#include "rayloom/image/border.h"
#include "tests/oracle/steerable.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace rayloom
{
namespace
{

using test::make_image;
using test::NodeRun;
using test::run_node;
using test::TestImage;

TestImage noise(const Region& window, unsigned seed)
{
    std::mt19937 random(seed);
    std::normal_distribution<float> value(0.0f, 1.0f);
    return make_image(window, {"R"}, [&](int, int, int) { return value(random); });
}

TEST(Steerable, BandsFollowTheOracle)
{
    for (const Region& window : {Region{-5, 3, 24, 26}, Region{0, 0, 1, 19}, Region{2, 2, 3, 3}}) {
        const TestImage image = noise(window, 5);
        const NodeRun run =
            run_node("multiscale.steerable", {{"levels", std::int64_t{3}}}, {{"image", {&image}}});
        const oracle::PixelFunction pixel = [&](int x, int y) {
            return static_cast<double>(
                image.view().at(0, border_index(x, window.x0, window.x1, Border::mirror),
                                border_index(y, window.y0, window.y1, Border::mirror)));
        };
        for (int b = 0; b < steerable_band_count(3); ++b) {
            const SteerableBand band = steerable_band(b, 3);
            const TestImage& out = run.image("bands", static_cast<std::size_t>(b));
            EXPECT_EQ(out.desc.channels.front(), band.name() + ".R");
            EXPECT_EQ(out.desc.data, window.grown(steerable_halo(band)));
            const Region& r = out.desc.data;
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1; ++x) {
                    const double expected =
                        band.kind == SteerableBand::Kind::high ? oracle::steerable_high(pixel, x, y)
                        : band.kind == SteerableBand::Kind::low
                            ? oracle::steerable_low(pixel, 3, x, y)
                            : oracle::steerable_oriented(pixel, band.level, band.orientation, x, y);
                    ASSERT_NEAR(out.view().at(0, x, y), expected, 2e-6)
                        << band.name() << " at " << x << ", " << y;
                }
        }
    }
}

TEST(Steerable, GainsForIndependentNoise)
{
    const TestImage image = noise({0, 0, 400, 300}, 6);
    const NodeRun run =
        run_node("multiscale.steerable", {{"levels", std::int64_t{2}}}, {{"image", {&image}}});
    for (int b = 0; b < steerable_band_count(2) - 1; ++b) {
        const TestImage& band = run.image("bands", static_cast<std::size_t>(b));
        double sum = 0.0;
        for (int y = 16; y < 284; ++y)
            for (int x = 16; x < 384; ++x)
                sum += band.view().at(0, x, y) * static_cast<double>(band.view().at(0, x, y));
        EXPECT_NEAR(std::sqrt(sum / (268.0 * 368.0)), steerable_band(b, 2).white_noise_gain(),
                    0.03 * steerable_band(b, 2).white_noise_gain())
            << steerable_band(b, 2).name();
    }
}

TEST(Steerable, OrientationsAnswerToTheirDirection)
{
    // Gratings whose brightness changes along 0°, 45°, 90°, 135°.
    const double directions[4][2] = {
        {1.0, 0.0}, {M_SQRT1_2, M_SQRT1_2}, {0.0, 1.0}, {M_SQRT1_2, -M_SQRT1_2}};
    for (int d = 0; d < 4; ++d) {
        const TestImage image = make_image({0, 0, 64, 64}, {"Y"}, [&](int, int x, int y) {
            return static_cast<float>(
                std::sin(0.7 * (x * directions[d][0] + y * directions[d][1])));
        });
        const NodeRun run =
            run_node("multiscale.steerable", {{"levels", std::int64_t{1}}}, {{"image", {&image}}});
        double energy[4];
        for (int o = 0; o < 4; ++o) {
            energy[o] = 0.0;
            const TestImage& band = run.image("bands", static_cast<std::size_t>(o + 1));
            for (int y = 8; y < 56; ++y)
                for (int x = 8; x < 56; ++x)
                    energy[o] += std::pow(
                        band.view().at(0, x, y) / steerable_band(o + 1, 1).white_noise_gain(), 2.0);
        }
        for (int o = 0; o < 4; ++o) {
            if (o != d) {
                EXPECT_LT(energy[o], energy[d]) << "grating " << d << ", band " << o;
            }
            if (o == (d + 2) % 4) {
                EXPECT_LT(energy[o], 0.02 * energy[d]);
            }
        }
    }
}

TEST(Steerable, ABrightEdgeDoesNotComeBackOnTheOtherSide)
{
    const auto at = [](float edge) {
        const TestImage image = make_image({0, 0, 60, 40}, {"Y"}, [&](int, int x, int y) {
            return x == 0 ? edge : 0.1f * static_cast<float>((x * 7 + y * 3) % 5);
        });
        return run_node("multiscale.steerable", {{"levels", std::int64_t{3}}},
                        {{"image", {&image}}});
    };
    const NodeRun dark = at(0.0f), bright = at(1e6f);
    for (std::size_t b = 0; b < 14; ++b) {
        const Region r = dark.image("bands", b).desc.data;
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = 17; x < r.x1; ++x)
                ASSERT_EQ(dark.image("bands", b).view().at(0, x, y),
                          bright.image("bands", b).view().at(0, x, y))
                    << b << " at " << x << ", " << y;
    }
}

TEST(Steerable, NamesOfBandsAreRead)
{
    for (int b = 0; b < steerable_band_count(5); ++b) {
        const SteerableBand band = steerable_band(b, 5);
        EXPECT_EQ(band_of_channel(band.name() + ".R").name(), band.name());
        EXPECT_EQ(plain_channel(band.name() + ".R"), "R");
    }
    for (const char* name : {"R", "level1.R", "level0.band1.R", "level1.band5.R", "low.R", ""})
        EXPECT_THROW(band_of_channel(name), NodeError) << name;
}

} // namespace
} // namespace rayloom
