// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/error_measures.h"

#include <benchmark/benchmark.h>

#include <random>

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

void measure(benchmark::State& state, bool ssim, bool flip, bool hdr_flip)
{
    const int width = static_cast<int>(state.range(0)), height = static_cast<int>(state.range(1));
    const Pair pair = noisy_pair(width, height);
    ErrorOptions options;
    options.ssim = ssim;
    options.flip = flip;
    options.hdr_flip = hdr_flip;
    for (auto _ : state)
        benchmark::DoNotOptimize(
            measure_errors(pair.image.view(), pair.reference.view(), options).rmse);
    state.SetItemsProcessed(state.iterations() * width * height);
}

void pixelwise(benchmark::State& state) { measure(state, false, false, false); }
void ssim(benchmark::State& state) { measure(state, true, false, false); }
void flip(benchmark::State& state) { measure(state, false, true, false); }
void hdr_flip(benchmark::State& state) { measure(state, false, false, true); }

#define RAYLOOM_BENCH_MEASURE(name)                                                                \
    BENCHMARK(name)                                                                                \
        ->Name("error_measures/" #name)                                                            \
        ->Args({1280, 720})                                                                        \
        ->Unit(benchmark::kMillisecond)                                                            \
        ->UseRealTime()
RAYLOOM_BENCH_MEASURE(pixelwise);
RAYLOOM_BENCH_MEASURE(ssim);
RAYLOOM_BENCH_MEASURE(flip);
RAYLOOM_BENCH_MEASURE(hdr_flip);

} // namespace
} // namespace rayloom
