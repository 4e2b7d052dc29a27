// SPDX-License-Identifier: Apache-2.0
/// \file
/// fit.plane and fuse.planes against the plain per-pixel evaluation, on one thread, over images
/// whose noise asks for different radii.
#include "nodes/fuse/planes_kernel.h"
#include "tests/oracle/planes.h"

#include <benchmark/benchmark.h>

#include <cmath>
#include <map>
#include <random>

namespace rayloom
{
namespace
{

struct Scene {
    ImageBuffer image, variance, normal, boundary, parts, coefficients;

    PlaneGuides guides() const
    {
        return {
            image.view(), variance.view(), normal.view(), boundary.view(), parts.view(), {}, {}};
    }
};

PlaneSettings settings()
{
    PlaneSettings s;
    s.range = 0.5f;
    s.range_scale = PlaneRange::noise;
    s.target_noise = 0.01f;
    return s;
}

/// Light that changes slowly over objects of 90 px, with noise of the relative deviation
/// `percent`/100, and the guides of a render with ID passes.
Scene make_scene(int percent, const Region& data)
{
    Scene s{ImageBuffer(data, 3), ImageBuffer(data, 3), ImageBuffer(data, 3),
            ImageBuffer(data, 1), ImageBuffer(data, 2), {}};
    std::mt19937 random(1);
    std::normal_distribution<float> normal(0.0f, 1.0f);
    const float noise = 0.01f * static_cast<float>(percent);
    for (int y = 0; y < data.y1; ++y)
        for (int x = 0; x < data.x1; ++x) {
            const int object = x / 90 + 100 * (y / 90);
            const float angle = 0.3f * static_cast<float>(x / 90) + 0.002f * static_cast<float>(y);
            for (int c = 0; c < 3; ++c) {
                const float light = 1.0f + 0.2f * std::sin(0.01f * static_cast<float>(x + y)) +
                                    0.1f * static_cast<float>(c);
                s.image.view().at(c, x, y) = light * std::exp(noise * normal(random));
                s.variance.view().at(c, x, y) = noise * noise * light * light;
                s.normal.view().at(c, x, y) = c == 0   ? std::sin(angle)
                                              : c == 1 ? 0.0f
                                                       : std::cos(angle);
            }
            s.boundary.view().at(0, x, y) =
                x % 90 == 0 || x % 90 == 89 || y % 90 == 0 || y % 90 == 89 ? 1.0f : 0.0f;
            s.parts.view().at(0, x, y) = static_cast<float>(object);
            s.parts.view().at(1, x, y) = 1.0f;
        }
    s.coefficients = ImageBuffer(data, plane_coefficients(3));
    fit_planes(settings(), data, s.guides(), s.coefficients.view(), [] {});
    return s;
}

const Scene& scene(int percent)
{
    static std::map<int, Scene> scenes;
    auto it = scenes.find(percent);
    if (it == scenes.end())
        it = scenes.emplace(percent, make_scene(percent, {0, 0, 1280, 180})).first;
    return it->second;
}

/// Squares 5², 7², 9², 13², 19² and 31² are tried up to the chosen one, by a centre that is left to
/// its neighbours (radius 0) the first two. A pixel of a square takes
/// 70 operations (tests/oracle/plain_nodes.cpp: weight 20, sums 30, normals 15, quadrants 5).
double fit_flops(int radius)
{
    double pixels = 0.0;
    for (const int r : {2, 3, 4, 6, 9, 15})
        if (r <= (radius > 0 ? radius : settings().dense)) pixels += (2 * r + 1) * (2 * r + 1);
    return 70.0 * pixels;
}

/// Of each square that covers the pixel, five planes of three colours and their weights (4 each),
/// and the weights of two pixels (10).
double fuse_flops(int radius) { return 70.0 * (2 * radius + 1) * (2 * radius + 1); }

/// Mean over the pixels of what their squares cost.
template <class Flops>
double mean_flops(const Scene& s, const Flops& flops)
{
    double sum = 0.0;
    const Region& data = s.image.region();
    for (int y = data.y0; y < data.y1; ++y)
        for (const float r : s.coefficients.view().row_span(0, y))
            sum += flops(static_cast<int>(r));
    return sum / static_cast<double>(data.pixels());
}

/// Light, variance, normal, boundary and parts, and 47 coefficients between both nodes.
constexpr double fit_bytes = 4.0 * (3 + 3 + 3 + 1 + 2 + 47), fuse_bytes = 4.0 * (47 + 3 + 2 + 3);

void report_work(benchmark::State& state, double flops, double bytes)
{
    state.counters["flops_per_pixel"] = flops;
    state.counters["bytes_per_pixel"] = bytes;
}

void report(benchmark::State& state, double pixels, double radius)
{
    state.counters["radius"] = radius;
    state.counters["time_per_pixel"] = benchmark::Counter(
        pixels, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

/// Of the centres that are not left to their neighbours.
double mean_radius(const Scene& s)
{
    double sum = 0.0, n = 0.0;
    const Region& data = s.image.region();
    for (int y = data.y0; y < data.y1; ++y)
        for (const float r : s.coefficients.view().row_span(0, y)) {
            sum += static_cast<double>(r);
            n += r > 0.0f ? 1.0 : 0.0;
        }
    return sum / n;
}

void fit(benchmark::State& state)
{
    const Scene& s = scene(static_cast<int>(state.range(0)));
    ImageBuffer out(s.image.region(), plane_coefficients(3));
    for (auto _ : state) fit_planes(settings(), s.image.region(), s.guides(), out.view(), [] {});
    report(state, static_cast<double>(s.image.region().pixels()), mean_radius(s));
    report_work(state, mean_flops(s, fit_flops), fit_bytes);
}

void fuse(benchmark::State& state)
{
    const Scene& s = scene(static_cast<int>(state.range(0)));
    ImageBuffer out(s.image.region(), 3);
    for (auto _ : state)
        fuse_planes(settings(), s.image.region(), s.coefficients.view(), s.guides(), out.view(),
                    [] {});
    report(state, static_cast<double>(s.image.region().pixels()), mean_radius(s));
    report_work(state, mean_flops(s, fuse_flops), fuse_bytes);
}

oracle::Raster<double> raster(const ImageBuffer& from)
{
    oracle::Raster<double> to(48, 32, from.channels());
    for (int c = 0; c < to.channels; ++c)
        for (int y = 0; y < to.height; ++y)
            for (int x = 0; x < to.width; ++x)
                to.at(c, x, y) = static_cast<double>(from.view().at(c, x + 20, y + 20));
    return to;
}

oracle::PlaneInput plain_input(const Scene& s)
{
    return {raster(s.image),
            raster(s.variance),
            raster(s.normal),
            raster(s.boundary),
            raster(s.parts),
            {},
            0,
            0};
}

oracle::PlaneOptions plain_options()
{
    oracle::PlaneOptions o;
    o.range = 0.5;
    o.range_by_noise = true;
    o.target_noise = 0.01;
    o.blend_max = true;
    return o;
}

double plain_radius(const std::vector<oracle::CentrePlanes>& centres)
{
    double sum = 0.0, n = 0.0;
    for (const auto& c : centres) {
        sum += c.radius;
        n += c.radius > 0 ? 1.0 : 0.0;
    }
    return sum / n;
}

void plain_fit(benchmark::State& state)
{
    const auto input = plain_input(scene(static_cast<int>(state.range(0))));
    std::vector<oracle::CentrePlanes> centres;
    for (auto _ : state) centres = fit_all(input, plain_options());
    report(state, 48.0 * 32.0, plain_radius(centres));
}

void plain_fuse(benchmark::State& state)
{
    const auto input = plain_input(scene(static_cast<int>(state.range(0))));
    const auto centres = fit_all(input, plain_options());
    for (auto _ : state) benchmark::DoNotOptimize(fuse_all(input, plain_options(), centres));
    report(state, 48.0 * 32.0, plain_radius(centres));
}

void each(benchmark::internal::Benchmark* b)
{
    b->ArgName("noise")->Unit(benchmark::kMillisecond);
    for (const int percent : {0, 4, 8, 16, 32}) b->Arg(percent);
}

BENCHMARK(fit)->Name("fit.plane/objects/1280x180")->Apply(each);
BENCHMARK(fuse)->Name("fuse.planes/objects/1280x180")->Apply(each);
BENCHMARK(plain_fit)->Name("fit.plane/plain_objects/48x32")->Apply(each);
BENCHMARK(plain_fuse)->Name("fuse.planes/plain_objects/48x32")->Apply(each);

} // namespace
} // namespace rayloom
