// SPDX-License-Identifier: Apache-2.0
/// \file
/// The pieces kernels are made of, on the best SIMD target of this machine.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/simd/vectors_test.cpp"
#include <hwy/foreach_target.h>

#include "rayloom/simd/exp2-inl.h"
#include "rayloom/simd/neighbours-inl.h"

#include <cstddef>
#include <utility>

HWY_BEFORE_NAMESPACE();
namespace rayloom
{
namespace HWY_NAMESPACE
{
namespace
{
using namespace simd::HWY_NAMESPACE;

/// `n` in whole groups of 16.
template <int degree>
void Powers(const float* x, float zero_from, float* power, std::size_t n)
{
    const D d;
    for (std::size_t i = 0; i < n; i += hn::Lanes(d))
        hn::StoreU(Exp2Minus<degree>(hn::LoadU(d, x + i), zero_from), d, power + i);
}
void PowersOfDegree4(const float* x, float zero_from, float* power, std::size_t n)
{
    Powers<4>(x, zero_from, power, n);
}
void PowersOfDegree5(const float* x, float zero_from, float* power, std::size_t n)
{
    Powers<5>(x, zero_from, power, n);
}

template <int k>
void StoreBetween(const float* p, float* out)
{
    const D d;
    if constexpr (k <= static_cast<int>(hn::MaxLanes(d)))
        hn::StoreU(Between<k>(hn::LoadU(d, p), hn::LoadU(d, p + hn::Lanes(d)), p), d, out + 16 * k);
}
/// [k][16]; returns how many lanes of each are filled, as many as the target has.
std::size_t Betweens(const float* p, float* out)
{
    [&]<int... k>(std::integer_sequence<int, k...>) { (StoreBetween<k>(p, out), ...); }
    (std::make_integer_sequence<int, 17>());
    return hn::Lanes(D());
}

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace rayloom
{
namespace
{

HWY_EXPORT(PowersOfDegree4);
HWY_EXPORT(PowersOfDegree5);
HWY_EXPORT(Betweens);

TEST(Exp2, FollowsThePower)
{
    std::vector<float> x;
    for (float v = 0.0f; v < 126.0f; v += 0.0078125f) x.push_back(v + 1e-4f * std::sin(v));
    x.resize(x.size() / 16 * 16);
    std::vector<float> four(x.size()), five(x.size());
    HWY_DYNAMIC_DISPATCH(PowersOfDegree4)(x.data(), 126.0f, four.data(), x.size());
    HWY_DYNAMIC_DISPATCH(PowersOfDegree5)(x.data(), 126.0f, five.data(), x.size());
    for (std::size_t i = 0; i < x.size(); ++i) {
        const double power = std::exp2(-static_cast<double>(x[i]));
        ASSERT_NEAR(four[i], power, 3e-6 * power) << x[i];
        ASSERT_NEAR(five[i], power, 3e-7 * power) << x[i];
    }
    EXPECT_EQ(five[0], 1.0f);
}

TEST(Exp2, IsZeroFromThereOn)
{
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const float inf = std::numeric_limits<float>::infinity();
    std::vector<float> x(16, 1.0f), power(16);
    x[1] = std::nextafter(60.0f, 0.0f);
    x[2] = 60.0f;
    x[3] = 61.5f;
    x[4] = 1e30f;
    x[5] = inf;
    x[6] = nan;
    HWY_DYNAMIC_DISPATCH(PowersOfDegree4)(x.data(), 60.0f, power.data(), x.size());
    EXPECT_NEAR(power[0], 0.5f, 2e-6f);
    EXPECT_GT(power[1], 0.0f);
    for (std::size_t i = 2; i < 7; ++i) EXPECT_EQ(power[i], 0.0f) << x[i];
}

TEST(Neighbours, VectorsBetweenTwoAreThoseInMemory)
{
    std::vector<float> memory(48), out(17 * 16, -1.0f);
    for (std::size_t i = 0; i < memory.size(); ++i) memory[i] = static_cast<float>(i);
    const std::size_t lanes = HWY_DYNAMIC_DISPATCH(Betweens)(memory.data(), out.data());
    for (std::size_t k = 0; k <= lanes; ++k)
        for (std::size_t i = 0; i < lanes; ++i)
            ASSERT_EQ(out[16 * k + i], memory[k + i]) << k << " " << i;
}

} // namespace
} // namespace rayloom
#endif
