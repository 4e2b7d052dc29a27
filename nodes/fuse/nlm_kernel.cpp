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

#include "nodes/fuse/nlm_distances-inl.h"
#include "nodes/fuse/nlm_weights-inl.h"

HWY_BEFORE_NAMESPACE();
namespace rayloom
{
namespace HWY_NAMESPACE
{
namespace
{
using namespace simd::HWY_NAMESPACE;

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
        hn::Store(Exp2Minus<5>(v, far), d, out);
        std::copy_n(out, m, result + i);
    }
}

/// Neighbouring offsets of one row of the window, and the pixels p whose pairs (p, p + offset) are
/// looked at: whole vectors from x0 on.
struct Group {
    int first_dx = 0, count = 0;
    int x0 = 0, vectors = 0;
    float* ring = nullptr;      ///< [row of patches][vector][offset][lane], summed along rows
    float* distances = nullptr; ///< [nlm_column_rows][vector][offset][lane]
};

int RoundedUp(int value, int to) { return (value + to - 1) / to * to; }

const float* At(const ConstImageView& view, int x, int y)
{
    return view.empty() ? nullptr : view.ptr(0, x, y);
}

WeightJob::Side SideAt(const NlmFrame& frame, int x, int y)
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
        m_slots = 2 * radius + nlm_column_rows;
        m_row = RoundedUp(job.region.width() + (m_both ? reach + nlm_group_size : 0) + 2 * radius,
                          m_lanes) +
                3 * m_lanes;
        m_slot = m_row * nlm_group_size;
        const std::size_t row = static_cast<std::size_t>(m_slot);
        m_ring = row * static_cast<std::size_t>(m_slots + nlm_column_rows);
        const std::size_t groups =
            static_cast<std::size_t>((2 * reach + nlm_group_size) / nlm_group_size);
        const std::size_t size = groups * m_ring + 3 * row;
        if (size > scratch_size) {
            scratch = hwy::AllocateAligned<float>(size);
            std::fill_n(scratch.get(), size, 0.0f);
            scratch_size = size;
        }
        m_differences = scratch.get();
        m_into_q = m_differences + row;
        m_into_p = m_into_q + row;
        m_rings = m_into_p + row;
        if (job.settings.gate != NlmGate::one_sample) m_into_p = m_into_q;
        m_add_at_once = other.image.channels() == 3 && other.variance.empty();
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
        for (int dx = m_both && dy == 0 ? 1 : -reach; dx <= reach; dx += nlm_group_size) {
            Group group;
            group.first_dx = dx;
            group.count = std::min(nlm_group_size, reach - dx + 1);
            const int last_dx = dx + group.count - 1;
            const int before = m_both ? RoundedUp(std::max(0, last_dx), m_lanes) : 0;
            const int after = m_both ? std::max(0, -dx) : 0;
            group.x0 = m_job.region.x0 - before;
            group.vectors = (before + m_job.region.width() + after + m_lanes - 1) / m_lanes;
            group.ring = m_rings + groups.size() * m_ring;
            group.distances = group.ring + m_slots * m_slot;
            groups.push_back(group);
        }
        return groups;
    }

    void RunRow(int dy)
    {
        const Region& region = m_job.region;
        const Region& window = m_job.window;
        const int y0 =
            std::max(m_both ? region.y0 - dy : region.y0, std::max(window.y0, window.y0 - dy));
        const int y1 = std::min(region.y1, std::min(window.y1, window.y1 - dy));
        if (y0 >= y1) return;
        const std::vector<Group> groups = GroupsOf(dy);
        for (int y = y0; y < y1; ++y) {
            const int row = (y - y0) % nlm_column_rows;
            for (const Group& group : groups) {
                if (row == 0) FindDistances(group, y0, y, y1, dy);
                WeighRow(group, group.distances + row * m_slot, y, dy);
                if (y >= region.y0 && !m_add_at_once) AddToP(group, y, dy);
                if (m_both && y + dy < region.y1) AddToQ(group, y, dy);
            }
        }
    }

    /// Distances of nlm_column_rows rows from y on, or fewer before y1. Rows are asked for from y0
    /// on.
    void FindDistances(const Group& group, int y0, int y, int y1, int dy)
    {
        const int radius = m_job.settings.patch_radius;
        const auto slot = [&](int of) {
            return group.ring + (of - (y0 - radius)) % m_slots * m_slot;
        };
        const int below = std::min(y + nlm_column_rows, y1) + radius;
        for (int v = y == y0 ? y0 - radius : y + radius; v < below; ++v)
            SumRow(group, v, dy, slot(v));
        m_rows.clear();
        for (int k = 0; k < m_slots; ++k) m_rows.push_back(slot(y - radius + k));
        float* out[nlm_column_rows];
        for (int i = 0; i < nlm_column_rows; ++i) out[i] = group.distances + i * m_slot;
        WithFixedRadius(radius, [&]<int fixed>() {
            FilterColumns<fixed>(m_rows.data(), m_patch.data(), radius,
                                 static_cast<std::ptrdiff_t>(group.vectors) * group.count * m_lanes,
                                 out);
        });
    }

    void SumRow(const Group& group, int y, int dy, float* out) const
    {
        const int radius = m_job.settings.patch_radius;
        const ConstImageView& guide = m_here.guide;
        const float* here = guide.ptr(0, group.x0 - radius, y);
        const float* there = m_there.guide.ptr(0, group.x0 - radius + group.first_dx, y + dy);
        const int n = group.vectors * m_lanes + 2 * radius;
        SquaredDifferences(here, there, guide.channel_stride(), guide.channels(), group.count, n,
                           m_differences, m_row);
        WithFixedRadius(radius, [&]<int fixed>() {
            FilterRows<fixed>(m_differences, m_row, m_patch.data(), radius, group.vectors,
                              group.count, out);
        });
    }

    void WeighRow(const Group& group, const float* distances, int y, int dy) const
    {
        const NlmSettings& settings = m_job.settings;
        float spatial[nlm_group_size];
        for (int g = 0; g < group.count; ++g) {
            const int dx = group.first_dx + g;
            const float frames = static_cast<float>(m_there.distance);
            spatial[g] = nlm_log2_e * (static_cast<float>(dx * dx + dy * dy) + frames * frames) /
                         (2.0f * settings.sigma_s * settings.sigma_s);
        }
        WeightJob job{};
        job.vectors = group.vectors;
        job.count = group.count;
        job.inverse_p = m_here.inverse.ptr(0, group.x0, y);
        job.inverse_q = m_there.inverse.ptr(0, group.x0 + group.first_dx, y + dy);
        job.distances = distances;
        job.spatial = spatial;
        job.p = SideAt(m_here, group.x0, y);
        job.q = SideAt(m_there, group.x0 + group.first_dx, y + dy);
        job.gate_channels = m_here.tested.channels();
        job.stride = m_here.image.channel_stride();
        job.into_p = m_into_p;
        job.into_q = m_into_q;
        job.weight_stride = m_row;
        if (m_add_at_once) {
            const Region& region = m_job.region;
            const ImageView& sums = m_job.sums;
            job.values = m_there.image.ptr(0, group.x0 + group.first_dx, y + dy);
            job.sums_stride = sums.channel_stride();
            if (y >= region.y0) {
                const int before = region.x0 - group.x0;
                job.sums = sums.ptr(0, region.x0, y) - before;
                job.first = before / m_lanes;
                job.last = job.first + RoundedUp(region.width(), m_lanes) / m_lanes;
            }
        }
        switch (settings.gate) {
        case NlmGate::none: return WeighFor<NlmGate::none>(job);
        case NlmGate::one_sample: return WeighFor<NlmGate::one_sample>(job);
        case NlmGate::two_sample: return WeighFor<NlmGate::two_sample>(job);
        }
    }

    template <NlmGate gate>
    void WeighFor(const WeightJob& job) const
    {
        constexpr int three = gate == NlmGate::none ? 0 : 3;
        const bool known = job.gate_channels == 3;
        if (!m_add_at_once)
            known ? Weigh<gate, three, Into::memory>(job) : Weigh<gate, 0, Into::memory>(job);
        else if (gate != NlmGate::none && known && job.values == job.q.tested)
            Weigh<gate, three, gate == NlmGate::none ? Into::sums : Into::own>(job);
        else
            known ? Weigh<gate, three, Into::sums>(job) : Weigh<gate, 0, Into::sums>(job);
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
    bool m_add_at_once = false; ///< weights go into the sums of p as soon as they are known
    std::span<const float> m_patch;
    int m_lanes, m_slots = 1;
    std::ptrdiff_t m_row = 0; ///< floats from one offset's row to the next one's
    std::ptrdiff_t m_slot = 0;
    std::size_t m_ring = 0; ///< floats of a group's ring and distances
    std::vector<const float*> m_rows;
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
    const auto slots = static_cast<std::size_t>(2 * settings.patch_radius + 2 * nlm_column_rows);
    return (static_cast<std::size_t>(2 * settings.window_radius + nlm_group_size) * slots + 24) *
           row * sizeof(float);
}

void nlm_sums(const NlmJob& job) { HWY_DYNAMIC_DISPATCH(Sums)(job); }

void nlm_power_of_two_negative(std::span<const float> x, std::span<float> result)
{
    HWY_DYNAMIC_DISPATCH(PowerOfTwoNegativeSpan)
    (x.data(), result.data(), std::min(x.size(), result.size()));
}

} // namespace rayloom
#endif
