// SPDX-License-Identifier: Apache-2.0
/// \file
/// fuse.histogram against the plain per-patch evaluation, both in float on one thread.
#include "nodes/fuse/histogram_kernel.h"
#include "tests/oracle/histogram_fusion.h"

#include <benchmark/benchmark.h>

#include <array>
#include <cmath>
#include <random>

namespace rayloom
{
namespace
{

struct Scene {
    ImageBuffer image, histogram;
};

/// 32 samples a pixel, log-normal around the colour of a checkerboard of 40 px; with `equal_counts`
/// off, 24 to 40 of them.
const Scene& scene(bool equal_counts)
{
    const auto make = [](bool equal) {
        const Region data{0, 0, 1280, 180};
        Scene s{ImageBuffer(data, 3), ImageBuffer(data, 61)};
        std::mt19937 random(1);
        std::normal_distribution<double> noise(0.0, 0.6);
        std::uniform_int_distribution<int> count(24, 40);
        for (int y = 0; y < data.y1; ++y)
            for (int x = 0; x < data.x1; ++x) {
                const double base = (x / 40 + y / 40) % 2 == 0 ? 0.15 : 0.6;
                std::array<double, 61> bins{};
                std::array<double, 3> sum{};
                const int n = equal ? 32 : count(random);
                for (int i = 0; i < n; ++i) {
                    const double v = base * std::exp(noise(random));
                    const std::array<double, 3> colour{v, 0.8 * v, 0.5 * v};
                    oracle::add_sample(bins, colour, 20, 2.2, 2.5);
                    for (std::size_t c = 0; c < 3; ++c) sum[c] += colour[c] / n;
                }
                for (std::size_t i = 0; i < bins.size(); ++i)
                    s.histogram.view().at(static_cast<int>(i), x, y) = static_cast<float>(bins[i]);
                for (std::size_t c = 0; c < 3; ++c)
                    s.image.view().at(static_cast<int>(c), x, y) = static_cast<float>(sum[c]);
            }
        return s;
    };
    static const Scene equal = make(true), mixed = make(false);
    return equal_counts ? equal : mixed;
}

/// Counted from equations 3 and 4: a window of 13x13 compares a pixel with 84 others (each pair
/// once) in 60 bins; subtract, square, add, divide, accumulate, and two scalings where counts
/// differ. Bytes are what no implementation can avoid: histogram and image in, image out.
void per_pixel(benchmark::State& state, double pixels, bool equal_counts)
{
    state.counters["flops_per_pixel"] = 84.0 * 60.0 * (equal_counts ? 5.0 : 7.0);
    state.counters["bytes_per_pixel"] = 4.0 * (61.0 + 3.0 + 3.0);
    state.counters["time_per_pixel"] = benchmark::Counter(
        pixels, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void fast(benchmark::State& state, bool equal_counts)
{
    const Scene& s = scene(equal_counts);
    HistogramFusionSettings settings;
    settings.min_patches = 2;
    ImageBuffer out(s.image.region(), 3);
    for (auto _ : state)
        fuse_histogram(settings, s.image.region(), s.histogram.view(), s.image.view(), -1,
                       out.view(), {}, [] {});
    per_pixel(state, static_cast<double>(s.image.region().pixels()), equal_counts);
}

void plain(benchmark::State& state, bool equal_counts)
{
    const Scene& s = scene(equal_counts);
    oracle::Raster<float> image(64, 48, 3), histogram(64, 48, 61);
    for (auto* raster : {&image, &histogram})
        for (int c = 0; c < raster->channels; ++c)
            for (int y = 0; y < raster->height; ++y)
                for (int x = 0; x < raster->width; ++x)
                    raster->at(c, x, y) =
                        (raster == &image ? s.image : s.histogram).view().at(c, x + 16, y + 16);
    oracle::FusionSettings settings;
    settings.min_patches = 2;
    for (auto _ : state)
        benchmark::DoNotOptimize(oracle::fuse_histogram(image, histogram, settings));
    per_pixel(state, 64.0 * 48.0, equal_counts);
}

BENCHMARK_CAPTURE(fast, equal_counts, true)
    ->Name("fuse.histogram/equal_counts/1280x180")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(fast, mixed_counts, false)
    ->Name("fuse.histogram/mixed_counts/1280x180")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(plain, equal_counts, true)
    ->Name("fuse.histogram/plain_equal_counts/64x48")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(plain, mixed_counts, false)
    ->Name("fuse.histogram/plain_mixed_counts/64x48")
    ->Unit(benchmark::kMillisecond);

} // namespace
} // namespace rayloom
