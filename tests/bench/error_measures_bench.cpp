// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/error_measures.h"

#include <benchmark/benchmark.h>

#include <random>
#include <tbb/task_arena.h>

namespace rayloom
{
namespace
{

struct Pair {
    ImageBuffer image, reference;
};

Pair noisy_pair(int width, int height)
{
    const Region region{0, 0, width, height};
    Pair pair{ImageBuffer(region, 3), ImageBuffer(region, 3)};
    std::mt19937 random(1);
    std::uniform_real_distribution<float> noise(0.5f, 1.5f);
    for (int y = 0; y < height; ++y)
        for (int c = 0; c < 3; ++c)
            for (int x = 0; x < width; ++x) {
                const float r = 0.1f + 0.0007f * static_cast<float>((c + 1) * ((x + 3 * y) % 700));
                pair.reference.view().at(c, x, y) = r;
                pair.image.view().at(c, x, y) = r * noise(random);
            }
    return pair;
}

/// Arguments: width, height, threads. `flops` counts the equations of docs/measures.md by pixel,
/// with the filters at their taps; HDR-FLIP does the work of FLIP for each exposure, whose number
/// hangs on the image: `flops_of_exposure` is multiplied by it.
void measure(benchmark::State& state, bool ssim, bool flip, bool hdr_flip, double flops,
             double flops_of_exposure = 0.0)
{
    const int width = static_cast<int>(state.range(0)), height = static_cast<int>(state.range(1));
    const Pair pair = noisy_pair(width, height);
    ErrorOptions options;
    options.ssim = ssim;
    options.flip = flip;
    options.hdr_flip = hdr_flip;
    tbb::task_arena arena(static_cast<int>(state.range(2)));
    int exposures = 0;
    for (auto _ : state)
        exposures = arena.execute([&] {
            return measure_errors(pair.image.view(), pair.reference.view(), options)
                .hdr_flip_exposures.count;
        });
    state.SetItemsProcessed(state.iterations() * width * height);
    state.counters["flops_per_pixel"] = flops + flops_of_exposure * exposures;
    state.counters["bytes_per_pixel"] = 4.0 * (3.0 + 3.0);
}

// Three channels: difference, square, sums, two quotients, absolute values.
constexpr double pixelwise_flops = 3 * 13;
// Five moments of luminance, 11 taps along x and y, multiply and add.
constexpr double ssim_flops = pixelwise_flops + 5 * 2 * 11 * 2 + 40;
// Of both images: four separable contrast filters of 21 taps, four feature filters of 19 taps.
constexpr double flip_flops = pixelwise_flops + 2 * (4 * 2 * 21 * 2 + 4 * 2 * 19 * 2) + 150;

void pixelwise(benchmark::State& state) { measure(state, false, false, false, pixelwise_flops); }
void ssim(benchmark::State& state) { measure(state, true, false, false, ssim_flops); }
void flip(benchmark::State& state) { measure(state, false, true, false, flip_flops); }

#define RAYLOOM_BENCH_MEASURE(name)                                                                \
    BENCHMARK(name)                                                                                \
        ->Name("error_measures/" #name)                                                            \
        ->ArgNames({"width", "height", "threads"})                                                 \
        ->Unit(benchmark::kMillisecond)                                                            \
        ->UseRealTime()                                                                            \
        ->Args({1280, 720, 1})                                                                     \
        ->Args({1280, 720, 2})
RAYLOOM_BENCH_MEASURE(pixelwise)->Args({640, 400, 1})->Args({3840, 2160, 1})->Args({3840, 2160, 2});
RAYLOOM_BENCH_MEASURE(ssim)->Args({640, 400, 1})->Args({3840, 2160, 1})->Args({3840, 2160, 2});
RAYLOOM_BENCH_MEASURE(flip)->Args({640, 400, 1});

void hdr_flip(benchmark::State& state)
{
    measure(state, false, false, true, pixelwise_flops, flip_flops - pixelwise_flops);
}
RAYLOOM_BENCH_MEASURE(hdr_flip);

} // namespace
} // namespace rayloom
