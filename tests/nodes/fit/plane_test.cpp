// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/planes_kernel.h"
#include "rayloom/core/error.h"
#include "tests/support/plane_scene.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cmath>
#include <limits>
#include <utility>

namespace rayloom
{
namespace
{

using test::even_scene;
using test::NodeInput;
using test::NodeRun;
using test::noisy_scene;
using test::PlaneScene;
using test::run_node;
using test::TestImage;

ParamValues fit_params(int max_radius, double target = 0.02, double range = 1.0,
                       const char* scale = "mean")
{
    return {{"max_radius", std::int64_t{max_radius}},
            {"target_noise", target},
            {"range", range},
            {"range_scale", std::string(scale)}};
}

void expect_like_oracle(const PlaneScene& scene, const ParamValues& params,
                        const oracle::PlaneOptions& options)
{
    const NodeRun run = run_node("fit.plane", params, scene.inputs());
    const TestImage& k = run.image("coefficients");
    const oracle::PlaneInput in = scene.for_oracle();
    const Region& data = scene.image.desc.data;
    const int colours = scene.image.desc.channel_count();
    int other_radius = 0;
    bool grew = false, stayed = false;
    for (int y = data.y0; y < data.y1; ++y)
        for (int x = data.x0; x < data.x1; ++x) {
            const auto expected = oracle::fit_centre(in, options, x - data.x0, y - data.y0);
            const auto radius = static_cast<int>(k.view().at(0, x, y));
            grew = grew || radius > options.min_radius;
            stayed = stayed || radius < options.max_radius;
            if (radius != expected.radius) {
                ++other_radius;
                continue;
            }
            EXPECT_NEAR(k.view().at(1, x, y), expected.noise, 2e-4 * expected.noise + 1e-6);
            for (int p = 0; p < 5; ++p)
                for (int c = 0; c < colours; ++c)
                    for (int i = 0; i < 3; ++i)
                        ASSERT_NEAR(
                            k.view().at(2 + (p * colours + c) * 3 + i, x, y),
                            expected.planes[static_cast<std::size_t>(p)][static_cast<std::size_t>(
                                c)][static_cast<std::size_t>(i)],
                            2e-4)
                            << x << " " << y << " plane " << p << " colour " << c << " " << i;
        }
    EXPECT_LE(other_radius, 2);
    EXPECT_TRUE(grew && stayed) << "the case must have something to decide";
}

TEST(FitPlane, OracleThreeColours)
{
    oracle::PlaneOptions o;
    o.max_radius = 6;
    o.target_noise = 0.04;
    expect_like_oracle(noisy_scene({-3, 5, 37, 40}, 3, 0.15f, 3), fit_params(6, 0.04), o);
}

TEST(FitPlane, OracleOneColourRangeByNoise)
{
    oracle::PlaneOptions o;
    o.max_radius = 5;
    o.target_noise = 0.1;
    o.range = 2.0;
    o.range_by_noise = true;
    expect_like_oracle(noisy_scene({0, 0, 30, 21}, 1, 0.4f, 4), fit_params(5, 0.1, 2.0, "noise"),
                       o);
}

TEST(FitPlane, NormalsAreFoundByName)
{
    PlaneScene scene = noisy_scene({0, 0, 40, 30}, 3, 0.1f, 5);
    const NodeRun expected = run_node("fit.plane", fit_params(6), scene.inputs());
    const TestImage normal = std::move(*scene.normal);
    scene.normal =
        test::make_image(normal.desc.data, {"depth", "X", "Y", "Z"}, [&](int c, int x, int y) {
            return c == 0 ? static_cast<float>(x) : normal.view().at(c - 1, x, y);
        });
    const NodeRun run = run_node("fit.plane", fit_params(6), scene.inputs());
    EXPECT_EQ(test::differing_floats(run.image("coefficients"), expected.image("coefficients")),
              0u);
}

TEST(FitPlane, PivotIsTheColourWhereverItStands)
{
    PlaneScene scene = noisy_scene({0, 0, 40, 30}, 3, 0.1f, 5);
    const auto coefficients = [&](std::vector<std::string> names) {
        const int first = names[0] == "A" ? 1 : 0;
        scene.pivot = test::make_image({0, 0, 40, 30}, names, [&](int c, int x, int y) {
            return 0.1f * static_cast<float>((5 * x + 3 * y + 2 * (c - first + 1)) % 13);
        });
        return run_node("fit.plane", fit_params(6), scene.inputs());
    };
    const NodeRun plain = coefficients({"R", "G", "B"}),
                  behind = coefficients({"A", "R", "G", "B"});
    EXPECT_EQ(test::differing_floats(plain.image("coefficients"), behind.image("coefficients")),
              0u);
}

TEST(FitPlane, OracleEverySize)
{
    oracle::PlaneOptions o;
    o.max_radius = 7;
    o.growth = 0.0;
    o.target_noise = 0.05;
    ParamValues p = fit_params(7, 0.05);
    p["growth"] = 0.0;
    expect_like_oracle(noisy_scene({0, 0, 33, 20}, 1, 0.2f, 6), p, o);
}

TEST(FitPlane, OracleOtherLattices)
{
    for (const int stride : {1, 2, 3}) {
        oracle::PlaneOptions o;
        o.max_radius = 6;
        o.target_noise = 0.04;
        o.stride = stride;
        o.dense = 2;
        ParamValues p = fit_params(6, 0.04);
        p["stride"] = std::int64_t{stride};
        p["dense"] = std::int64_t{2};
        expect_like_oracle(noisy_scene({-4, 5, 29, 31}, 1, 0.2f, 3), p, o);
    }
}

TEST(FitPlane, OraclePivot)
{
    oracle::PlaneOptions o;
    o.max_radius = 6;
    o.target_noise = 0.04;
    PlaneScene scene = noisy_scene({-3, 5, 37, 40}, 3, 0.15f, 3);
    scene.pivot = test::make_image({-3, 5, 37, 40}, {"R", "G", "B"}, [](int c, int x, int y) {
        return x == y ? 0.0f : 0.1f * static_cast<float>((5 * x + 3 * y + c + 70) % 13);
    });
    expect_like_oracle(scene, fit_params(6, 0.04), o);
}

TEST(FitPlane, OnlyTheLatticeGrowsOn)
{
    PlaneScene scene = even_scene(
        {-7, 2, 38, 40}, 1, [](int, int, int) { return 1.0f; }, 1.0f);
    ParamValues p = fit_params(9, 0.0);
    p["dense"] = std::int64_t{3};
    const auto radius = [&](const NodeRun& run, int x, int y) {
        return run.image("coefficients").view().at(0, x, y);
    };
    for (const int stride : {1, 2, 3}) {
        p["stride"] = std::int64_t{stride};
        const NodeRun run = run_node("fit.plane", p, scene.inputs());
        for (int y = 4; y < 38; ++y)
            for (int x = -5; x < 36; ++x)
                ASSERT_EQ(radius(run, x, y), x % stride == 0 && y % stride == 0 ? 9.0f : 0.0f)
                    << stride << ": " << x << " " << y;
    }
    // A column of its own that the lattice passes by.
    p["stride"] = std::int64_t{2};
    scene.parts = test::make_image({-7, 2, 38, 40}, {"id0", "coverage0"}, [](int c, int x, int) {
        return c == 1 ? 1.0f : x == 13 ? 5.0f : 4.0f;
    });
    const NodeRun alone = run_node("fit.plane", p, scene.inputs());
    // One whose neighbours on the lattice count next to nothing.
    scene.parts.reset();
    scene.boundary = test::make_image({-7, 2, 38, 40}, {"boundary"}, [](int, int x, int) {
        return x == 12 || x == 14 ? 1.0f : 0.0f;
    });
    const NodeRun beside = run_node("fit.plane", p, scene.inputs());
    for (int y = 4; y < 38; ++y)
        for (const NodeRun* run : {&alone, &beside}) {
            EXPECT_EQ(radius(*run, 13, y), 9.0f);
            EXPECT_EQ(radius(*run, 12, y), y % 2 == 0 ? 9.0f : 0.0f);
            EXPECT_EQ(radius(*run, 11, y), 0.0f);
        }
}

TEST(FitPlane, SizesGrowByAShareOfThemselves)
{
    PlaneSettings s;
    s.growth = 0.0f;
    EXPECT_EQ(plane_radii(s), (std::vector<int>{2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}));
    s.growth = 0.5f;
    EXPECT_EQ(plane_radii(s), (std::vector<int>{2, 3, 4, 6, 9, 15}));
    s.growth = 1.0f;
    EXPECT_EQ(plane_radii(s), (std::vector<int>{2, 4, 8, 15}));
    s.min_radius = s.max_radius = 5;
    EXPECT_EQ(plane_radii(s), (std::vector<int>{5}));
}

TEST(FitPlane, PlaneIsFoundWithAnyRadius)
{
    const auto plane = [](int c, int x, int y) {
        return 3.0f + 0.05f * static_cast<float>(x) - 0.03f * static_cast<float>(y) +
               static_cast<float>(c);
    };
    for (const int radius : {2, 3, 7, 15}) {
        const PlaneScene scene = even_scene({0, 0, 40, 36}, 3, plane, 0.01f);
        ParamValues p = fit_params(radius, 0.0);
        p["min_radius"] = std::int64_t{radius};
        const NodeRun run = run_node("fit.plane", p, scene.inputs());
        const TestImage& k = run.image("coefficients");
        for (const auto& [x, y] : {std::pair{0, 0}, {20, 18}, {39, 3}, {11, 35}})
            for (int square = 0; square < 5; ++square)
                for (int c = 0; c < 3; ++c) {
                    // At the image's edge a quadrant may be a line: then it is level.
                    if (square > 0 && x != 20) continue;
                    const int first = 2 + (square * 3 + c) * 3;
                    EXPECT_NEAR(k.view().at(first, x, y), 0.05, 1e-5);
                    EXPECT_NEAR(k.view().at(first + 1, x, y), -0.03, 1e-5);
                    EXPECT_NEAR(k.view().at(first + 2, x, y), plane(c, x, y), 1e-5);
                }
    }
}

TEST(FitPlane, QuietImageStaysSmallAndNoisyOneGrows)
{
    const auto flat = [](int, int, int) { return 1.0f; };
    const auto radius_at = [&](float variance) {
        const NodeRun run = run_node("fit.plane", fit_params(9, 0.02),
                                     even_scene({0, 0, 32, 32}, 1, flat, variance).inputs());
        return run.image("coefficients").view().at(0, 18, 18);
    };
    EXPECT_EQ(radius_at(0.0f), 2.0f);
    EXPECT_EQ(radius_at(1e-6f), 2.0f);
    EXPECT_EQ(radius_at(1.0f), 9.0f);
    const float some = radius_at(0.01f);
    EXPECT_GT(some, 2.0f);
    EXPECT_LT(some, 9.0f);
}

TEST(FitPlane, StopsBeforeShadow)
{
    const auto shadow = [](int, int x, int) { return x < 20 ? 1.0f : 0.2f; };
    ParamValues p = fit_params(9, 0.0001, 0.0);
    p["confidence"] = 0.0;
    p["stride"] = std::int64_t{1};
    const NodeRun run =
        run_node("fit.plane", p, even_scene({0, 0, 40, 24}, 1, shadow, 0.01f).inputs());
    const auto radius = [&](int x) { return run.image("coefficients").view().at(0, x, 12); };
    EXPECT_EQ(radius(5), 9.0f);
    EXPECT_LT(radius(16), 9.0f);
    EXPECT_GT(radius(12), radius(17));
}

TEST(FitPlane, DegenerateInputStaysFinite)
{
    constexpr float nan = std::numeric_limits<float>::quiet_NaN();
    constexpr float inf = std::numeric_limits<float>::infinity();
    PlaneScene scene = noisy_scene({0, 0, 24, 20}, 3, 0.2f, 9);
    scene.image.view().at(0, 5, 5) = nan;
    scene.image.view().at(1, 6, 5) = inf;
    scene.variance.view().at(2, 9, 9) = nan;
    scene.variance.view().at(2, 9, 10) = -1.0f;
    for (int x = 0; x < 24; ++x) scene.normal->view().at(1, x, 7) = nan;
    scene.boundary->view().at(0, 3, 3) = nan;
    scene.parts->view().at(0, 12, 12) = nan;
    scene.parts->view().at(1, 13, 13) = 0.0f;
    const NodeRun run = run_node("fit.plane", fit_params(5), scene.inputs());
    const TestImage& k = run.image("coefficients");
    for (int c = 0; c < k.desc.channel_count(); ++c)
        for (int y = 0; y < 20; ++y)
            for (int x = 0; x < 24; ++x)
                ASSERT_TRUE(std::isfinite(k.view().at(c, x, y))) << c << " " << x << " " << y;
}

TEST(FitPlane, TilesAndTargetsGiveTheSameBits)
{
    const PlaneScene scene = noisy_scene({-5, 3, 46, 38}, 3, 0.3f, 5);
    const ParamValues p = fit_params(6);
    const NodeRun whole = run_node("fit.plane", p, scene.inputs());
    for (const auto& [w, h] : {std::pair{16, 16}, {7, 100}, {37, 3}}) {
        test::RunOptions tiles;
        tiles.tile_width = w;
        tiles.tile_height = h;
        EXPECT_EQ(
            differing_floats(run_node("fit.plane", p, scene.inputs(), tiles).image("coefficients"),
                             whole.image("coefficients")),
            0u);
    }
    for (const auto target : hwy::SupportedAndGeneratedTargets()) {
        hwy::SetSupportedTargetsForTest(target);
        EXPECT_EQ(differing_floats(run_node("fit.plane", p, scene.inputs()).image("coefficients"),
                                   whole.image("coefficients")),
                  0u)
            << hwy::TargetName(target);
    }
    hwy::SetSupportedTargetsForTest(0);
}

TEST(FitPlane, ImageAndMarksAreColoursWhereverTheyStand)
{
    PlaneScene scene = noisy_scene({0, 0, 40, 30}, 3, 0.1f, 5);
    TestImage image = std::move(scene.image);
    const auto marks = [](int c, int x, int y) { return (x + 2 * y + c) % 5 == 0 ? 1.0f : 0.0f; };
    const auto coefficients = [&](bool behind) {
        const std::vector<std::string> names = behind ? std::vector<std::string>{"A", "R", "G", "B"}
                                                      : std::vector<std::string>{"R", "G", "B"};
        const int first = behind ? 1 : 0;
        scene.image = test::make_image(image.desc.data, names, [&](int c, int x, int y) {
            return c < first ? 7.0f : image.view().at(c - first, x, y);
        });
        const TestImage marked = test::make_image(image.desc.data, names, [&](int c, int x, int y) {
            return c < first ? 1.0f : marks(c - first, x, y);
        });
        std::vector<NodeInput> inputs = scene.inputs();
        inputs.push_back({"marked", {&marked}});
        return run_node("fit.plane", fit_params(6), inputs);
    };
    const NodeRun plain = coefficients(false), behind = coefficients(true);
    EXPECT_EQ(test::differing_floats(plain.image("coefficients"), behind.image("coefficients")),
              0u);
    // And marks make a difference.
    scene.image = std::move(image);
    const NodeRun without = run_node("fit.plane", fit_params(6), scene.inputs());
    EXPECT_GT(test::differing_floats(plain.image("coefficients"), without.image("coefficients")),
              0u);
}

TEST(FitPlane, RefusesWhatDoesNotFit)
{
    PlaneScene apart = noisy_scene({0, 0, 8, 8}, 3, 0.2f, 1);
    apart.pivot =
        test::make_image({0, 0, 8, 8}, {"R", "A", "G", "B"}, [](int, int, int) { return 1.0f; });
    EXPECT_THROW(run_node("fit.plane", fit_params(3), apart.inputs()), NodeError);
    const PlaneScene scene = noisy_scene({0, 0, 8, 8}, 3, 0.2f, 1);
    ParamValues p = fit_params(3);
    p["min_radius"] = std::int64_t{4};
    EXPECT_THROW(run_node("fit.plane", p, scene.inputs()), NodeError);
    const TestImage two =
        test::make_image({0, 0, 8, 8}, {"U", "V"}, [](int, int, int) { return 1.0f; });
    EXPECT_THROW(run_node("fit.plane", fit_params(3), {{"image", {&two}}, {"variance", {&two}}}),
                 NodeError);
}

} // namespace
} // namespace rayloom
