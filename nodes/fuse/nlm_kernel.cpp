// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/nlm_kernel.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "nodes/fuse/nlm_kernel.cpp"
#include <hwy/aligned_allocator.h>
#include <hwy/foreach_target.h>

#include "rayloom/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace rayloom
{
namespace HWY_NAMESPACE
{
namespace
{
using namespace simd::HWY_NAMESPACE;

/// Offsets of one row of the window that are worked on together, so that what they share is loaded
/// once and their rows stay in the first-level cache.
constexpr int group_size = 8;
/// Weights are zero from 2^−far on.
constexpr float far = 115.0f;

/// 2^−x for 0 ≤ x < far, 0 from there on and for NaN.
HWY_INLINE V PowerOfTwoNegative(V x)
{
    const D d;
    const hn::RebindToSigned<D> di;
    // Adding 1.5·2²³ rounds to a whole number, which is then in the lowest bits.
    const V magic = hn::Set(d, 12582912.0f);
    const V shifted = hn::Sub(magic, x);
    const V r = hn::Sub(hn::Sub(magic, shifted), x);
    // In pairs of coefficients, which takes less of a chain than Horner's scheme.
    const auto pair = [r](float low, float high) HWY_ATTR {
        const D tag;
        return hn::Add(hn::Mul(r, hn::Set(tag, high)), hn::Set(tag, low));
    };
    const V r2 = hn::Mul(r, r);
    V p = pair(9.671512991189957e-3f, 1.326472731307149e-3f);
    p = hn::Add(hn::Mul(p, r2), pair(0.24022242426872253f, 5.550733581185341e-2f));
    p = hn::Add(hn::Mul(p, r2), pair(1.0f, 0.6931470036506653f));
    const auto bits = hn::Add(hn::BitCast(di, p), hn::ShiftLeft<23>(hn::BitCast(di, shifted)));
    return hn::IfThenElseZero(hn::Lt(x, hn::Set(d, far)), hn::BitCast(d, bits));
}

void PowerOfTwoNegativeSpan(const float* x, float* result, std::size_t n)
{
    const hn::CappedTag<float, 1> d1;
    const D d;
    const std::size_t lanes = hn::Lanes(d);
    HWY_ALIGN float in[HWY_MAX_BYTES / sizeof(float)] = {};
    HWY_ALIGN float out[HWY_MAX_BYTES / sizeof(float)];
    for (std::size_t i = 0; i < n; i += lanes) {
        const std::size_t m = std::min(lanes, n - i);
        for (std::size_t k = 0; k < m; ++k) hn::Store(hn::LoadU(d1, x + i + k), d1, in + k);
        const V v = hn::Load(d, in);
        hn::Store(PowerOfTwoNegative(v), d, out);
        std::copy_n(out, m, result + i);
    }
}

/// Neighbouring offsets of one row of the window, and the pixels p whose pairs (p, p + offset) are
/// looked at: whole vectors from x0 on.
struct Group {
    int first_dx = 0, count = 0;
    int x0 = 0, vectors = 0;
    float* ring = nullptr; ///< [row of the patch][vector][group_size][lane], summed horizontally
};

/// Σ over channels of (F(p) − F(q))² for a group's offsets; `there` is at the first of them.
template <int fixed_channels>
HWY_NOINLINE void SquaredDifferences(const float* HWY_RESTRICT here,
                                     const float* HWY_RESTRICT there, std::ptrdiff_t stride,
                                     int channels, int count, int n, float* HWY_RESTRICT out,
                                     std::ptrdiff_t out_stride)
{
    const D d;
    const int lanes = LaneCount();
    for (int x = 0; x < n; x += lanes) {
        if constexpr (fixed_channels == 3) {
            const V a = hn::LoadU(d, here + x), b = hn::LoadU(d, here + stride + x),
                    c = hn::LoadU(d, here + 2 * stride + x);
            for (int g = 0; g < count; ++g) {
                const float* q = there + x + g;
                const V e = hn::Sub(a, hn::LoadU(d, q));
                const V f = hn::Sub(b, hn::LoadU(d, q + stride));
                const V h = hn::Sub(c, hn::LoadU(d, q + 2 * stride));
                hn::Store(hn::Add(hn::Add(hn::Mul(e, e), hn::Mul(f, f)), hn::Mul(h, h)), d,
                          out + g * out_stride + x);
            }
        } else {
            for (int g = 0; g < count; ++g) {
                V sum = hn::Zero(d);
                for (int c = 0; c < channels; ++c) {
                    const float* p = here + c * stride + x;
                    const V e = hn::Sub(hn::LoadU(d, p), hn::LoadU(d, there + c * stride + x + g));
                    sum = hn::Add(sum, hn::Mul(e, e));
                }
                hn::Store(sum, d, out + g * out_stride + x);
            }
        }
    }
}

/// Weights of a patch's rows and columns, in registers where the radius is fixed.
template <int fixed_radius>
class PatchWeights
{
public:
    HWY_INLINE PatchWeights(const float* weights, int radius) : m_weights(weights), m_radius(radius)
    {
        const D d;
        for (int k = 0; k <= fixed_radius; ++k) m_fixed[k] = hn::Set(d, weights[k]);
    }
    /// Σ weight(|k|) · load(k), −radius ≤ k ≤ radius.
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

/// Weighted sums over rows of a patch, for a group's offsets. `in` begins `radius` pixels before
/// the first pixel.
template <int fixed_radius>
HWY_NOINLINE void FilterRows(const float* HWY_RESTRICT in, std::ptrdiff_t in_stride,
                             const float* weights, int radius, const Group& group,
                             float* HWY_RESTRICT out)
{
    const D d;
    const int lanes = LaneCount(), vectors = group.vectors, count = group.count;
    const PatchWeights<fixed_radius> patch(weights, radius);
    for (int v = 0; v < vectors; ++v) {
        const float* centre = in + v * lanes + radius;
        float* to = out + static_cast<std::ptrdiff_t>(v) * group_size * lanes;
        for (int g = 0; g < count; ++g, centre += in_stride, to += lanes)
            hn::Store(patch.Sum([&](int k) HWY_ATTR { return hn::LoadU(D(), centre + k); }), d, to);
    }
}

/// Planes of the gate at the first pixel of a row.
struct Side {
    const float* tested;
    const float* low;
    const float* high;
    const float* spread;
};

/// The gate of one row of pixels for a group's offsets.
struct GateJob {
    Side p, q; ///< q at the group's first offset
    std::ptrdiff_t tested_stride, low_stride, high_stride, spread_stride;
    int channels;
    float* into_p; ///< [offset][stride]: not negative where p accepts q
    float* into_q; ///< the same where q accepts p
    std::ptrdiff_t stride;
};

/// Distance of x inside its interval, negative outside.
HWY_INLINE V Inside(V low, V high, V x) { return hn::Min(hn::Sub(x, low), hn::Sub(high, x)); }

/// A channel of the one-sample gate.
struct OneSample {
    HWY_INLINE OneSample(const GateJob& job, int c, int x)
    {
        const D d;
        x_p = hn::LoadU(d, job.p.tested + c * job.tested_stride + x);
        low_p = hn::LoadU(d, job.p.low + c * job.low_stride + x);
        high_p = hn::LoadU(d, job.p.high + c * job.high_stride + x);
    }
    V x_p, low_p, high_p;
};

template <int fixed_channels>
HWY_NOINLINE void GateOneSample(const Group& group, const GateJob& job)
{
    const D d;
    const int lanes = LaneCount(), vectors = group.vectors, count = group.count;
    const std::ptrdiff_t stride = job.stride;
    const auto slack = [&job](const OneSample& p, int c, int q, V& into_p, V& into_q) HWY_ATTR {
        const D tag;
        const V x_q = hn::LoadU(tag, job.q.tested + c * job.tested_stride + q);
        const V low_q = hn::LoadU(tag, job.q.low + c * job.low_stride + q);
        const V high_q = hn::LoadU(tag, job.q.high + c * job.high_stride + q);
        into_p = Inside(p.low_p, p.high_p, x_q);
        into_q = Inside(low_q, high_q, p.x_p);
    };
    for (int v = 0; v < vectors; ++v) {
        const int x = v * lanes;
        float* to_p = job.into_p + x;
        float* to_q = job.into_q + x;
        const OneSample first(job, 0, x);
        const OneSample second(job, fixed_channels > 1 ? 1 : 0, x);
        const OneSample third(job, fixed_channels > 2 ? 2 : 0, x);
        for (int g = 0; g < count; ++g) {
            V into_p, into_q, more_p, more_q;
            slack(first, 0, x + g, into_p, into_q);
            if constexpr (fixed_channels == 3) {
                slack(second, 1, x + g, more_p, more_q);
                into_p = hn::Min(into_p, more_p);
                into_q = hn::Min(into_q, more_q);
                slack(third, 2, x + g, more_p, more_q);
                into_p = hn::Min(into_p, more_p);
                into_q = hn::Min(into_q, more_q);
            } else {
                for (int c = 1; c < job.channels; ++c) {
                    slack(OneSample(job, c, x), c, x + g, more_p, more_q);
                    into_p = hn::Min(into_p, more_p);
                    into_q = hn::Min(into_q, more_q);
                }
            }
            hn::Store(into_p, d, to_p + g * stride);
            hn::Store(into_q, d, to_q + g * stride);
        }
    }
}

/// A channel of the two-sample gate.
struct TwoSample {
    HWY_INLINE TwoSample(const GateJob& job, int c, int x)
    {
        const D d;
        x_p = hn::LoadU(d, job.p.tested + c * job.tested_stride + x);
        spread_p = hn::LoadU(d, job.p.spread + c * job.spread_stride + x);
    }
    V x_p, spread_p;
};

template <int fixed_channels>
HWY_NOINLINE void GateTwoSample(const Group& group, const GateJob& job)
{
    const D d;
    const int lanes = LaneCount(), vectors = group.vectors, count = group.count;
    const std::ptrdiff_t stride = job.stride;
    const auto slack = [&job](const TwoSample& p, int c, int q) HWY_ATTR {
        const D tag;
        const V e = hn::Sub(p.x_p, hn::LoadU(tag, job.q.tested + c * job.tested_stride + q));
        const V most =
            hn::Add(p.spread_p, hn::LoadU(tag, job.q.spread + c * job.spread_stride + q));
        return hn::Sub(most, hn::Mul(e, e));
    };
    for (int v = 0; v < vectors; ++v) {
        const int x = v * lanes;
        float* to = job.into_p + x;
        const TwoSample first(job, 0, x);
        const TwoSample second(job, fixed_channels > 1 ? 1 : 0, x);
        const TwoSample third(job, fixed_channels > 2 ? 2 : 0, x);
        for (int g = 0; g < count; ++g) {
            V into_p = slack(first, 0, x + g);
            if constexpr (fixed_channels == 3) {
                into_p = hn::Min(into_p, slack(second, 1, x + g));
                into_p = hn::Min(into_p, slack(third, 2, x + g));
            } else {
                for (int c = 1; c < job.channels; ++c)
                    into_p = hn::Min(into_p, slack(TwoSample(job, c, x), c, x + g));
            }
            hn::Store(into_p, d, to + g * stride);
        }
    }
}

/// Turns the gate's results of one row of pixels into weights, for a group's offsets.
struct WeightJob {
    const float* inverse_p;
    const float* inverse_q;   ///< at the group's first offset
    const float* const* rows; ///< the patch's [2·radius + 1], summed horizontally
    const float* patch;       ///< [radius + 1]
    int radius;
    const float* spatial; ///< per offset: |q − p|² / (2 σ_s²) · log₂ e
    float* into_p;        ///< [offset][stride]: in the gate's result, out the weight of q in p
    float* into_q;        ///< weight of p in q, where the gate is not symmetric
    std::ptrdiff_t stride;
};

template <NlmGate gate, int fixed_radius>
HWY_NOINLINE void Weigh(const Group& group, const WeightJob& job)
{
    const D d;
    const int lanes = LaneCount(), vectors = group.vectors, count = group.count;
    const int radius = fixed_radius >= 0 ? fixed_radius : job.radius;
    const float* const* rows = job.rows;
    const PatchWeights<fixed_radius> patch(job.patch, radius);
    const std::ptrdiff_t stride = job.stride;
    for (int v = 0; v < vectors; ++v) {
        const int x = v * lanes;
        float* to_p = job.into_p + x;
        float* to_q = job.into_q + x;
        const float* other = job.inverse_q + x;
        const V inverse_p = hn::LoadU(d, job.inverse_p + x);
        std::ptrdiff_t at = static_cast<std::ptrdiff_t>(v) * group_size * lanes;
        for (int g = 0; g < count; ++g, at += lanes, to_p += stride, to_q += stride) {
            const V distance =
                patch.Sum([&](int k) HWY_ATTR { return hn::Load(D(), rows[radius + k] + at); });
            // The quieter pixel has the larger inverse; outside the image it is infinite, and
            // infinity or 0·∞ gives no weight.
            const V inverse = hn::Max(inverse_p, hn::LoadU(d, other + g));
            const V exponent = hn::Add(hn::Mul(distance, inverse), hn::Set(d, job.spatial[g]));
            const V weight = PowerOfTwoNegative(exponent);
            if constexpr (gate == NlmGate::none) {
                hn::Store(weight, d, to_p);
            } else {
                const M p = hn::Ge(hn::Load(d, to_p), hn::Zero(d));
                hn::Store(hn::IfThenElseZero(p, weight), d, to_p);
            }
            if constexpr (gate == NlmGate::one_sample) {
                const M q = hn::Ge(hn::Load(d, to_q), hn::Zero(d));
                hn::Store(hn::IfThenElseZero(q, weight), d, to_q);
            }
        }
    }
}

template <NlmGate gate>
void WeighFor(const Group& group, const WeightJob& job)
{
    switch (job.radius) {
    case 1: return Weigh<gate, 1>(group, job);
    case 2: return Weigh<gate, 2>(group, job);
    case 3: return Weigh<gate, 3>(group, job);
    case 4: return Weigh<gate, 4>(group, job);
    case 5: return Weigh<gate, 5>(group, job);
    default: return Weigh<gate, -1>(group, job);
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
    const int lanes = LaneCount();
    for (int x = 0; x < job.width; x += lanes) {
        V sum[channels], weights = hn::Zero(d);
        float* to = job.sums + x;
        for (int c = 0; c < channels; ++c) sum[c] = hn::LoadU(d, to + c * job.sums_stride);
        if constexpr (total) weights = hn::LoadU(d, to + channels * job.sums_stride);
        const float* weight = job.weights + x;
        const float* value = job.values + x;
        for (int g = 0; g < job.count; ++g) {
            V w = hn::LoadU(d, weight);
            if constexpr (total) weights = hn::Add(weights, w);
            if constexpr (squared) w = hn::Mul(w, w);
            for (int c = 0; c < channels; ++c)
                sum[c] = hn::Add(sum[c], hn::Mul(w, hn::LoadU(d, value + c * job.value_stride)));
            weight += job.weight_step;
            value += job.value_step;
        }
        for (int c = 0; c < channels; ++c) hn::StoreU(sum[c], d, to + c * job.sums_stride);
        if constexpr (total) hn::StoreU(weights, d, to + channels * job.sums_stride);
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

int RoundedUp(int value, int to) { return (value + to - 1) / to * to; }

const float* At(const ConstImageView& view, int x, int y)
{
    return view.empty() ? nullptr : view.ptr(0, x, y);
}

Side SideAt(const NlmFrame& frame, int x, int y)
{
    return {At(frame.tested, x, y), At(frame.low, x, y), At(frame.high, x, y),
            At(frame.spread, x, y)};
}

/// All pairs of the current frame with one frame. Within the current frame each pair serves both
/// its pixels.
class Pairs
{
public:
    Pairs(const NlmJob& job, const NlmFrame& other, std::span<const float> patch,
          hwy::AlignedFreeUniquePtr<float[]>& scratch, std::size_t& scratch_size)
        : m_job(job), m_here(job.frames[0]), m_there(other), m_both(&other == &job.frames[0]),
          m_patch(patch), m_lanes(LaneCount())
    {
        const int reach = job.settings.window_radius, radius = job.settings.patch_radius;
        m_slots = 2 * radius + 1;
        m_row = RoundedUp(job.region.width() + (m_both ? reach + group_size : 0) + 2 * radius,
                          m_lanes) +
                3 * m_lanes;
        const std::size_t row = static_cast<std::size_t>(m_row) * group_size;
        m_ring = row * static_cast<std::size_t>(m_slots);
        const std::size_t groups = static_cast<std::size_t>((2 * reach + group_size) / group_size);
        const std::size_t size = groups * m_ring + 3 * row;
        if (size > scratch_size) {
            scratch = hwy::AllocateAligned<float>(size);
            std::fill_n(scratch.get(), size, 0.0f);
            scratch_size = size;
        }
        m_differences = scratch.get();
        m_into_p = m_differences + row;
        m_into_q = m_into_p + row;
        m_rings = m_into_q + row;
        if (job.settings.gate != NlmGate::one_sample) m_into_q = m_into_p;
    }

    void Run()
    {
        const int reach = m_job.settings.window_radius;
        for (int dy = m_both ? 0 : -reach; dy <= reach; ++dy) RunRow(dy);
    }

private:
    /// Every pixel of the region sees all offsets of a group, from either side.
    std::vector<Group> GroupsOf(int dy) const
    {
        const int reach = m_job.settings.window_radius;
        std::vector<Group> groups;
        for (int dx = m_both && dy == 0 ? 1 : -reach; dx <= reach; dx += group_size) {
            Group group;
            group.first_dx = dx;
            group.count = std::min(group_size, reach - dx + 1);
            const int last_dx = dx + group.count - 1;
            const int before = m_both ? RoundedUp(std::max(0, last_dx), m_lanes) : 0;
            const int after = m_both ? std::max(0, -dx) : 0;
            group.x0 = m_job.region.x0 - before;
            group.vectors = (before + m_job.region.width() + after + m_lanes - 1) / m_lanes;
            group.ring = m_rings + groups.size() * m_ring;
            groups.push_back(group);
        }
        return groups;
    }

    void RunRow(int dy)
    {
        const Region& region = m_job.region;
        const Region& window = m_job.window;
        const int radius = m_job.settings.patch_radius;
        const int y0 =
            std::max(m_both ? region.y0 - dy : region.y0, std::max(window.y0, window.y0 - dy));
        const int y1 = std::min(region.y1, std::min(window.y1, window.y1 - dy));
        if (y0 >= y1) return;
        const std::vector<Group> groups = GroupsOf(dy);
        std::vector<const float*> rows(static_cast<std::size_t>(m_slots));
        for (int below = y0 - radius; below < y1 + radius; ++below) {
            const int y = below - radius;
            for (const Group& group : groups) {
                SumRow(group, below, dy, Slot(group, below - y0 + radius));
                if (y < y0) continue;
                for (int k = 0; k < m_slots; ++k)
                    rows[static_cast<std::size_t>(k)] = Slot(group, y - y0 + k);
                WeighRow(group, y, dy, rows.data());
                if (y >= region.y0) AddToP(group, y, dy);
                if (m_both && y + dy < region.y1) AddToQ(group, y, dy);
            }
        }
    }

    float* Slot(const Group& group, int row) const
    {
        return group.ring + static_cast<std::ptrdiff_t>(row % m_slots) * m_row * group_size;
    }

    void SumRow(const Group& group, int y, int dy, float* out) const
    {
        const int radius = m_job.settings.patch_radius;
        const ConstImageView& guide = m_here.guide;
        const float* here = guide.ptr(0, group.x0 - radius, y);
        const float* there = m_there.guide.ptr(0, group.x0 - radius + group.first_dx, y + dy);
        const int n = group.vectors * m_lanes + 2 * radius;
        if (guide.channels() == 3)
            SquaredDifferences<3>(here, there, guide.channel_stride(), 3, group.count, n,
                                  m_differences, m_row);
        else
            SquaredDifferences<0>(here, there, guide.channel_stride(), guide.channels(),
                                  group.count, n, m_differences, m_row);
        const float* weights = m_patch.data();
        switch (radius) {
        case 1: return FilterRows<1>(m_differences, m_row, weights, 1, group, out);
        case 2: return FilterRows<2>(m_differences, m_row, weights, 2, group, out);
        case 3: return FilterRows<3>(m_differences, m_row, weights, 3, group, out);
        case 4: return FilterRows<4>(m_differences, m_row, weights, 4, group, out);
        case 5: return FilterRows<5>(m_differences, m_row, weights, 5, group, out);
        default: return FilterRows<-1>(m_differences, m_row, weights, radius, group, out);
        }
    }

    void WeighRow(const Group& group, int y, int dy, const float* const* rows) const
    {
        const NlmSettings& settings = m_job.settings;
        float spatial[group_size];
        for (int g = 0; g < group.count; ++g) {
            const int dx = group.first_dx + g;
            const float frames = static_cast<float>(m_there.distance);
            spatial[g] = nlm_log2_e * (static_cast<float>(dx * dx + dy * dy) + frames * frames) /
                         (2.0f * settings.sigma_s * settings.sigma_s);
        }
        if (settings.gate != NlmGate::none) {
            GateJob job{};
            job.p = SideAt(m_here, group.x0, y);
            job.q = SideAt(m_there, group.x0 + group.first_dx, y + dy);
            job.tested_stride = m_here.tested.channel_stride();
            job.low_stride = m_here.low.channel_stride();
            job.high_stride = m_here.high.channel_stride();
            job.spread_stride = m_here.spread.channel_stride();
            job.channels = m_here.tested.channels();
            job.into_p = m_into_p;
            job.into_q = m_into_q;
            job.stride = m_row;
            if (settings.gate == NlmGate::one_sample)
                job.channels == 3 ? GateOneSample<3>(group, job) : GateOneSample<0>(group, job);
            else
                job.channels == 3 ? GateTwoSample<3>(group, job) : GateTwoSample<0>(group, job);
        }
        WeightJob job{};
        job.inverse_p = m_here.inverse.ptr(0, group.x0, y);
        job.inverse_q = m_there.inverse.ptr(0, group.x0 + group.first_dx, y + dy);
        job.rows = rows;
        job.patch = m_patch.data();
        job.radius = settings.patch_radius;
        job.spatial = spatial;
        job.into_p = m_into_p;
        job.into_q = m_into_q;
        job.stride = m_row;
        switch (settings.gate) {
        case NlmGate::none: return WeighFor<NlmGate::none>(group, job);
        case NlmGate::one_sample: return WeighFor<NlmGate::one_sample>(group, job);
        case NlmGate::two_sample: return WeighFor<NlmGate::two_sample>(group, job);
        }
    }

    void AddToP(const Group& group, int y, int dy) const
    {
        const int x = m_job.region.x0;
        AddJob job{};
        job.weights = m_into_p + (x - group.x0);
        job.weight_step = m_row;
        job.value_step = 1;
        job.count = group.count;
        AddTo(job, y, m_there, x + group.first_dx, y + dy);
    }

    void AddToQ(const Group& group, int y, int dy) const
    {
        const int x = m_job.region.x0 - group.first_dx;
        AddJob job{};
        job.weights = m_into_q + (x - group.x0);
        job.weight_step = m_row - 1;
        job.value_step = -1;
        job.count = group.count;
        AddTo(job, y + dy, m_here, x, y);
    }

    /// Adds pixels of `from`, beginning at (x, y), to row `row` of the region.
    void AddTo(AddJob job, int row, const NlmFrame& from, int x, int y) const
    {
        const ImageView& sums = m_job.sums;
        const int channels = from.image.channels();
        job.width = m_job.region.width();
        job.sums = sums.ptr(0, m_job.region.x0, row);
        job.sums_stride = sums.channel_stride();
        job.values = from.image.ptr(0, x, y);
        job.value_stride = from.image.channel_stride();
        AddPlanes<true, false>(job, channels);
        if (from.variance.empty()) return;
        job.sums = sums.ptr(channels + 1, m_job.region.x0, row);
        job.values = from.variance.ptr(0, x, y);
        job.value_stride = from.variance.channel_stride();
        AddPlanes<false, true>(job, from.variance.channels());
    }

    const NlmJob& m_job;
    const NlmFrame& m_here;
    const NlmFrame& m_there;
    bool m_both;
    std::span<const float> m_patch;
    int m_lanes, m_slots = 1;
    std::ptrdiff_t m_row = 0; ///< floats from one offset's row to the next one's
    std::size_t m_ring = 0;
    float* m_differences = nullptr;
    float* m_into_p = nullptr;
    float* m_into_q = nullptr;
    float* m_rings = nullptr;
};

void Sums(const NlmJob& job)
{
    const NlmFrame& here = job.frames[0];
    const int channels = here.image.channels();
    // The pixel itself has weight 1. Adding to +0 makes −0 into +0: adding a weight of zero then
    // changes no bit.
    for (int y = job.region.y0; y < job.region.y1; ++y) {
        for (int c = 0; c < job.sums.channels(); ++c) {
            float* to = job.sums.row(c, y);
            std::fill_n(to, job.sums.region().width(), 0.0f);
            const float* from = c < channels ? here.image.ptr(c, job.region.x0, y)
                                : c > channels
                                    ? here.variance.ptr(c - channels - 1, job.region.x0, y)
                                    : nullptr;
            to += job.region.x0 - job.sums.region().x0;
            for (int i = 0; i < job.region.width(); ++i) to[i] += from ? from[i] : 1.0f;
        }
    }
    const int radius = job.settings.patch_radius;
    const std::vector<float> patch = nlm_patch_weights(radius);
    const std::span<const float> half = std::span(patch).subspan(static_cast<std::size_t>(radius));
    hwy::AlignedFreeUniquePtr<float[]> scratch;
    std::size_t scratch_size = 0;
    for (const NlmFrame& frame : job.frames) Pairs(job, frame, half, scratch, scratch_size).Run();
}

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace rayloom
{

HWY_EXPORT(Sums);
HWY_EXPORT(PowerOfTwoNegativeSpan);

namespace
{
/// Floats of the widest vector.
constexpr int max_lanes = 16;
/// Whole vectors of pixels left and right of a region, and one group's offsets beyond the window.
constexpr int nlm_padding_left = 24, nlm_padding_right = 40;
} // namespace

std::vector<float> nlm_patch_weights(int radius)
{
    const double sigma = (2 * radius + 1) / 3.0;
    std::vector<double> exact;
    double sum = 0.0;
    for (int k = -radius; k <= radius; ++k) {
        exact.push_back(std::exp(-k * k / (2.0 * sigma * sigma)));
        sum += exact.back();
    }
    std::vector<float> weights;
    for (const double w : exact) weights.push_back(static_cast<float>(w / sum));
    return weights;
}

Region nlm_plane_region(const Region& region, const NlmSettings& settings)
{
    const int reach = settings.window_radius + settings.patch_radius;
    return region.grown({reach + nlm_padding_left, reach + nlm_padding_right, reach, reach});
}

Region nlm_sums_region(const Region& region) { return region.grown({0, max_lanes, 0, 0}); }

std::size_t nlm_scratch_bytes(const Region& region, const NlmSettings& settings)
{
    const auto row = static_cast<std::size_t>(region.width() + settings.window_radius +
                                              2 * settings.patch_radius + 5 * max_lanes);
    const auto slots = static_cast<std::size_t>(2 * settings.patch_radius + 1);
    return (static_cast<std::size_t>(2 * settings.window_radius + 8) * slots + 24) * row *
           sizeof(float);
}

void nlm_sums(const NlmJob& job) { HWY_DYNAMIC_DISPATCH(Sums)(job); }

void nlm_power_of_two_negative(std::span<const float> x, std::span<float> result)
{
    HWY_DYNAMIC_DISPATCH(PowerOfTwoNegativeSpan)
    (x.data(), result.data(), std::min(x.size(), result.size()));
}

} // namespace rayloom
#endif
