// SPDX-License-Identifier: Apache-2.0
// Error of fitted planes by the condition of the very system each of them solves, and of the mean
// that takes a plane's place where the pixels hardly spread.
#include "tests/oracle/planes.h"
#include "tests/stress/error_budget.h"
#include "tests/support/plane_scene.h"
#include "tests/support/raster.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <map>

namespace rayloom::test::budget
{
namespace
{

/// A surface of which the pixels on one line count, and all others by `share`.
struct Line {
    int along_x, along_y; ///< its direction

    bool has(int x, int y) const
    {
        const int across = x * along_y - y * along_x;
        return 2 * std::abs(across) < std::max(std::abs(along_x), std::abs(along_y)) + 1;
    }
};

/// Around (0, 0); noise of 5 %, or none.
PlaneScene line_scene(const Line& line, double share, int side, bool noisy)
{
    const Region window{-side, -side, side + 1, side + 1};
    std::mt19937 random(3);
    PlaneScene scene = even_scene(
        window, 3,
        [&](int c, int x, int y) {
            const double light = 1.0 + 0.2 * c + 0.01 * (x - 0.5 * y);
            return static_cast<float>(light * (1.0 + (noisy ? 0.05 * steady_noise(random) : 0.0)));
        },
        0.0025f);
    scene.parts =
        make_image(window, {"id0", "coverage0", "id1", "coverage1"}, [&](int c, int x, int y) {
            if (c % 2 == 0) return 3.0f + static_cast<float>(c);
            const double first = line.has(x, y) ? 1.0 : share;
            return static_cast<float>(c == 1 ? first : 1.0 - first);
        });
    return scene;
}

/// Errors by decade of the condition; of the mean as the surface by radius.
struct ByCondition {
    std::map<int, Error> plane, mean, surface;
};

/// The planes of one centre, (0, 0) of the scene.
void look(const PlaneScene& scene, const TestImage& coefficients, const Line& line, int radius,
          const oracle::PlaneOptions& options, int x, int y, bool noisy, ByCondition& errors)
{
    const Region& window = scene.image.desc.data;
    const auto systems =
        oracle::plane_systems(scene.for_oracle(), options, x - window.x0, y - window.y0, radius);
    for (int p = 0; p < 5; ++p) {
        const oracle::PlaneSystem& system = systems[static_cast<std::size_t>(p)];
        // Float may decide otherwise.
        if (std::fabs(system.spread - 1.0) < 0.01 || !(system.condition < 1e8)) continue;
        const int decade = static_cast<int>(std::log10(system.condition));
        for (int c = 0; c < 3; ++c) {
            const auto colour = static_cast<std::size_t>(c);
            const auto found = [&](int i) {
                return static_cast<double>(coefficients.view().at(2 + (p * 3 + c) * 3 + i, x, y));
            };
            const double mean = system.mean[colour];
            if (system.spread > 1.0) {
                if (!noisy) continue;
                // The farthest a plane of that size is read.
                const auto& truth = system.plane[colour];
                const double off =
                    radius * (std::fabs(found(0) - truth[0]) + std::fabs(found(1) - truth[1])) +
                    std::fabs(found(2) - truth[2]);
                errors.plane[decade].add(off, 0.0, mean);
                continue;
            }
            EXPECT_EQ(found(0), 0.0);
            EXPECT_EQ(found(1), 0.0);
            if (noisy) {
                errors.mean[decade].add(found(2), mean);
                continue;
            }
            for (int v = y - radius; v <= y + radius; ++v)
                for (int u = x - radius; u <= x + radius; ++u) {
                    const int q = p - 1;
                    const bool here = p == 0 || (((q & 1) != 0 ? u <= x : u >= x) &&
                                                 ((q & 2) != 0 ? v <= y : v >= y));
                    if (here && line.has(u, v))
                        errors.surface[radius].add(
                            found(2), static_cast<double>(scene.image.view().at(c, u, v)));
                }
        }
    }
}

void conditions(Table& table)
{
    ByCondition errors;
    for (const int radius : {4, 15, 24}) {
        const ParamValues fit{{"min_radius", std::int64_t{radius}},
                              {"max_radius", std::int64_t{radius}},
                              {"target_noise", 0.0},
                              {"range", 0.0},
                              {"range_scale", std::string("mean")}};
        oracle::PlaneOptions options;
        options.min_radius = options.max_radius = radius;
        options.target_noise = 0.0;
        options.range = 0.0;
        for (const Line& line : {Line{1, 0}, Line{0, 1}, Line{1, 1}, Line{2, 1}, Line{-1, 3}})
            for (double share = 1.0; share > (radius > 15 ? 1e-3 : 1e-9); share *= 0.4)
                for (const bool noisy : {true, false}) {
                    const PlaneScene scene = line_scene(line, share, radius, noisy);
                    const NodeRun run = run_node("fit.plane", fit, scene.inputs());
                    look(scene, run.image("coefficients"), line, radius, options, 0, 0, noisy,
                         errors);
                }
    }
    const auto add = [&](const char* kernel, const char* against,
                         const std::map<int, Error>& decades) {
        for (const auto& [decade, error] : decades) {
            char text[80];
            std::snprintf(text, sizeof text, "condition 1e%d to 1e%d", decade, decade + 1);
            table.push_back({kernel, text, against, error});
        }
    };
    add("fit.plane, plane over its square", "mean light", errors.plane);
    add("fit.plane, mean in the place of a plane", itself, errors.mean);
    for (const auto& [radius, error] : errors.surface)
        table.push_back({"fit.plane, that mean as the surface",
                         "rises 1 % a pixel, half-size " + std::to_string(radius), itself, error});
}

/// Both nodes: what a filter makes of a scene.
void filtered(Table& table)
{
    const ParamValues fit{{"max_radius", std::int64_t{4}},
                          {"target_noise", 0.0},
                          {"range", 0.0},
                          {"range_scale", std::string("mean")}};
    const ParamValues fuse{{"max_radius", std::int64_t{4}}, {"blend", std::string("min")}};
    oracle::PlaneOptions options;
    options.max_radius = 4;
    options.target_noise = 0.0;
    options.range = 0.0;
    const Region window{0, 0, 27, 21};
    const auto add = [&](const PlaneScene& scene, const std::string& input) {
        const TestImage result = filter_planes(scene, fit, fuse);
        const oracle::PlaneInput in = scene.for_oracle();
        const oracle::Raster<double> truth = fuse_all(in, options, fit_all(in, options));
        Error error;
        for (int c = 0; c < truth.channels; ++c)
            for (int y = 0; y < truth.height; ++y)
                for (int x = 0; x < truth.width; ++x)
                    error.add(static_cast<double>(result.view().at(c, x, y)), truth.at(c, x, y));
        table.push_back({"fit.plane and fuse.planes", input, itself, error});
    };
    PlaneScene scene = noisy_scene(window, 3, 0.05f, 3);
    add(scene, "two objects, 5 % of noise");
    for (const double slope : {1e-2, 1e-5, 1e-8}) {
        const auto plane = [&](int c, int x, int y) {
            return static_cast<float>(1.0 + c + slope * (x - 0.5 * y));
        };
        char text[80];
        std::snprintf(text, sizeof text, "slope/mean = %g", slope);
        add(even_scene(window, 3, plane, 1e-6f), text);
    }
}

} // namespace

void add_plane_entries(Table& table)
{
    conditions(table);
    filtered(table);
}

} // namespace rayloom::test::budget
