// SPDX-License-Identifier: Apache-2.0
/// \file
/// Powers of two for weights that fall off exponentially. Included once per SIMD target, as
/// lanes-inl.h.
#if defined(RAYLOOM_SIMD_EXP2_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef RAYLOOM_SIMD_EXP2_INL_H
#undef RAYLOOM_SIMD_EXP2_INL_H
#else
#define RAYLOOM_SIMD_EXP2_INL_H
#endif

#include "rayloom/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace rayloom::simd::HWY_NAMESPACE
{

/// power ← 2^−x for 0 ≤ x ≤ 126, anything elsewhere, for N vectors side by side: one alone waits
/// for its own results most of the time. \tparam degree of the polynomial: 4 has a relative error
/// below 3e-6, 5 one below 3e-7 and
///         is exactly 1 at 0.
template <int degree, int N>
HWY_INLINE void Exp2MinusInRange(const V (&x)[N], V (&power)[N])
{
    static_assert(degree == 4 || degree == 5);
    constexpr float c[6] = {
        degree == 4 ? 0.9999992847442627f : 1.0f,
        degree == 4 ? 0.6931217908859253f : 0.6931470036506653f,
        degree == 4 ? 0.240247443318367f : 0.24022242426872253f,
        degree == 4 ? 0.05591785907745361f : 5.550733581185341e-2f,
        degree == 4 ? 0.009570100344717503f : 9.671512991189957e-3f,
        degree == 4 ? 0.0f : 1.326472731307149e-3f,
    };
    const D d;
    const hn::RebindToSigned<D> di;
    // Taken from 1.5·2²³, a number is rounded to a whole one, which is left in the lowest bits.
    const V magic = hn::Set(d, 12582912.0f);
    V shifted[N], f[N], square[N], low[N], high[N];
    for (int i = 0; i < N; ++i) shifted[i] = hn::Sub(magic, x[i]);
    for (int i = 0; i < N; ++i) f[i] = hn::Sub(magic, shifted[i]);
    for (int i = 0; i < N; ++i) f[i] = hn::Sub(f[i], x[i]);
    // In pairs of coefficients, which takes less of a chain than Horner's scheme.
    for (int i = 0; i < N; ++i) square[i] = hn::Mul(f[i], f[i]);
    for (int i = 0; i < N; ++i) low[i] = hn::Add(hn::Mul(f[i], hn::Set(d, c[1])), hn::Set(d, c[0]));
    for (int i = 0; i < N; ++i)
        high[i] = hn::Add(hn::Mul(f[i], hn::Set(d, c[3])), hn::Set(d, c[2]));
    for (int i = 0; i < N; ++i) {
        V highest = hn::Set(d, c[4]);
        if constexpr (degree == 5) highest = hn::Add(hn::Mul(f[i], hn::Set(d, c[5])), highest);
        high[i] = hn::Add(high[i], hn::Mul(square[i], highest));
    }
    for (int i = 0; i < N; ++i) low[i] = hn::Add(low[i], hn::Mul(high[i], square[i]));
    for (int i = 0; i < N; ++i) {
        const auto bits =
            hn::Add(hn::BitCast(di, low[i]), hn::ShiftLeft<23>(hn::BitCast(di, shifted[i])));
        power[i] = hn::BitCast(d, bits);
    }
}

/// power ← 2^−x for 0 ≤ x < zero_from ≤ 126, 0 from there on and for NaN.
template <int degree, int N>
HWY_INLINE void Exp2Minus(const V (&x)[N], float zero_from, V (&power)[N])
{
    const D d;
    Exp2MinusInRange<degree>(x, power);
    for (int i = 0; i < N; ++i)
        power[i] = hn::IfThenElseZero(hn::Lt(x[i], hn::Set(d, zero_from)), power[i]);
}

/// The same for one vector.
template <int degree>
HWY_INLINE V Exp2MinusInRange(V x)
{
    const V in[1] = {x};
    V power[1];
    Exp2MinusInRange<degree>(in, power);
    return power[0];
}
template <int degree>
HWY_INLINE V Exp2Minus(V x, float zero_from)
{
    const V in[1] = {x};
    V power[1];
    Exp2Minus<degree>(in, zero_from, power);
    return power[0];
}

} // namespace rayloom::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
