// SPDX-License-Identifier: Apache-2.0
/// \file
/// Weights of the pairs of a group of neighbouring offsets from their patch distances and the
/// gate, and the sums that they go into. Included once per SIMD target.
#if defined(RAYLOOM_NLM_WEIGHTS_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef RAYLOOM_NLM_WEIGHTS_INL_H
#undef RAYLOOM_NLM_WEIGHTS_INL_H
#else
#define RAYLOOM_NLM_WEIGHTS_INL_H
#endif

#include "nodes/fuse/nlm_kernel.h"
#include "rayloom/simd/exp2-inl.h"
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

/// Weights are zero from 2^−far on.
constexpr float far = 115.0f;

/// Where the mask holds and a ≤ b. NaN is not.
HWY_INLINE M AlsoLe(M mask, V a, V b)
{
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
    return M{_mm512_mask_cmp_ps_mask(mask.raw, a.raw, b.raw, _CMP_LE_OQ)};
#else
    return hn::And(mask, hn::Le(a, b));
#endif
}
/// Where the mask holds and a ≥ b.
HWY_INLINE M AlsoGe(M mask, V a, V b)
{
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3
    return M{_mm512_mask_cmp_ps_mask(mask.raw, a.raw, b.raw, _CMP_GE_OQ)};
#else
    return hn::And(mask, hn::Ge(a, b));
#endif
}

/// One row of pixels p and what `count` neighbouring offsets find beside them.
struct WeightJob {
    int vectors, count;
    const float* inverse_p;
    const float* inverse_q; ///< at the first offset, like everything else of q
    const float* distances; ///< [vector][offset][lane]
    const float* spatial;   ///< per offset: |q − p|² / (2 σ_s²) · log₂ e
    struct Side {
        const float* tested;
        const float* low;
        const float* high;
        const float* spread;
    } p, q;
    int gate_channels;
    std::ptrdiff_t stride; ///< from one channel to the next of whatever is of p or q
    float* into_p; ///< out, [offset][weight_stride]: the weight of q in p, unless added here
    float* into_q; ///< out: the weight of p in q
    std::ptrdiff_t weight_stride;
    const float* values; ///< of q, three channels; added to `sums` for vectors in [first, last)
    float* sums;         ///< of p: three channels and the weights
    std::ptrdiff_t sums_stride;
    int first, last;
};

/// The gate between a vector of pixels p and others. It keeps the p of a fixed number of channels.
/// \tparam channels 3 or, for any number, 0.
template <NlmGate gate, int channels>
class Gate;

template <int channels>
class Gate<NlmGate::none, channels>
{
public:
    HWY_INLINE Gate(const WeightJob&, int) {}
    HWY_INLINE void Test(int, M&, M&) const {}
};

/// q enters p when low(p) ≤ x(q) ≤ high(p), and the other way round.
template <int channels>
class Gate<NlmGate::one_sample, channels>
{
public:
    HWY_INLINE Gate(const WeightJob& job, int x)
        : m_p(job.p), m_q(job.q), m_stride(job.stride), m_channels(job.gate_channels), m_x(x)
    {
        for (int c = 0; c < channels; ++c) m_own[c] = At(c);
    }
    HWY_INLINE void Test(int x, M& into_p, M& into_q) const
    {
        if constexpr (channels > 0)
            for (int c = 0; c < channels; ++c) Test(m_own[c], c, x, into_p, into_q);
        else
            for (int c = 0; c < m_channels; ++c) Test(At(c), c, x, into_p, into_q);
    }

private:
    struct Channel {
        V x, low, high;
    };
    HWY_INLINE Channel At(int c) const
    {
        const D d;
        const std::ptrdiff_t at = c * m_stride + m_x;
        return {hn::LoadU(d, m_p.tested + at), hn::LoadU(d, m_p.low + at),
                hn::LoadU(d, m_p.high + at)};
    }
    HWY_INLINE void Test(const Channel& p, int c, int x, M& into_p, M& into_q) const
    {
        const D d;
        const V x_q = hn::LoadU(d, m_q.tested + x + c * m_stride);
        into_p = AlsoLe(AlsoGe(into_p, x_q, p.low), x_q, p.high);
        into_q = AlsoGe(into_q, p.x, hn::LoadU(d, m_q.low + x + c * m_stride));
        into_q = AlsoLe(into_q, p.x, hn::LoadU(d, m_q.high + x + c * m_stride));
    }

    WeightJob::Side m_p, m_q;
    std::ptrdiff_t m_stride;
    int m_channels, m_x;
    Channel m_own[channels > 0 ? channels : 1];
};

/// p and q enter each other when (x(p) − x(q))² ≤ h²(p) + h²(q).
template <int channels>
class Gate<NlmGate::two_sample, channels>
{
public:
    HWY_INLINE Gate(const WeightJob& job, int x)
        : m_p(job.p), m_q(job.q), m_stride(job.stride), m_channels(job.gate_channels), m_x(x)
    {
        for (int c = 0; c < channels; ++c) m_own[c] = At(c);
    }
    HWY_INLINE void Test(int x, M& into_p, M&) const
    {
        if constexpr (channels > 0)
            for (int c = 0; c < channels; ++c) Test(m_own[c], c, x, into_p);
        else
            for (int c = 0; c < m_channels; ++c) Test(At(c), c, x, into_p);
    }

private:
    struct Channel {
        V x, spread;
    };
    HWY_INLINE Channel At(int c) const
    {
        const D d;
        const std::ptrdiff_t at = c * m_stride + m_x;
        return {hn::LoadU(d, m_p.tested + at), hn::LoadU(d, m_p.spread + at)};
    }
    HWY_INLINE void Test(const Channel& p, int c, int x, M& into_p) const
    {
        const D d;
        const V e = hn::Sub(p.x, hn::LoadU(d, m_q.tested + x + c * m_stride));
        const V most = hn::Add(p.spread, hn::LoadU(d, m_q.spread + x + c * m_stride));
        into_p = AlsoLe(into_p, hn::Mul(e, e), most);
    }

    WeightJob::Side m_p, m_q;
    std::ptrdiff_t m_stride;
    int m_channels, m_x;
    Channel m_own[channels > 0 ? channels : 1];
};

/// Where the weights of q in p go.
enum class Into {
    memory, ///< into_p
    sums,   ///< p's sums of three channels and of the weights, which stay in registers
    own,    ///< the same, where what the gate tests are the values
};

template <NlmGate gate, int gate_channels, Into into>
HWY_NOINLINE void Weigh(const WeightJob& job)
{
    const D d;
    constexpr bool add = into != Into::memory;
    const int lanes = LaneCount(), vectors = job.vectors, count = job.count;
    const float* distance = job.distances;
    const float* const spatial = job.spatial;
    const float* const inverse_q = job.inverse_q;
    const float* const values = into == Into::own ? job.q.tested : job.values;
    const std::ptrdiff_t stride = job.stride, sums_stride = job.sums_stride,
                         weight_stride = job.weight_stride;
    for (int v = 0; v < vectors; ++v) {
        const int x = v * lanes;
        const Gate<gate, gate_channels> tested(job, x);
        const V inverse_p = hn::LoadU(d, job.inverse_p + x);
        float* to_p = job.into_p + x;
        float* to_q = job.into_q + x;
        V r = hn::Zero(d), g = r, b = r, total = r;
        const bool added = add && v >= job.first && v < job.last;
        float* const sums = added ? job.sums + x : nullptr;
        if (added) {
            r = hn::LoadU(d, sums);
            g = hn::LoadU(d, sums + sums_stride);
            b = hn::LoadU(d, sums + 2 * sums_stride);
            total = hn::LoadU(d, sums + 3 * sums_stride);
        }
        for (int i = 0; i < count; ++i) {
            // The quieter pixel has the larger inverse; outside the image it is infinite, and
            // infinity or 0·∞ gives no weight.
            const V inverse = hn::Max(inverse_p, hn::LoadU(d, inverse_q + x + i));
            const V exponent =
                hn::Add(hn::Mul(hn::Load(d, distance), inverse), hn::Set(d, spatial[i]));
            distance += lanes;
            const V weight = Exp2MinusInRange<5>(exponent);
            M into_p = hn::Lt(exponent, hn::Set(d, far)), into_q = into_p;
            tested.Test(x + i, into_p, into_q);
            const V w = hn::IfThenElseZero(into_p, weight);
            hn::Store(gate == NlmGate::one_sample ? hn::IfThenElseZero(into_q, weight) : w, d,
                      to_q);
            to_q += weight_stride;
            if constexpr (add) {
                const float* q = values + x + i;
                r = hn::Add(r, hn::Mul(w, hn::LoadU(d, q)));
                g = hn::Add(g, hn::Mul(w, hn::LoadU(d, q + stride)));
                b = hn::Add(b, hn::Mul(w, hn::LoadU(d, q + 2 * stride)));
                total = hn::Add(total, w);
            } else if constexpr (gate == NlmGate::one_sample) {
                hn::Store(w, d, to_p);
                to_p += weight_stride;
            }
        }
        if (added) {
            hn::StoreU(r, d, sums);
            hn::StoreU(g, d, sums + sums_stride);
            hn::StoreU(b, d, sums + 2 * sums_stride);
            hn::StoreU(total, d, sums + 3 * sums_stride);
        }
    }
}

/// Adds Σ over a group's offsets of weight · value to one row of sums.
struct AddJob {
    const float* weights; ///< at the first offset; a step further for each
    std::ptrdiff_t weight_step;
    const float* values;
    std::ptrdiff_t value_step, value_stride;
    float* sums;
    std::ptrdiff_t sums_stride;
    int count, width;
};

/// `channels` planes of sums; `total`: the one after them receives the weights' sum.
template <int channels, bool total, bool squared>
HWY_NOINLINE void Add(const AddJob& job)
{
    const D d;
    const int lanes = LaneCount(), width = job.width, count = job.count;
    const std::ptrdiff_t weight_step = job.weight_step, value_step = job.value_step,
                         value_stride = job.value_stride, sums_stride = job.sums_stride;
    for (int x = 0; x < width; x += lanes) {
        V sum[channels], weights = hn::Zero(d);
        float* to = job.sums + x;
        for (int c = 0; c < channels; ++c) sum[c] = hn::LoadU(d, to + c * sums_stride);
        if constexpr (total) weights = hn::LoadU(d, to + channels * sums_stride);
        const float* weight = job.weights + x;
        const float* value = job.values + x;
        for (int i = 0; i < count; ++i) {
            V w = hn::LoadU(d, weight);
            if constexpr (total) weights = hn::Add(weights, w);
            if constexpr (squared) w = hn::Mul(w, w);
            for (int c = 0; c < channels; ++c)
                sum[c] = hn::Add(sum[c], hn::Mul(w, hn::LoadU(d, value + c * value_stride)));
            weight += weight_step;
            value += value_step;
        }
        for (int c = 0; c < channels; ++c) hn::StoreU(sum[c], d, to + c * sums_stride);
        if constexpr (total) hn::StoreU(weights, d, to + channels * sums_stride);
    }
}

/// Any number of planes; the weights' sum comes after the last.
template <bool total, bool squared>
HWY_INLINE void AddPlanes(AddJob job, int planes)
{
    while (planes > 3 + (total ? 1 : 0)) {
        Add<3, false, squared>(job);
        job.values += 3 * job.value_stride;
        job.sums += 3 * job.sums_stride;
        planes -= 3;
    }
    switch (planes) {
    case 1: return Add<1, total, squared>(job);
    case 2: return Add<2, total, squared>(job);
    case 3: return Add<3, total, squared>(job);
    case 4: return Add<4, total, squared>(job);
    default: return;
    }
}

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();
#endif
