// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/nlm_kernel.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "nodes/fuse/nlm_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace rayloom
{
namespace HWY_NAMESPACE
{
namespace
{
namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;

/// Weights are zero from this exponent on.
constexpr float far_exponent = 80.0f;

/// exp(−x) for 0 ≤ x < far_exponent; finite or not, but harmless, elsewhere.
HWY_INLINE V ExpNegative(V x)
{
    const D d;
    const hn::RebindToSigned<D> di;
    const V minus = hn::Neg(hn::Min(x, hn::Set(d, far_exponent)));
    const auto n = hn::NearestInt(hn::Mul(minus, hn::Set(d, 1.44269504f)));
    const V whole = hn::ConvertTo(d, n);
    // ln 2 in two parts: the first has few bits, so that its product with n is exact.
    V r = hn::Sub(minus, hn::Mul(whole, hn::Set(d, 0.693359375f)));
    r = hn::Sub(r, hn::Mul(whole, hn::Set(d, -2.12194440e-4f)));
    V p = hn::Set(d, 1.0f / 720.0f);
    p = hn::Add(hn::Mul(p, r), hn::Set(d, 1.0f / 120.0f));
    p = hn::Add(hn::Mul(p, r), hn::Set(d, 1.0f / 24.0f));
    p = hn::Add(hn::Mul(p, r), hn::Set(d, 1.0f / 6.0f));
    p = hn::Add(hn::Mul(p, r), hn::Set(d, 0.5f));
    p = hn::Add(hn::Mul(p, r), hn::Set(d, 1.0f));
    p = hn::Add(hn::Mul(p, r), hn::Set(d, 1.0f));
    const auto exponent = hn::ShiftLeft<23>(hn::Add(n, hn::Set(di, 127)));
    return hn::Mul(p, hn::BitCast(d, exponent));
}

void ExpNegativeSpan(const float* x, float* result, std::size_t n)
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
        hn::Store(hn::IfThenElseZero(hn::Lt(v, hn::Set(d, far_exponent)), ExpNegative(v)), d, out);
        std::copy_n(out, m, result + i);
    }
}

/// Σ over channels of (a − b)², `n` pixels.
template <int fixed_channels>
HWY_INLINE void SquaredDifferences(const float* HWY_RESTRICT a, const float* HWY_RESTRICT b,
                                   std::ptrdiff_t stride, int channels, float* HWY_RESTRICT out,
                                   int n)
{
    const D d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const int count = fixed_channels > 0 ? fixed_channels : channels;
    for (int x = 0; x < n; x += lanes) {
        const V first = hn::Sub(hn::LoadU(d, a + x), hn::LoadU(d, b + x));
        V sum = hn::Mul(first, first);
        for (int c = 1; c < count; ++c) {
            const std::ptrdiff_t at = c * stride + x;
            const V e = hn::Sub(hn::LoadU(d, a + at), hn::LoadU(d, b + at));
            sum = hn::Add(sum, hn::Mul(e, e));
        }
        hn::StoreU(sum, d, out + x);
    }
}

/// Weighted sum over a patch row; `in` begins `radius` pixels before `out`.
HWY_INLINE void FilterRow(const float* HWY_RESTRICT in, const float* weights, int radius,
                          float* HWY_RESTRICT out, int n)
{
    const D d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const float* centre = in + radius;
    for (int x = 0; x < n; x += lanes) {
        V sum = hn::Mul(hn::LoadU(d, centre + x), hn::Set(d, weights[0]));
        for (int k = 1; k <= radius; ++k)
            sum = hn::Add(
                sum, hn::Mul(hn::Add(hn::LoadU(d, centre + x - k), hn::LoadU(d, centre + x + k)),
                             hn::Set(d, weights[k])));
        hn::StoreU(sum, d, out + x);
    }
}

/// Planes of the two pixels of a pair, at the first pair of a row.
struct Side {
    const float* range;
    const float* image;
    const float* tested;
    const float* low;
    const float* high;
    const float* spread;
    const float* variance;
    float* sums; ///< null when this side is not wanted
};

struct RowPairs {
    Side p, q;
    const float* const* distance; ///< [2·radius + 1] rows of horizontally summed distances
    const float* weights;         ///< [radius + 1]
    int radius;
    float spatial; ///< |q − p|² / (2 σ_s²)
    int n;
    int channels, tested_channels, variance_channels;
    std::ptrdiff_t image_stride, tested_stride, low_stride, high_stride, spread_stride,
        variance_stride, sums_stride;
};

template <int fixed_channels>
HWY_INLINE void AddPairs(const RowPairs& job, float* HWY_RESTRICT sums, const float* image,
                         const float* variance, int x, V weight)
{
    const D d;
    const int channels = fixed_channels > 0 ? fixed_channels : job.channels;
    for (int c = 0; c < channels; ++c) {
        float* to = sums + c * job.sums_stride + x;
        const V value = hn::LoadU(d, image + c * job.image_stride + x);
        hn::StoreU(hn::Add(hn::LoadU(d, to), hn::Mul(weight, value)), d, to);
    }
    float* total = sums + channels * job.sums_stride + x;
    hn::StoreU(hn::Add(hn::LoadU(d, total), weight), d, total);
    if (job.variance_channels > 0) {
        const V squared = hn::Mul(weight, weight);
        for (int c = 0; c < job.variance_channels; ++c) {
            float* to = sums + (channels + 1 + c) * job.sums_stride + x;
            const V value = hn::LoadU(d, variance + c * job.variance_stride + x);
            hn::StoreU(hn::Add(hn::LoadU(d, to), hn::Mul(squared, value)), d, to);
        }
    }
}

/// Weighs and adds the pairs of one row for one offset.
template <NlmGate gate, int fixed_channels>
HWY_INLINE void WeighPairs(const RowPairs& job)
{
    const D d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const V spatial = hn::Set(d, job.spatial);
    for (int x = 0; x < job.n; x += lanes) {
        const V range = hn::Min(hn::LoadU(d, job.p.range + x), hn::LoadU(d, job.q.range + x));
        M near = hn::Gt(range, hn::Zero(d));
        M into_p = near, into_q = near;
        if constexpr (gate == NlmGate::two_sample) {
            for (int c = 0; c < job.tested_channels; ++c) {
                const std::ptrdiff_t at = c * job.tested_stride + x;
                const V e =
                    hn::Sub(hn::LoadU(d, job.p.tested + at), hn::LoadU(d, job.q.tested + at));
                const std::ptrdiff_t spread = c * job.spread_stride + x;
                const V most = hn::Add(hn::LoadU(d, job.p.spread + spread),
                                       hn::LoadU(d, job.q.spread + spread));
                near = hn::And(near, hn::Le(hn::Mul(e, e), most));
            }
            if (hn::AllFalse(d, near)) continue;
        }
        if constexpr (gate == NlmGate::one_sample) {
            for (int c = 0; c < job.tested_channels; ++c) {
                const V x_p = hn::LoadU(d, job.p.tested + c * job.tested_stride + x);
                const V x_q = hn::LoadU(d, job.q.tested + c * job.tested_stride + x);
                const std::ptrdiff_t low = c * job.low_stride + x, high = c * job.high_stride + x;
                into_p = hn::And(into_p, hn::And(hn::Ge(x_q, hn::LoadU(d, job.p.low + low)),
                                                 hn::Le(x_q, hn::LoadU(d, job.p.high + high))));
                into_q = hn::And(into_q, hn::And(hn::Ge(x_p, hn::LoadU(d, job.q.low + low)),
                                                 hn::Le(x_p, hn::LoadU(d, job.q.high + high))));
            }
            if (hn::AllFalse(d, hn::Or(into_p, into_q))) continue;
        }
        V distance =
            hn::Mul(hn::LoadU(d, job.distance[job.radius] + x), hn::Set(d, job.weights[0]));
        for (int k = 1; k <= job.radius; ++k)
            distance =
                hn::Add(distance, hn::Mul(hn::Add(hn::LoadU(d, job.distance[job.radius - k] + x),
                                                  hn::LoadU(d, job.distance[job.radius + k] + x)),
                                          hn::Set(d, job.weights[k])));
        const V exponent = hn::Add(hn::Div(distance, range), spatial);
        near = hn::And(near, hn::Lt(exponent, hn::Set(d, far_exponent)));
        if (hn::AllFalse(d, near)) continue;
        const V weight = hn::IfThenElseZero(near, ExpNegative(exponent));
        const bool one_sided = gate == NlmGate::one_sample;
        if (job.p.sums)
            AddPairs<fixed_channels>(job, job.p.sums, job.q.image, job.q.variance, x,
                                     one_sided ? hn::IfThenElseZero(into_p, weight) : weight);
        if (job.q.sums)
            AddPairs<fixed_channels>(job, job.q.sums, job.p.image, job.p.variance, x,
                                     one_sided ? hn::IfThenElseZero(into_q, weight) : weight);
    }
}

template <int fixed_channels>
HWY_INLINE void WeighPairsOf(NlmGate gate, const RowPairs& job)
{
    switch (gate) {
    case NlmGate::none: return WeighPairs<NlmGate::none, fixed_channels>(job);
    case NlmGate::one_sample: return WeighPairs<NlmGate::one_sample, fixed_channels>(job);
    case NlmGate::two_sample: return WeighPairs<NlmGate::two_sample, fixed_channels>(job);
    }
}

const float* At(const ConstImageView& view, int x, int y)
{
    return view.empty() ? nullptr : view.ptr(0, x, y);
}

Side SideAt(const NlmFrame& frame, const ImageView* sums, int x, int y)
{
    return {At(frame.range, x, y),    At(frame.image, x, y),
            At(frame.tested, x, y),   At(frame.low, x, y),
            At(frame.high, x, y),     At(frame.spread, x, y),
            At(frame.variance, x, y), sums ? sums->ptr(0, x, y) : nullptr};
}

/// All pairs of the current frame with rows `dy` below in `other`. Within the current frame each
/// pair serves both its pixels.
class Offsets
{
public:
    Offsets(const NlmJob& job, const NlmFrame& other, std::span<const float> weights,
            std::vector<float>& scratch)
        : m_job(job), m_here(job.frames[0]), m_there(other), m_both(&other == &job.frames[0]),
          m_weights(weights), m_scratch(scratch)
    {
    }

    void Run()
    {
        const int reach = m_job.settings.window_radius;
        for (int dy = m_both ? 0 : -reach; dy <= reach; ++dy) RunRow(dy);
    }

private:
    void RunRow(int dy)
    {
        const Region& region = m_job.region;
        const Region& window = m_job.window;
        const int reach = m_job.settings.window_radius, radius = m_job.settings.patch_radius;
        const int first_dx = m_both && dy == 0 ? 1 : -reach, last_dx = reach;
        const int y0 =
            std::max(m_both ? region.y0 - dy : region.y0, std::max(window.y0, window.y0 - dy));
        const int y1 = std::min(region.y1, std::min(window.y1, window.y1 - dy));
        if (y0 >= y1) return;
        const int slots = 2 * radius + 1;
        const std::size_t slot = static_cast<std::size_t>(region.width() + reach + 2 * nlm_padding);
        const std::size_t ring = slot * static_cast<std::size_t>(slots);
        const std::size_t offsets = static_cast<std::size_t>(last_dx - first_dx + 1);
        m_scratch.resize(offsets * ring + slot + static_cast<std::size_t>(2 * radius));
        float* differences = m_scratch.data() + offsets * ring;
        std::vector<const float*> rows(static_cast<std::size_t>(slots));

        RowPairs pairs{};
        pairs.weights = m_weights.data();
        pairs.radius = radius;
        pairs.channels = m_here.image.channels();
        pairs.tested_channels = m_here.tested.channels();
        pairs.variance_channels = m_here.variance.channels();
        pairs.image_stride = m_here.image.channel_stride();
        pairs.tested_stride = m_here.tested.channel_stride();
        pairs.low_stride = m_here.low.channel_stride();
        pairs.high_stride = m_here.high.channel_stride();
        pairs.spread_stride = m_here.spread.channel_stride();
        pairs.variance_stride = m_here.variance.channel_stride();
        pairs.sums_stride = m_job.sums.channel_stride();

        for (int below = y0 - radius; below < y1 + radius; ++below) {
            const int y = below - radius;
            for (int dx = first_dx; dx <= last_dx; ++dx) {
                const int x0 = std::max(m_both ? region.x0 - std::max(dx, 0) : region.x0,
                                        std::max(window.x0, window.x0 - dx));
                const int x1 = std::min(m_both ? region.x1 + std::max(-dx, 0) : region.x1,
                                        std::min(window.x1, window.x1 - dx));
                if (x0 >= x1) continue;
                float* own_ring = m_scratch.data() + static_cast<std::size_t>(dx - first_dx) * ring;
                const auto slot_of = [&](int row) HWY_ATTR {
                    return own_ring + slot * static_cast<std::size_t>((row - y0 + radius) % slots);
                };
                const float* a = m_here.guide.ptr(0, x0 - radius, below);
                const float* b = m_there.guide.ptr(0, x0 - radius + dx, below + dy);
                const int n = x1 - x0;
                if (m_here.guide.channels() == 3)
                    SquaredDifferences<3>(a, b, m_here.guide.channel_stride(), 3, differences,
                                          n + 2 * radius);
                else
                    SquaredDifferences<0>(a, b, m_here.guide.channel_stride(),
                                          m_here.guide.channels(), differences, n + 2 * radius);
                FilterRow(differences, m_weights.data(), radius, slot_of(below), n);
                if (y < y0) continue;

                for (int k = -radius; k <= radius; ++k)
                    rows[static_cast<std::size_t>(k + radius)] = slot_of(y + k);
                pairs.distance = rows.data();
                const float frames = static_cast<float>(m_there.distance);
                pairs.spatial = (static_cast<float>(dx * dx + dy * dy) + frames * frames) /
                                (2.0f * m_job.settings.sigma_s * m_job.settings.sigma_s);
                pairs.n = n;
                const bool into_p = y >= region.y0;
                const bool into_q = m_both && y + dy < region.y1;
                pairs.p = SideAt(m_here, into_p ? &m_job.sums : nullptr, x0, y);
                pairs.q = SideAt(m_there, into_q ? &m_job.sums : nullptr, x0 + dx, y + dy);
                if (into_p && into_q && dy == 0) {
                    // Both sides are in one row: a pixel has its turn as p before it has it as q,
                    // wherever the vectors begin.
                    float* const q_sums = pairs.q.sums;
                    pairs.q.sums = nullptr;
                    Weigh(pairs);
                    pairs.q.sums = q_sums;
                    pairs.p.sums = nullptr;
                }
                Weigh(pairs);
            }
        }
    }

    void Weigh(const RowPairs& pairs) const
    {
        if (pairs.channels == 3)
            WeighPairsOf<3>(m_job.settings.gate, pairs);
        else
            WeighPairsOf<0>(m_job.settings.gate, pairs);
    }

    const NlmJob& m_job;
    const NlmFrame& m_here;
    const NlmFrame& m_there;
    bool m_both;
    std::span<const float> m_weights;
    std::vector<float>& m_scratch;
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
    const std::span<const float> weights =
        std::span(patch).subspan(static_cast<std::size_t>(radius));
    std::vector<float> scratch;
    for (const NlmFrame& frame : job.frames) Offsets(job, frame, weights, scratch).Run();
}

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace rayloom
{

HWY_EXPORT(Sums);
HWY_EXPORT(ExpNegativeSpan);

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
    return region.grown({reach, reach + nlm_padding, reach, reach});
}

Region nlm_sums_region(const Region& region, const NlmSettings& settings)
{
    const int reach = settings.window_radius;
    return region.grown({reach, reach + nlm_padding, 0, 0});
}

void nlm_sums(const NlmJob& job) { HWY_DYNAMIC_DISPATCH(Sums)(job); }

void nlm_exp_negative(std::span<const float> x, std::span<float> result)
{
    HWY_DYNAMIC_DISPATCH(ExpNegativeSpan)
    (x.data(), result.data(), std::min(x.size(), result.size()));
}

} // namespace rayloom
#endif
