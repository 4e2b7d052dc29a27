// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/plane_scene.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

namespace rayloom
{
namespace
{

using test::even_scene;
using test::filter_planes;
using test::noisy_scene;
using test::PlaneScene;
using test::run_node;
using test::TestImage;

ParamValues fit_params(int max_radius, double target, double range = 1.0)
{
    return {{"max_radius", std::int64_t{max_radius}},
            {"target_noise", target},
            {"range", range},
            {"range_scale", std::string("mean")}};
}

ParamValues fuse_params(int max_radius, const char* blend = "min")
{
    return {{"max_radius", std::int64_t{max_radius}}, {"blend", std::string(blend)}};
}

void expect_like_oracle(const PlaneScene& scene, bool blend_max)
{
    oracle::PlaneOptions o;
    o.max_radius = 5;
    o.target_noise = 0.05;
    o.blend_max = blend_max;
    const TestImage result =
        filter_planes(scene, fit_params(5, 0.05), fuse_params(5, blend_max ? "max" : "min"));
    const oracle::PlaneInput in = scene.for_oracle();
    const auto expected = fuse_all(in, o, fit_all(in, o));
    const Region& data = scene.image.desc.data;
    for (int y = 0; y < expected.height; ++y)
        for (int x = 0; x < expected.width; ++x)
            for (int c = 0; c < expected.channels; ++c)
                ASSERT_NEAR(result.view().at(c, data.x0 + x, data.y0 + y), expected.at(c, x, y),
                            2e-4 * expected.at(c, x, y))
                    << x << " " << y << " " << c;
}

TEST(FusePlanes, Oracle) { expect_like_oracle(noisy_scene({-3, 5, 33, 34}, 3, 0.15f, 3), false); }

TEST(FusePlanes, OracleBlendMaxOneColour)
{
    expect_like_oracle(noisy_scene({0, 0, 26, 23}, 1, 0.3f, 8), true);
}

TEST(FusePlanes, OraclePivot)
{
    PlaneScene scene = noisy_scene({-3, 5, 33, 34}, 3, 0.15f, 3);
    scene.pivot = test::make_image({-3, 5, 33, 34}, {"Y"}, [](int, int x, int y) {
        return 0.1f * static_cast<float>((5 * x + 3 * y + 70) % 13);
    });
    expect_like_oracle(scene, true);
}

TEST(FusePlanes, PixelsWithoutNormalsAreAveragedAmongThemselves)
{
    PlaneScene scene = noisy_scene({0, 0, 28, 24}, 3, 0.2f, 4);
    scene.parts.reset();
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < 24; ++y)
            for (int x = 0; x < 14; ++x) scene.normal->view().at(c, x, y) = 0.0f;
    expect_like_oracle(scene, false);
}

TEST(FusePlanes, LinearLightComesBack)
{
    const auto plane = [](int c, int x, int y) {
        return 2.0f + 0.03f * static_cast<float>(x) + 0.01f * static_cast<float>(y) +
               0.5f * static_cast<float>(c);
    };
    for (const int radius : {2, 5, 12}) {
        const TestImage result = filter_planes(even_scene({0, 0, 40, 30}, 3, plane, 1.0f),
                                               fit_params(radius, 0.0), fuse_params(radius));
        for (int y = 0; y < 30; ++y)
            for (int x = 0; x < 40; ++x)
                for (int c = 0; c < 3; ++c) {
                    // Beside the image's edge some quadrants are lines, and level.
                    const int edge = std::min({x, y, 39 - x, 29 - y});
                    ASSERT_NEAR(result.view().at(c, x, y), plane(c, x, y),
                                edge > radius ? 5e-5 : 0.03 * plane(c, x, y))
                        << radius << ": " << x << " " << y;
                }
    }
}

TEST(FusePlanes, ConstantLightComesBackToRounding)
{
    const TestImage result =
        filter_planes(even_scene(
                          {0, 0, 30, 30}, 3, [](int, int, int) { return 0.7f; }, 1.0f),
                      fit_params(8, 0.0), fuse_params(8));
    for (int y = 0; y < 30; ++y)
        for (int x = 0; x < 30; ++x) ASSERT_NEAR(result.view().at(1, x, y), 0.7f, 3e-6);
}

TEST(FusePlanes, ParabolaIsBiasedByLessThanTheCellSquaredOverTwelve)
{
    // f = x² over a hill far from zero, cells of Δ = 2·radius + 1.
    const auto parabola = [](int, int x, int) {
        return 1000.0f + static_cast<float>((x - 20) * (x - 20));
    };
    for (const int radius : {2, 4}) {
        const TestImage result = filter_planes(even_scene({0, 0, 41, 21}, 1, parabola, 100.0f),
                                               fit_params(radius, 0.0, 0.0), fuse_params(radius));
        const double cell = 2 * radius + 1;
        for (int x = 2 * radius + 1; x < 40 - 2 * radius; ++x)
            EXPECT_LT(std::abs(result.view().at(0, x, 10) - parabola(0, x, 10)), cell * cell / 12.0)
                << radius << ": " << x;
    }
}

TEST(FusePlanes, StepAtAnIdBoundaryStays)
{
    const auto step = [](int, int x, int) { return x < 15 ? 1.0f : 3.0f; };
    PlaneScene scene = even_scene({0, 0, 30, 20}, 3, step, 4.0f);
    scene.parts = test::make_image({0, 0, 30, 20}, {"id0", "coverage0"}, [](int c, int x, int) {
        return c == 1 ? 1.0f : x < 15 ? 7.0f : 8.0f;
    });
    const TestImage result = filter_planes(scene, fit_params(7, 0.0), fuse_params(7));
    for (int y = 0; y < 20; ++y)
        for (int x = 0; x < 30; ++x)
            ASSERT_NEAR(result.view().at(0, x, y), step(0, x, y), 1e-6) << x << " " << y;
    // Without ids it does not.
    scene.parts.reset();
    const TestImage blurred = filter_planes(scene, fit_params(7, 0.0), fuse_params(7));
    EXPECT_GT(std::abs(blurred.view().at(0, 14, 10) - 1.0f), 0.01f);
}

TEST(FusePlanes, SawTeethKeepTheirLight)
{
    // Faces of two directions, as in figure 3: what one receives the other does not see.
    const auto light = [](int, int x, int) { return (x / 3) % 2 == 0 ? 1.0f : 2.0f; };
    PlaneScene scene = even_scene({0, 0, 36, 20}, 1, light, 4.0f);
    scene.normal = test::make_image({0, 0, 36, 20}, {"X", "Y", "Z"}, [](int c, int x, int) {
        return c == 0 ? ((x / 3) % 2 == 0 ? 0.8f : -0.8f) : c == 1 ? 0.0f : 0.6f;
    });
    const TestImage result = filter_planes(scene, fit_params(9, 0.0), fuse_params(9));
    for (int x = 0; x < 36; ++x) EXPECT_NEAR(result.view().at(0, x, 10), light(0, x, 0), 1e-5);
}

TEST(FusePlanes, NoiseFalls)
{
    const PlaneScene noisy = noisy_scene({0, 0, 60, 50}, 3, 0.2f, 12);
    const PlaneScene clean = noisy_scene({0, 0, 60, 50}, 3, 0.0f, 12);
    const TestImage result = filter_planes(noisy, fit_params(8, 0.01), fuse_params(8));
    double before = 0.0, after = 0.0;
    for (int y = 0; y < 50; ++y)
        for (int x = 0; x < 60; ++x) {
            const float truth = clean.image.view().at(0, x, y);
            before += std::pow(noisy.image.view().at(0, x, y) - truth, 2);
            after += std::pow(result.view().at(0, x, y) - truth, 2);
        }
    EXPECT_LT(after, 0.15 * before);
}

TEST(FusePlanes, ThinObjectsShareTheirLight)
{
    // Two pixels wide, so that all of it is boundary; the wall behind it is brighter.
    const Region data{0, 0, 24, 40};
    const auto pole = [](int x) { return x == 11 || x == 12; };
    std::mt19937 random(3);
    std::normal_distribution<float> normal(0.0f, 0.2f);
    PlaneScene scene = even_scene(
        data, 1, [&](int, int x, int) { return (pole(x) ? 1.0f : 5.0f) * (1.0f + normal(random)); },
        0.04f);
    scene.parts = test::make_image(data, {"id0", "coverage0"}, [&](int c, int x, int) {
        return c == 1 ? 1.0f : pole(x) ? 7.0f : 8.0f;
    });
    scene.boundary = test::make_image(
        data, {"boundary"}, [](int, int x, int) { return x >= 10 && x <= 13 ? 1.0f : 0.0f; });
    const TestImage result = filter_planes(scene, fit_params(7, 0.0), fuse_params(7));
    double before = 0.0, after = 0.0;
    for (int y = 0; y < 40; ++y)
        for (int x = 11; x < 13; ++x) {
            before += std::pow(scene.image.view().at(0, x, y) - 1.0, 2);
            after += std::pow(result.view().at(0, x, y) - 1.0, 2);
        }
    EXPECT_LT(after, 0.3 * before);
}

TEST(FusePlanes, PlanesOfABoundaryCountAHundredth)
{
    // Level planes: of 3 in one column, of 1 beside it.
    const Region data{0, 0, 31, 20};
    const auto line = [](int x) { return x == 15; };
    PlaneScene scene = even_scene(
        data, 1, [&](int, int x, int) { return line(x) ? 3.0f : 1.0f; }, 1e-4f);
    scene.parts = test::make_image(data, {"id0", "coverage0"}, [&](int c, int x, int) {
        return c == 1 ? 1.0f : line(x) ? 7.0f : 8.0f;
    });
    const auto fitted = run_node("fit.plane", fit_params(2, 0.0), scene.inputs());
    scene.parts.reset();
    scene.boundary = test::make_image(data, {"boundary"},
                                      [&](int, int x, int) { return line(x) ? 1.0f : 0.0f; });
    const auto fused =
        run_node("fuse.planes", fuse_params(2), scene.inputs(&fitted.image("coefficients")));
    for (const int x : {13, 14, 15, 16, 17})
        EXPECT_NEAR(fused.image("image").view().at(0, x, 10), (4.0 + 0.01 * 3.0) / 4.01, 1e-5) << x;
}

TEST(FusePlanes, EveryPixelAnObjectOfItsOwnKeepsItself)
{
    PlaneScene scene = noisy_scene({0, 0, 20, 20}, 3, 0.3f, 2);
    scene.parts = test::make_image({0, 0, 20, 20}, {"id0", "coverage0"}, [](int c, int x, int y) {
        return c == 1 ? 1.0f : static_cast<float>(20 * y + x);
    });
    const TestImage result = filter_planes(scene, fit_params(6, 0.0), fuse_params(6));
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < 20; ++y)
            for (int x = 0; x < 20; ++x)
                ASSERT_FLOAT_EQ(result.view().at(c, x, y), scene.image.view().at(c, x, y));
}

TEST(FusePlanes, PixelsBetweenTheLatticeAreAsGood)
{
    const Region data{0, 0, 96, 90};
    PlaneScene flat = even_scene(
        data, 1, [](int, int, int) { return 1.0f; }, 0.04f);
    std::mt19937 random(3);
    std::normal_distribution<float> noise(1.0f, 0.2f);
    for (int y = 0; y < 90; ++y)
        for (float& v : flat.image.view().row_span(0, y)) v = noise(random);
    const auto errors = [&](int stride) {
        ParamValues fit = fit_params(8, 0.0), fuse = fuse_params(8, "max");
        fit["stride"] = fuse["stride"] = std::int64_t{stride};
        const TestImage result = filter_planes(flat, fit, fuse);
        std::array<double, 2> sums{}, n{};
        for (int y = 9; y < 81; ++y)
            for (int x = 9; x < 87; ++x) {
                const std::size_t between = x % stride != 0 || y % stride != 0 ? 1 : 0;
                sums[between] += std::pow(result.view().at(0, x, y) - 1.0, 2);
                n[between] += 1.0;
            }
        return std::pair{sums[0] / n[0], sums[1] / std::max(1.0, n[1])};
    };
    const double all = errors(1).first;
    for (const int stride : {2, 3}) {
        const auto [on, between] = errors(stride);
        EXPECT_NEAR(between / on, 1.0, 0.1) << stride;
        EXPECT_LT(between, 1.2 * all) << stride;
    }
}

TEST(FusePlanes, StrideOfTheSamePlanesChangesNothing)
{
    const PlaneScene scene = noisy_scene({-5, 3, 46, 38}, 3, 0.3f, 5);
    const auto planes = run_node("fit.plane", fit_params(6, 0.02), scene.inputs());
    const auto fused = [&](int stride) {
        ParamValues p = fuse_params(6);
        p["stride"] = std::int64_t{stride};
        return run_node("fuse.planes", p, scene.inputs(&planes.image("coefficients")));
    };
    const auto one = fused(1);
    for (const int stride : {2, 3})
        EXPECT_EQ(differing_floats(fused(stride).image("image"), one.image("image")), 0u) << stride;
}

/// Turns every image of the scene left to right within its data window.
void mirror(PlaneScene& scene)
{
    const auto turn = [](TestImage& image) {
        const Region& data = image.desc.data;
        for (int c = 0; c < image.view().channels(); ++c)
            for (int y = data.y0; y < data.y1; ++y)
                std::ranges::reverse(image.view().row_span(c, y));
    };
    turn(scene.image);
    turn(scene.variance);
    for (auto* image : {&scene.normal, &scene.boundary, &scene.parts, &scene.pivot})
        if (*image) turn(**image);
}

TEST(FusePlanes, AMirroredSceneGivesTheMirroredResultWithoutLattice)
{
    // The lattice of larger strides lies at absolute coordinates and does not turn with the scene.
    PlaneScene scene = noisy_scene({-5, 3, 46, 38}, 3, 0.3f, 5);
    ParamValues fit = fit_params(6, 0.02), fuse = fuse_params(6);
    fit["stride"] = fuse["stride"] = std::int64_t{1};
    const TestImage one = filter_planes(scene, fit, fuse);
    mirror(scene);
    const TestImage other = filter_planes(scene, fit, fuse);
    const Region& data = one.desc.data;
    for (int c = 0; c < 3; ++c)
        for (int y = data.y0; y < data.y1; ++y)
            for (int x = data.x0; x < data.x1; ++x) {
                const float v = one.view().at(c, x, y);
                ASSERT_NEAR(other.view().at(c, data.x0 + data.x1 - 1 - x, y), v, 1e-4f * v)
                    << x << " " << y << " " << c;
            }
}

TEST(FusePlanes, LightOfDarkPixelsCountsLess)
{
    // Radiance with one firefly, where the surface is all but black.
    const Region data{0, 0, 30, 30};
    PlaneScene scene = even_scene(
        data, 1, [](int, int x, int y) { return x == 15 && y == 15 ? 50.0f : 1.0f; }, 1.0f);
    const auto beside = [&] {
        return filter_planes(scene, fit_params(5, 0.0, 0.0), fuse_params(5)).view().at(0, 17, 15);
    };
    const float without = beside();
    scene.pivot = test::make_image(
        data, {"Y"}, [](int, int x, int y) { return x == 15 && y == 15 ? 1e-4f : 0.64f; });
    EXPECT_GT(without, 1.2f);
    EXPECT_NEAR(beside(), 1.0f, 0.2f * (without - 1.0f));
}

TEST(FusePlanes, NaNDoesNotSpread)
{
    PlaneScene scene = noisy_scene({0, 0, 24, 20}, 3, 0.2f, 9);
    scene.image.view().at(0, 5, 5) = std::nanf("");
    scene.normal->view().at(2, 8, 8) = std::nanf("");
    const TestImage result = filter_planes(scene, fit_params(5, 0.0), fuse_params(5));
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < 20; ++y)
            for (int x = 0; x < 24; ++x) ASSERT_TRUE(std::isfinite(result.view().at(c, x, y)));
}

TEST(FusePlanes, TilesAndTargetsGiveTheSameBits)
{
    const PlaneScene scene = noisy_scene({-5, 3, 46, 38}, 3, 0.3f, 5);
    const TestImage whole = filter_planes(scene, fit_params(6, 0.02), fuse_params(6));
    for (const auto& [w, h] : {std::pair{16, 16}, {7, 100}, {37, 3}}) {
        test::RunOptions tiles;
        tiles.tile_width = w;
        tiles.tile_height = h;
        EXPECT_EQ(differing_floats(filter_planes(scene, fit_params(6, 0.02), fuse_params(6), tiles),
                                   whole),
                  0u);
    }
    for (const auto target : hwy::SupportedAndGeneratedTargets()) {
        hwy::SetSupportedTargetsForTest(target);
        EXPECT_EQ(
            differing_floats(filter_planes(scene, fit_params(6, 0.02), fuse_params(6)), whole), 0u)
            << hwy::TargetName(target);
    }
    hwy::SetSupportedTargetsForTest(0);
}

TEST(FusePlanes, RefusesCoefficientsOfAnotherImage)
{
    const PlaneScene one = noisy_scene({0, 0, 8, 8}, 1, 0.2f, 1),
                     three = noisy_scene({0, 0, 8, 8}, 3, 0.2f, 1);
    const auto planes = run_node("fit.plane", fit_params(3, 0.1), one.inputs());
    EXPECT_THROW(
        run_node("fuse.planes", fuse_params(3), three.inputs(&planes.image("coefficients"))),
        NodeError);
}

} // namespace
} // namespace rayloom
