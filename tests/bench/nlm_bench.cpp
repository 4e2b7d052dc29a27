// SPDX-License-Identifier: Apache-2.0
/// \file
/// fuse.nlm against the plain evaluation of every pair and patch, both in float on one thread.
#include "nodes/fuse/nlm_kernel.h"
#include "tests/oracle/nlm.h"

#include <benchmark/benchmark.h>

#include <cmath>
#include <limits>
#include <random>
#include <string>

namespace rayloom
{
namespace
{

/// A large image's share of one block of the node, with all that the block reads.
constexpr Region block{0, 0, 256, 128};
constexpr Region window{-128, -128, 384, 256};

/// A checkerboard of 40 px, 16 samples a pixel with log-normal noise, a guide with little noise.
struct Scene {
    ImageBuffer image, guide, guide_variance, low, high;
};

const Scene& scene()
{
    static const Scene made = [] {
        Scene s{ImageBuffer(window, 3), ImageBuffer(window, 3), ImageBuffer(window, 1),
                ImageBuffer(window, 3), ImageBuffer(window, 3)};
        std::mt19937 random(1);
        std::normal_distribution<double> noise(0.0, 0.6), little(0.0, 0.02);
        constexpr int samples = 16;
        constexpr double t = 2.947; // Student's t of 99 % and 15 degrees of freedom
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x) {
                const double base = ((x + 400) / 40 + (y + 400) / 40) % 2 == 0 ? 0.15 : 0.6;
                double sum = 0.0, squares = 0.0;
                for (int i = 0; i < samples; ++i) {
                    const double v = base * std::exp(noise(random));
                    sum += v;
                    squares += v * v;
                }
                const double mean = sum / samples,
                             variance = (squares / samples - mean * mean) / (samples - 1);
                for (int c = 0; c < 3; ++c) {
                    const double scale = 1.0 - 0.2 * c;
                    const double half = t * scale * std::sqrt(variance);
                    s.image.view().at(c, x, y) = static_cast<float>(scale * mean);
                    s.low.view().at(c, x, y) = static_cast<float>(scale * mean - half);
                    s.high.view().at(c, x, y) = static_cast<float>(scale * mean + half);
                    s.guide.view().at(c, x, y) = static_cast<float>(scale * base + little(random));
                }
                s.guide_variance.view().at(0, x, y) = 0.0004f;
            }
        return s;
    }();
    return made;
}

struct Case {
    NlmGate gate = NlmGate::one_sample;
    int window = 31, patch = 5;
    Region region = block;
};

/// Of any implementation that uses the symmetry of pairs: per pair the squared difference of three
/// channels (8), the patch's separable sum (4 · radius + 2 additions and multiplications a
/// direction), the gate (6 or 12), the weight (17), two pixels' sums (7 each). Bytes: image, guide,
/// its variance and the interval in, the image out.
void per_pixel(benchmark::State& state, const Case& c)
{
    const double pairs = (c.window * c.window - 1) / 2.0;
    const double gate = c.gate == NlmGate::none ? 0.0 : 12.0;
    const double pair = 8.0 + 2.0 * (3.0 * (c.patch / 2) + 1.0) + gate + 17.0 + 14.0;
    state.counters["flops_per_pixel"] = pairs * pair;
    state.counters["bytes_per_pixel"] = 4.0 * (3 + 3 + 1 + 6 + 3);
    state.counters["time_per_pixel"] = benchmark::Counter(
        static_cast<double>(c.region.pixels()),
        benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

void fast(benchmark::State& state, const Case& c)
{
    const Scene& s = scene();
    NlmSettings settings;
    settings.window_radius = c.window / 2;
    settings.patch_radius = c.patch / 2;
    settings.sigma_s = static_cast<float>(c.window) / 3.0f;
    settings.gate = c.gate;
    const Region planes = nlm_plane_region(c.region, settings);
    ImageBuffer storage(planes, 3 + 1 + 3 + 3 + 3), sums(nlm_sums_region(c.region), 4);
    auto take = [&, next = 0](int channels) mutable {
        next += channels;
        return storage.view().channel_range(next - channels, channels);
    };
    const ImageView guide = take(3), inverse = take(1), image = take(3), low = take(3),
                    high = take(3);
    for (int y = planes.y0; y < planes.y1; ++y)
        for (int x = planes.x0; x < planes.x1; ++x) {
            for (int k = 0; k < 3; ++k) {
                guide.at(k, x, y) = s.guide.view().at(k, x, y) / std::sqrt(3.0f);
                image.at(k, x, y) = s.image.view().at(k, x, y);
                low.at(k, x, y) = s.low.view().at(k, x, y);
                high.at(k, x, y) = s.high.view().at(k, x, y);
                const float h = 0.5f * (high.at(k, x, y) - low.at(k, x, y));
                if (c.gate == NlmGate::two_sample) low.at(k, x, y) = h * h;
            }
            inverse.at(0, x, y) = nlm_log2_e / (2.0f * s.guide_variance.view().at(0, x, y));
        }
    NlmFrame frame;
    frame.guide = guide;
    frame.inverse = inverse;
    frame.image = image;
    if (c.gate != NlmGate::none) frame.tested = image;
    if (c.gate == NlmGate::two_sample) frame.spread = low;
    if (c.gate == NlmGate::one_sample) {
        frame.low = low;
        frame.high = high;
    }
    for (auto _ : state) nlm_sums({c.region, window, settings, {&frame, 1}, sums.view()});
    per_pixel(state, c);
}

void plain(benchmark::State& state, const Case& c)
{
    const Scene& s = scene();
    oracle::NlmSettings settings;
    settings.window = c.window;
    settings.patch = c.patch;
    settings.sigma_s = c.window / 3.0;
    settings.range = 1.0;
    settings.gate = c.gate == NlmGate::none         ? oracle::NlmGate::none
                    : c.gate == NlmGate::one_sample ? oracle::NlmGate::one_sample
                                                    : oracle::NlmGate::two_sample;
    const oracle::NlmFrame frame{s.image.view(), s.guide.view(), s.guide_variance.view(),
                                 s.low.view(), s.high.view()};
    for (auto _ : state)
        benchmark::DoNotOptimize(oracle::filter_nlm<float>({&frame, 1}, 0, settings, c.region));
    per_pixel(state, c);
}

std::string size(const Region& r)
{
    return "/" + std::to_string(r.width()) + "x" + std::to_string(r.height());
}

[[maybe_unused]] const bool registered = [] {
    const auto add = [](const std::string& name, auto* run, const Case& c) {
        benchmark::RegisterBenchmark(("fuse.nlm/" + name + size(c.region)).c_str(), run, c)
            ->Unit(benchmark::kMillisecond);
    };
    constexpr Region few{48, 48, 80, 64};
    for (const auto& [name, gate] :
         {std::pair{"one_sample", NlmGate::one_sample},
          std::pair{"two_sample", NlmGate::two_sample}, std::pair{"no_gate", NlmGate::none}}) {
        add(name, fast, {gate});
        add(std::string("plain_") + name, plain, {gate, 31, 5, few});
    }
    for (const int side : {7, 15, 45, 61})
        add("window_" + std::to_string(side), fast, {NlmGate::one_sample, side, 5});
    for (const int side : {1, 3, 7, 9, 11})
        add("patch_" + std::to_string(side), fast, {NlmGate::one_sample, 31, side});
    add("tile", fast, {NlmGate::one_sample, 31, 5, {0, 0, 64, 64}});
    return true;
}();

} // namespace
} // namespace rayloom
