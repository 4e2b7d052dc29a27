// SPDX-License-Identifier: Apache-2.0
/// \file
/// Vectors of floats as kernels speak of them. Included once per SIMD target, behind
/// <hwy/foreach_target.h>, in a file that says `using namespace simd::HWY_NAMESPACE;` between
/// HWY_BEFORE_NAMESPACE() and HWY_AFTER_NAMESPACE().
#if defined(RAYLOOM_SIMD_LANES_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef RAYLOOM_SIMD_LANES_INL_H
#undef RAYLOOM_SIMD_LANES_INL_H
#else
#define RAYLOOM_SIMD_LANES_INL_H
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace rayloom::simd::HWY_NAMESPACE
{
namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<float>; ///< as many lanes as the target has
using V = hn::Vec<D>;
using M = hn::Mask<D>;

/// Lanes of a vector, as loops over pixels count.
HWY_INLINE int LaneCount() { return static_cast<int>(hn::Lanes(D())); }

/// `count` plus one in the lanes of the mask.
HWY_INLINE V Counted(V count, M mask)
{
    const D d;
#if HWY_TARGET <= HWY_AVX3
    return hn::IfThenElse(mask, hn::Add(count, hn::Set(d, 1.0f)), count);
#else
    return hn::Add(count, hn::IfThenElseZero(mask, hn::Set(d, 1.0f)));
#endif
}

} // namespace rayloom::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif
