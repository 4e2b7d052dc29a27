// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/half.h"

#include <bit>

#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>
#endif

namespace rayloom
{

namespace
{
// Values from here on round to infinity: half of the last half's spacing above it.
constexpr std::uint32_t overflow_bits = 0x477ff000u;
constexpr std::uint32_t infinity_bits = 0x7f800000u;

float one_to_float(std::uint16_t half)
{
    const std::uint32_t sign = (half & 0x8000u) << 16, magnitude = half & 0x7fffu;
    std::uint32_t bits;
    if (magnitude >= 0x7c00u) { // infinity or NaN
        bits = infinity_bits | (magnitude & 0x3ffu) << 13;
        if (magnitude > 0x7c00u) bits |= 0x00400000u;
    } else if (magnitude >= 0x0400u) {
        bits = (magnitude << 13) + ((127u - 15u) << 23);
    } else { // subnormal: an integer count of 2^-24
        bits = std::bit_cast<std::uint32_t>(static_cast<float>(magnitude) * 0x1p-24f);
    }
    return std::bit_cast<float>(sign | bits);
}

std::uint16_t one_to_half(float value, HalfCounts& counts)
{
    const auto bits = std::bit_cast<std::uint32_t>(value);
    const std::uint32_t sign = (bits >> 16) & 0x8000u, magnitude = bits & 0x7fffffffu;
    std::uint32_t half;
    if (magnitude >= infinity_bits) {
        ++counts.non_finite;
        half = 0x7c00u;
        if (magnitude > infinity_bits) half |= 0x0200u | ((magnitude >> 13) & 0x3ffu);
    } else if (magnitude >= overflow_bits) {
        ++counts.overflows;
        half = 0x7bffu;
    } else if (magnitude >= 0x38800000u) { // normal half: drop 13 bits, ties to even
        half = (magnitude - 0x38000000u + 0x0fffu + ((magnitude >> 13) & 1u)) >> 13;
    } else if (magnitude >= 0x33000000u) { // subnormal half
        const std::uint32_t shift = 126u - (magnitude >> 23);
        const std::uint32_t mantissa = (magnitude & 0x7fffffu) | 0x800000u;
        const std::uint32_t dropped = mantissa & ((1u << shift) - 1u), tie = 1u << (shift - 1u);
        half = mantissa >> shift;
        if (dropped > tie || (dropped == tie && (half & 1u) != 0u)) ++half;
    } else { // below half of the smallest, or a tie to zero
        half = 0;
    }
    return static_cast<std::uint16_t>(sign | half);
}

#if defined(__x86_64__)
bool has_f16c()
{
    // Clang has no name for F16C to ask by. AVX answers for the operating system too.
    static const bool yes = [] {
        unsigned a = 0, b = 0, c = 0, d = 0;
        return __get_cpuid(1, &a, &b, &c, &d) != 0 && (c & bit_F16C) != 0 &&
               __builtin_cpu_supports("avx");
    }();
    return yes;
}

__attribute__((target("avx,f16c"))) std::size_t to_float_f16c(const std::uint16_t* from, float* to,
                                                              std::size_t count)
{
    std::size_t i = 0;
    for (; i + 8 <= count; i += 8)
        _mm256_storeu_ps(
            to + i, _mm256_cvtph_ps(_mm_loadu_si128(reinterpret_cast<const __m128i*>(from + i))));
    return i;
}

// Stops at the first group of eight that holds anything to count.
__attribute__((target("avx,f16c"))) std::size_t to_half_f16c(const float* from, std::uint16_t* to,
                                                             std::size_t count)
{
    const __m256 limit = _mm256_set1_ps(std::bit_cast<float>(overflow_bits));
    const __m256 sign = _mm256_set1_ps(-0.0f);
    std::size_t i = 0;
    for (; i + 8 <= count; i += 8) {
        const __m256 v = _mm256_loadu_ps(from + i);
        const __m256 ordinary = _mm256_cmp_ps(_mm256_andnot_ps(sign, v), limit, _CMP_LT_OQ);
        if (_mm256_movemask_ps(ordinary) != 0xff) break;
        _mm_storeu_si128(reinterpret_cast<__m128i*>(to + i),
                         _mm256_cvtps_ph(v, _MM_FROUND_TO_NEAREST_INT));
    }
    return i;
}
#endif
} // namespace

void half_to_float(const std::uint16_t* from, float* to, std::size_t count)
{
    std::size_t i = 0;
#if defined(__x86_64__)
    if (has_f16c()) i = to_float_f16c(from, to, count);
#endif
    for (; i < count; ++i) to[i] = one_to_float(from[i]);
}

HalfCounts float_to_half(const float* from, std::uint16_t* to, std::size_t count)
{
    HalfCounts counts;
    std::size_t i = 0;
    while (i < count) {
#if defined(__x86_64__)
        if (has_f16c()) i += to_half_f16c(from + i, to + i, count - i);
#endif
        for (std::size_t n = 0; n < 8 && i < count; ++n, ++i) to[i] = one_to_half(from[i], counts);
    }
    return counts;
}

} // namespace rayloom
