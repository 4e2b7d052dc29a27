// SPDX-License-Identifier: Apache-2.0
/// \file
/// What the kernels of fit.plane and fuse.planes share on each SIMD target. Included once per
/// target.
#if defined(RAYLOOM_PLANES_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef RAYLOOM_PLANES_INL_H
#undef RAYLOOM_PLANES_INL_H
#else
#define RAYLOOM_PLANES_INL_H
#endif

#include "nodes/fuse/planes_scene.h"
#include "rayloom/simd/exp2-inl.h"

HWY_BEFORE_NAMESPACE();
namespace rayloom
{
namespace HWY_NAMESPACE
{
namespace
{
using namespace simd::HWY_NAMESPACE;

/// w ← w · 2^−t for t ≥ 0. From t = 60 on it is 0: squares of weights are added up, and those that
/// are not normal numbers are slow.
template <int N>
HWY_INLINE void TimesExp2Minus(const V (&t)[N], V (&w)[N])
{
    V power[N];
    Exp2Minus<4>(t, 60.0f, power);
    for (int i = 0; i < N; ++i) w[i] = hn::Mul(power[i], w[i]);
}

/// w_n · w_part of a vector of pixels with others. Everything it needs is its own, so that stores
/// of its user do not make the compiler read it again.
class Guide
{
public:
    /// `own` is channel 0 of the pixels.
    Guide(const PlaneScene& scene, const float* own)
        : m_row(own), m_stride(scene.pixels.view().channel_stride()),
          m_normal(scene.normal * m_stride), m_parts(scene.parts * m_stride),
          m_pairs(scene.part_pairs), m_has_normal(scene.has_normal),
          m_lacks_normals(scene.lacks_normals)
    {
        const D d;
        m_n0 = m_n1 = m_n2 = m_n3 = m_id = m_cover = hn::Zero(d);
        if (m_has_normal) {
            const float* const n = m_row + m_normal;
            m_n0 = hn::LoadU(d, n);
            m_n1 = hn::LoadU(d, n + m_stride);
            m_n2 = hn::LoadU(d, n + 2 * m_stride);
            m_n3 = hn::LoadU(d, n + 3 * m_stride);
        }
        if (m_pairs > 0) {
            m_id = hn::LoadU(d, m_row + m_parts);
            m_cover = hn::LoadU(d, m_row + m_parts + m_stride);
        }
    }

    /// With the pixels whose channel 0 begins at `other`.
    HWY_INLINE V With(const float* other) const
    {
        const D d;
        V w = hn::Set(d, 1.0f);
        if (m_has_normal) {
            const float* const n = other + m_normal;
            V dot = hn::Mul(m_n0, hn::LoadU(d, n));
            dot = hn::Add(dot, hn::Mul(m_n1, hn::LoadU(d, n + m_stride)));
            dot = hn::Add(dot, hn::Mul(m_n2, hn::LoadU(d, n + 2 * m_stride)));
            if (m_lacks_normals) dot = hn::Add(dot, hn::Mul(m_n3, hn::LoadU(d, n + 3 * m_stride)));
            const V square = hn::Mul(dot, dot);
            w = hn::IfThenElseZero(hn::Gt(dot, hn::Set(d, 0.5f)), hn::Mul(square, square));
        }
        if (m_pairs > 0) {
            V shared = Share(m_id, m_cover, other + m_parts);
            if (m_pairs > 1) shared = hn::Min(OtherPairs(other, shared), hn::Set(d, 1.0f));
            w = hn::Mul(w, shared);
        }
        return w;
    }

private:
    HWY_INLINE V Share(V id, V cover, const float* pair) const
    {
        const D d;
        const M same = hn::Eq(id, hn::LoadU(d, pair));
        return hn::IfThenElseZero(same, hn::Min(cover, hn::LoadU(d, pair + m_stride)));
    }
    HWY_INLINE V OtherPairs(const float* other, V shared) const
    {
        const D d;
        for (int i = 0; i < m_pairs; ++i) {
            const float* const own = m_row + m_parts + 2 * i * m_stride;
            const V id = hn::LoadU(d, own), cover = hn::LoadU(d, own + m_stride);
            for (int j = i == 0 ? 1 : 0; j < m_pairs; ++j)
                shared = hn::Add(shared, Share(id, cover, other + m_parts + 2 * j * m_stride));
        }
        return shared;
    }

    const float* const m_row;
    const std::ptrdiff_t m_stride, m_normal, m_parts;
    const int m_pairs;
    const bool m_has_normal, m_lacks_normals;
    V m_n0, m_n1, m_n2, m_n3, m_id, m_cover;
};

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();

#endif
