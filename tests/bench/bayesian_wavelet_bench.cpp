// SPDX-License-Identifier: Apache-2.0
/// \file
/// Bayesian coring in the wavelet domain: the whole way from logarithm to restored mean, with the
/// share of each node, and its kernels against the definitions they stand for.
#include "nodes/multiscale/steerable_kernel.h"
#include "rayloom/stats/posterior_mean.h"
#include "tests/oracle/posterior_mean.h"
#include "tests/oracle/steerable.h"
#include "tests/support/log_graphs.h"

#include <benchmark/benchmark.h>

#include <random>

namespace rayloom
{
namespace
{

/// Light with edges, and noise that is a factor.
std::shared_ptr<MemoryImage> light(const Region& window, unsigned seed)
{
    std::mt19937 random(seed);
    std::gamma_distribution<float> factor(2.0f, 0.5f);
    return test::image_of(window, {"R", "G", "B"}, [&](int c, int x, int y) {
        return (0.2f + static_cast<float>((x / 90 + y / 70 + c) % 3)) * factor(random);
    });
}

/// Everything of graphs/bayesian-wavelet.yaml between the light and the filtered light.
void whole(benchmark::State& state, bool halves)
{
    const Region window{0, 0, 1280, 960};
    std::map<std::string, std::shared_ptr<const MemoryImage>> images{{"image", light(window, 1)}};
    std::string text = "rayloom: 1\nname: log-to-exp\ninputs:\n  image: any\n";
    if (halves) {
        text += "  a: any\n  b: any\n";
        images["a"] = light(window, 2);
        images["b"] = light(window, 3);
    }
    text += "nodes:\n"
            "  log: {op: transform.log, image: image, epsilon: 0.5}\n"
            "  bands: {op: multiscale.steerable, image: log.log}\n";
    if (halves)
        text += "  log_a: {op: transform.log, image: a, figures: log.figures}\n"
                "  log_b: {op: transform.log, image: b, figures: log.figures}\n"
                "  difference: {op: oiio.sub, image: log_a.log, other: log_b.log}\n"
                "  half: {op: oiio.mul, image: difference, value: [0.5]}\n"
                "  rest: {op: multiscale.steerable, image: half, levels: 1}\n"
                "  map: {op: fit.noise_map, band: 'rest[0]'}\n"
                "  even_half: {op: oiio.div, image: half, other: map}\n"
                "  even: {op: transform.scale_band, band: bands, map: map}\n"
                "  noise: {op: fit.noise, band: even, difference: even_half}\n";
    else
        text += "  map: {op: fit.noise_map, band: 'bands[0]'}\n"
                "  even: {op: transform.scale_band, band: bands, map: map}\n"
                "  high: {op: fit.noise, band: 'even[0]'}\n"
                "  noise: {op: fit.noise, band: even, high: high.figures}\n";
    text +=
        "  fit: {op: fit.laplacian, band: even, noise: noise.figures}\n"
        "  shrunk: {op: threshold.coring, band: even, fit: fit.figures}\n"
        "  back: {op: transform.scale_band, band: shrunk.band, map: map, mode: multiply}\n"
        "  joined: {op: multiscale.steerable_inverse, bands: back}\n"
        "  linear: {op: transform.exp, image: joined, figures: log.figures}\n"
        "  energy: {op: transform.restore_mean, image: linear, reference: image, mode: balance,\n"
        "           figures: log.figures, weight: image, scale: 3}\n"
        "outputs:\n  image: energy\n";
    RunOptions options;
    options.threads = static_cast<int>(state.range(0));
    std::map<std::string, double> seconds;
    for (auto _ : state) {
        RunReport report;
        test::run_text(text, images, options, {}, &report);
        for (const NodeReport& node : report.nodes) seconds[node.op] += node.seconds;
    }
    for (const auto& [op, s] : seconds)
        state.counters[op] = benchmark::Counter(1e3 * s, benchmark::Counter::kAvgIterations);
}

constexpr Region kernel_window{0, 0, 640, 480};

const ImageBuffer& kernel_image()
{
    static const ImageBuffer image = [] {
        ImageBuffer made(kernel_window, 1);
        std::mt19937 random(4);
        std::normal_distribution<float> noise(0.0f, 1.0f);
        for (int y = 0; y < kernel_window.y1; ++y)
            for (float& v : made.view().row_span(0, y)) v = noise(random);
        return made;
    }();
    return image;
}

/// Bytes: one channel in, one out.
void per_pixel(benchmark::State& state, double pixels, double flops)
{
    state.counters["flops_per_pixel"] = flops;
    state.counters["bytes_per_pixel"] = 8.0;
    state.counters["time_per_pixel"] = benchmark::Counter(
        pixels, benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

/// Three means of four pixels, separable (3 each), a difference and its scale.
constexpr double analysis_flops = 3 * 3 + 2;
/// Position in the table (3) and its cubic (6).
constexpr double reading_flops = 3 + 6;

void analysis(benchmark::State& state)
{
    const SteerableBand band{SteerableBand::Kind::oriented, 3, 1};
    ImageBuffer out(kernel_window, 1);
    for (auto _ : state) steerable_analyse(band, kernel_window, kernel_image().view(), out.view());
    per_pixel(state, static_cast<double>(kernel_window.pixels()), analysis_flops);
}

void analysis_oracle(benchmark::State& state)
{
    const auto pixel = [](int x, int y) {
        return static_cast<double>(
            kernel_image().view().at(0, std::clamp(x, 0, 639), std::clamp(y, 0, 479)));
    };
    for (auto _ : state)
        for (int x = 100; x < 164; ++x)
            benchmark::DoNotOptimize(oracle::steerable_oriented(pixel, 3, 1, x, 200));
    per_pixel(state, 64.0, analysis_flops);
}

/// Figures of a fine band of a render with 16 samples a pixel.
constexpr GeneralisedLaplacian signal{0.03, 0.43}, noise{0.2, 1.0};

void table(benchmark::State& state)
{
    for (auto _ : state) benchmark::DoNotOptimize(PosteriorMeanTable(signal, noise, 8.0));
}

void coring(benchmark::State& state)
{
    const PosteriorMeanTable posterior(signal, noise, 8.0);
    ImageBuffer out(kernel_window, 1);
    for (auto _ : state)
        for (int y = 0; y < kernel_window.y1; ++y)
            posterior.apply(kernel_image().view().row_span(0, y), out.view().row_span(0, y));
    per_pixel(state, static_cast<double>(kernel_window.pixels()), reading_flops);
}

void coring_oracle(benchmark::State& state)
{
    for (auto _ : state)
        for (int x = 0; x < 16; ++x)
            benchmark::DoNotOptimize(
                oracle::posterior_mean(static_cast<double>(kernel_image().view().at(0, x, 0)),
                                       signal.s, signal.p, noise.s, noise.p));
    per_pixel(state, 16.0, reading_flops);
}

BENCHMARK_CAPTURE(whole, high_pass, false)
    ->Name("bayesian-wavelet/noise_from_high_pass/1280x960x3/threads")
    ->Arg(1)
    ->Arg(2)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(whole, halves, true)
    ->Name("bayesian-wavelet/noise_from_halves/1280x960x3/threads")
    ->Arg(1)
    ->Arg(2)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(analysis)->Name("multiscale.steerable/level3.band2/640x480");
BENCHMARK(analysis_oracle)->Name("multiscale.steerable/plain_level3.band2/64x1");
BENCHMARK(table)->Name("threshold.coring/table/one_band")->Unit(benchmark::kMicrosecond);
BENCHMARK(coring)->Name("threshold.coring/read_table/640x480");
BENCHMARK(coring_oracle)->Name("threshold.coring/plain_read_table/16x1");

} // namespace
} // namespace rayloom
