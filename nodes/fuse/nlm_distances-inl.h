// SPDX-License-Identifier: Apache-2.0
/// \file
/// Distances of patches for a group of neighbouring offsets: squared differences, then the patch's
/// weights along rows, then along columns. Included once per SIMD target.
#if defined(RAYLOOM_NLM_DISTANCES_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef RAYLOOM_NLM_DISTANCES_INL_H
#undef RAYLOOM_NLM_DISTANCES_INL_H
#else
#define RAYLOOM_NLM_DISTANCES_INL_H
#endif

#include "nodes/fuse/nlm_kernel.h"
#include "rayloom/simd/neighbours-inl.h"

#include <cstddef>

HWY_BEFORE_NAMESPACE();
namespace rayloom
{
namespace HWY_NAMESPACE
{
namespace
{
using namespace simd::HWY_NAMESPACE;

/// Σ over channels of (F(p) − F(q))², three channels, for the offsets i … count − 1; q holds
/// two vectors of each, of which the first begins at `from`.
template <int i, int count>
HWY_INLINE void SquaredDifferences3(const V (&p)[3], const V (&q)[3][2], const float* from,
                                    std::ptrdiff_t stride, float* out, std::ptrdiff_t out_stride)
{
    if constexpr (i < count) {
        const V e = hn::Sub(p[0], Between<i>(q[0][0], q[0][1], from));
        const V f = hn::Sub(p[1], Between<i>(q[1][0], q[1][1], from + stride));
        const V g = hn::Sub(p[2], Between<i>(q[2][0], q[2][1], from + 2 * stride));
        hn::Store(hn::Add(hn::Add(hn::Mul(e, e), hn::Mul(f, f)), hn::Mul(g, g)), D(), out);
        SquaredDifferences3<i + 1, count>(p, q, from, stride, out + out_stride, out_stride);
    }
}
template <int count>
HWY_NOINLINE void SquaredDifferences3(const float* HWY_RESTRICT here,
                                      const float* HWY_RESTRICT there, std::ptrdiff_t stride, int n,
                                      float* HWY_RESTRICT out, std::ptrdiff_t out_stride)
{
    const D d;
    const int lanes = LaneCount();
    V q[3][2];
    for (int c = 0; c < 3; ++c) q[c][1] = hn::LoadU(d, there + c * stride);
    for (int x = 0; x < n; x += lanes) {
        V p[3];
        for (int c = 0; c < 3; ++c) {
            p[c] = hn::LoadU(d, here + c * stride + x);
            q[c][0] = q[c][1];
            q[c][1] = hn::LoadU(d, there + c * stride + x + lanes);
        }
        SquaredDifferences3<0, count>(p, q, there + x, stride, out + x, out_stride);
    }
}

/// Σ over channels of (F(p) − F(q))² for `count` neighbouring offsets; `there` is at the first.
/// out: [offset][out_stride].
HWY_NOINLINE void SquaredDifferences(const float* HWY_RESTRICT here,
                                     const float* HWY_RESTRICT there, std::ptrdiff_t stride,
                                     int channels, int count, int n, float* HWY_RESTRICT out,
                                     std::ptrdiff_t out_stride)
{
    if (channels == 3 && count == nlm_group_size)
        return SquaredDifferences3<nlm_group_size>(here, there, stride, n, out, out_stride);
    const D d;
    const int lanes = LaneCount();
    for (int x = 0; x < n; x += lanes)
        for (int i = 0; i < count; ++i) {
            V sum = hn::Zero(d);
            for (int c = 0; c < channels; ++c) {
                const float* p = here + c * stride + x;
                const V e = hn::Sub(hn::LoadU(d, p), hn::LoadU(d, there + c * stride + x + i));
                sum = hn::Add(sum, hn::Mul(e, e));
            }
            hn::Store(sum, d, out + i * out_stride + x);
        }
}

/// Σ weights[|k|] · load(k), −radius ≤ k ≤ radius; the radius is fixed_radius unless that is
/// negative. The weights stay in registers where it is fixed.
template <int fixed_radius>
class PatchWeights
{
public:
    HWY_INLINE PatchWeights(const float* weights, int radius) : m_weights(weights), m_radius(radius)
    {
        const D d;
        for (int k = 0; k <= fixed_radius; ++k) m_fixed[k] = hn::Set(d, weights[k]);
    }
    template <class Load>
    HWY_INLINE V Sum(const Load& load) const
    {
        const D d;
        if constexpr (fixed_radius >= 0) {
            V sum = hn::Mul(load(0), m_fixed[0]);
            for (int k = 1; k <= fixed_radius; ++k)
                sum = hn::Add(sum, hn::Mul(hn::Add(load(-k), load(k)), m_fixed[k]));
            return sum;
        } else {
            V sum = hn::Mul(load(0), hn::Set(d, m_weights[0]));
            for (int k = 1; k <= m_radius; ++k)
                sum = hn::Add(sum, hn::Mul(hn::Add(load(-k), load(k)), hn::Set(d, m_weights[k])));
            return sum;
        }
    }

private:
    const float* m_weights;
    int m_radius;
    V m_fixed[fixed_radius >= 0 ? fixed_radius + 1 : 1];
};

/// `sum` and the pairs k … radius of a row's taps, which begin at p.
template <int radius, int k>
HWY_INLINE V AddPairs(V sum, V first, V second, const float* p, const V* weights)
{
    if constexpr (k > radius) {
        return sum;
    } else {
        const V pair =
            hn::Add(Between<radius - k>(first, second, p), Between<radius + k>(first, second, p));
        return AddPairs<radius, k + 1>(hn::Add(sum, hn::Mul(pair, weights[k])), first, second, p,
                                       weights);
    }
}

/// Weighted sums along rows. `in`: [offset][in_stride], beginning `radius` pixels before the first
/// one; out: [vector][offset][lane].
template <int fixed_radius>
HWY_NOINLINE void FilterRows(const float* HWY_RESTRICT in, std::ptrdiff_t in_stride,
                             const float* weights, int radius, int vectors, int count,
                             float* HWY_RESTRICT out)
{
    const D d;
    const int lanes = LaneCount();
    const std::ptrdiff_t step = static_cast<std::ptrdiff_t>(count) * lanes;
    if constexpr (fixed_radius > 0) {
        V fixed[fixed_radius + 1];
        for (int k = 0; k <= fixed_radius; ++k) fixed[k] = hn::Set(d, weights[k]);
        for (int g = 0; g < count; ++g) {
            const float* from = in + g * in_stride;
            float* to = out + static_cast<std::ptrdiff_t>(g) * lanes;
            V first = hn::Load(d, from);
            for (const float* end = from + vectors * lanes; from != end; from += lanes) {
                const V second = hn::Load(d, from + lanes);
                const V sum = hn::Mul(Between<fixed_radius>(first, second, from), fixed[0]);
                hn::Store(AddPairs<fixed_radius, 1>(sum, first, second, from, fixed), d, to);
                to += step;
                first = second;
            }
        }
    } else {
        const PatchWeights<fixed_radius> patch(weights, radius);
        for (int g = 0; g < count; ++g) {
            const float* centre = in + g * in_stride + radius;
            float* to = out + static_cast<std::ptrdiff_t>(g) * lanes;
            for (const float* end = centre + vectors * lanes; centre != end; centre += lanes) {
                hn::Store(patch.Sum([&](int k) HWY_ATTR { return hn::LoadU(D(), centre + k); }), d,
                          to);
                to += step;
            }
        }
    }
}

/// Weighted sums along columns, `nlm_column_rows` rows of n floats at a time. rows:
/// [2·radius + nlm_column_rows].
template <int fixed_radius>
HWY_NOINLINE void FilterColumns(const float* const* rows, const float* weights, int radius,
                                std::ptrdiff_t n, float* const (&out)[nlm_column_rows])
{
    const D d;
    const std::ptrdiff_t lanes = LaneCount();
    const PatchWeights<fixed_radius> patch(weights, radius);
    if constexpr (fixed_radius >= 0) {
        constexpr int loaded = 2 * fixed_radius + nlm_column_rows;
        const float* row[loaded];
        float* to[nlm_column_rows];
        for (int k = 0; k < loaded; ++k) row[k] = rows[k];
        for (int i = 0; i < nlm_column_rows; ++i) to[i] = out[i];
        for (std::ptrdiff_t x = 0; x < n; x += lanes) {
            V in[loaded];
            for (int k = 0; k < loaded; ++k) in[k] = hn::Load(d, row[k] + x);
            for (int i = 0; i < nlm_column_rows; ++i)
                hn::Store(patch.Sum([&](int k) HWY_ATTR { return in[i + fixed_radius + k]; }), d,
                          to[i] + x);
        }
    } else {
        for (std::ptrdiff_t x = 0; x < n; x += lanes)
            for (int i = 0; i < nlm_column_rows; ++i)
                hn::Store(patch.Sum([&](int k) HWY_ATTR {
                    return hn::Load(D(), rows[i + radius + k] + x);
                }),
                          d, out[i] + x);
    }
}

/// Calls run.template operator()<radius>() with the radius where there is code for it, else −1.
template <class Run>
void WithFixedRadius(int radius, const Run& run)
{
    switch (radius) {
    case 1: return run.template operator()<1>();
    case 2: return run.template operator()<2>();
    case 3: return run.template operator()<3>();
    case 4: return run.template operator()<4>();
    case 5: return run.template operator()<5>();
    default: return run.template operator()<-1>();
    }
}

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();
#endif
