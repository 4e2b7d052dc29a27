// SPDX-License-Identifier: Apache-2.0
/// \file
/// Vectors that begin between two others. Included once per SIMD target, as lanes-inl.h.
#if defined(RAYLOOM_SIMD_NEIGHBOURS_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef RAYLOOM_SIMD_NEIGHBOURS_INL_H
#undef RAYLOOM_SIMD_NEIGHBOURS_INL_H
#else
#define RAYLOOM_SIMD_NEIGHBOURS_INL_H
#endif

#include "rayloom/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace rayloom::simd::HWY_NAMESPACE
{

/// What is in memory from p + k on, 0 ≤ k ≤ 16, where p holds `first` and, behind it, `second`.
/// With 16 lanes a load from between nearly always touches two lines of the cache and takes as long
/// as two loads, so there it is put together from registers; elsewhere it is loaded.
template <int k>
HWY_INLINE V Between(V first, V second, const float* p)
{
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
    (void)p;
    static_assert(k >= 0 && k <= 16);
    if constexpr (k == 0)
        return first;
    else if constexpr (k == 16)
        return second;
    else
        return V{_mm512_castsi512_ps(_mm512_alignr_epi32(_mm512_castps_si512(second.raw),
                                                         _mm512_castps_si512(first.raw), k))};
#else
    (void)first;
    (void)second;
    return hn::LoadU(D(), p + k);
#endif
}

} // namespace rayloom::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
