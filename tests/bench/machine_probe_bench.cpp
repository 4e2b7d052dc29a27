// SPDX-License-Identifier: Apache-2.0
/// \file
/// What this machine can do at most, measured beside the kernels: memory bandwidth as by STREAM's
/// triad, and floating-point operations per second with and without fused multiply-add. Kernels
/// that give the same bits on every machine use no fused operations, so `mul_add` is their roof.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/bench/machine_probe_bench.cpp"
#include <hwy/foreach_target.h>

#include <hwy/highway.h>

#include <benchmark/benchmark.h>

#include <cstddef>

HWY_BEFORE_NAMESPACE();
namespace rayloom
{
namespace HWY_NAMESPACE
{

namespace hn = hwy::HWY_NAMESPACE;

void triad(float* out, const float* a, const float* b, std::size_t n)
{
    const hn::ScalableTag<float> d;
    const auto s = hn::Set(d, 3.0f);
    for (std::size_t i = 0; i + hn::Lanes(d) <= n; i += hn::Lanes(d))
        hn::StoreU(hn::Add(hn::LoadU(d, a + i), hn::Mul(s, hn::LoadU(d, b + i))), d, out + i);
}

/// Twelve chains hide the latency of multiply and add; that many fit the registers of AVX-512 and
/// of AVX2 (the two factors come from memory there).
template <bool fused>
std::size_t chains(float* sums, std::size_t rounds)
{
    const hn::ScalableTag<float> d;
    using V = hn::Vec<decltype(d)>;
    const V x = hn::Set(d, sums[0]), y = hn::Set(d, sums[1]);
    const auto step = [&](V v) HWY_ATTR {
        if constexpr (fused)
            return hn::MulAdd(v, x, y);
        else
            return hn::Add(hn::Mul(v, x), y);
    };
    V a = y, b = y, c = y, e = y, f = y, g = y, h = y, i = y, j = y, k = y, l = y, m = y;
    for (std::size_t r = 0; r < rounds; ++r) {
        a = step(a), b = step(b), c = step(c), e = step(e), f = step(f), g = step(g);
        h = step(h), i = step(i), j = step(j), k = step(k), l = step(l), m = step(m);
    }
    const V first = hn::Add(hn::Add(hn::Add(a, b), hn::Add(c, e)), hn::Add(f, g));
    const V second = hn::Add(hn::Add(hn::Add(h, i), hn::Add(j, k)), hn::Add(l, m));
    sums[2] = hn::GetLane(hn::SumOfLanes(d, hn::Add(first, second)));
    return rounds * 12 * 2 * hn::Lanes(d);
}

std::size_t fused_chains(float* sums, std::size_t rounds) { return chains<true>(sums, rounds); }
std::size_t separate_chains(float* sums, std::size_t rounds) { return chains<false>(sums, rounds); }

} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <hwy/aligned_allocator.h>

namespace rayloom
{

HWY_EXPORT(triad);
HWY_EXPORT(fused_chains);
HWY_EXPORT(separate_chains);

namespace
{

void memory(benchmark::State& state)
{
    // Three arrays of 64 MiB a thread: no last-level cache holds them.
    const std::size_t n = std::size_t{1} << 24;
    const auto a = hwy::AllocateAligned<float>(n), b = hwy::AllocateAligned<float>(n),
               out = hwy::AllocateAligned<float>(n);
    for (std::size_t i = 0; i < n; ++i) a[i] = b[i] = out[i] = static_cast<float>(i % 7);
    for (auto _ : state) {
        HWY_DYNAMIC_DISPATCH(triad)(out.get(), a.get(), b.get(), n);
        benchmark::ClobberMemory();
    }
    // As STREAM counts: two arrays read, one written; that writing may read first is not counted.
    state.counters["bytes_per_iteration"] =
        benchmark::Counter(static_cast<double>(12 * n), benchmark::Counter::kAvgThreads);
}

void arithmetic(benchmark::State& state, bool fused)
{
    float sums[3] = {0.999f, 0.001f, 0.0f};
    std::size_t flops = 0; // of one iteration
    for (auto _ : state) {
        flops = fused ? HWY_DYNAMIC_DISPATCH(fused_chains)(sums, 20000)
                      : HWY_DYNAMIC_DISPATCH(separate_chains)(sums, 20000);
        benchmark::DoNotOptimize(sums[2]);
    }
    state.counters["flops_per_iteration"] =
        benchmark::Counter(static_cast<double>(flops), benchmark::Counter::kAvgThreads);
}

BENCHMARK(memory)->Name("machine/triad")->Threads(1)->Threads(2)->UseRealTime();
BENCHMARK_CAPTURE(arithmetic, fused, true)
    ->Name("machine/fused")
    ->Threads(1)
    ->Threads(2)
    ->UseRealTime();
BENCHMARK_CAPTURE(arithmetic, mul_add, false)
    ->Name("machine/mul_add")
    ->Threads(1)
    ->Threads(2)
    ->UseRealTime();

} // namespace
} // namespace rayloom
#endif
