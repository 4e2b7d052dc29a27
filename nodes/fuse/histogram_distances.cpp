// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/histogram_rows.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "nodes/fuse/histogram_distances.cpp"
#include <hwy/foreach_target.h>

#include "rayloom/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace rayloom::histogram_fusion
{
namespace HWY_NAMESPACE
{
namespace
{
using namespace simd::HWY_NAMESPACE;

/// Offsets that share the loads of one pixel; bounded by the registers there are.
constexpr int group_size = HWY_TARGET <= HWY_AVX3 ? 4 : 2;

/// χ² of one vector of pixels for `G` offsets. Two bins share a division:
/// n₁/s₁ + n₂/s₂ = (n₁s₂ + n₂s₁)/(s₁s₂), a bin left out counting as 0/1, so that pairs that hold no
/// evidence can be skipped without changing a bit.
template <int G, bool equal_counts>
HWY_INLINE void ChiGroup(const ChiJob& job, std::size_t first, int pairs, int x)
{
    const D d;
    const V one = hn::Set(d, 1.0f);
    V sum[G], bins[G], a[G], b[G];
    const float* there[G];
    M valid[G];
    const V root = hn::Load(d, job.here.root + x);
    for (int g = 0; g < G; ++g) {
        const int dx = job.offsets[first + static_cast<std::size_t>(g)].dx;
        there[g] = job.there.bins + x + dx;
        const V other = hn::LoadU(d, job.there.root + x + dx);
        valid[g] = hn::And(hn::Gt(root, hn::Zero(d)), hn::Gt(other, hn::Zero(d)));
        if constexpr (!equal_counts) {
            a[g] = hn::Div(other, root);
            b[g] = hn::Div(root, other);
        }
        sum[g] = hn::Zero(d);
        bins[g] = hn::Zero(d);
    }
    const float* here = job.here.bins + x;
    for (int i = 0; i < pairs; ++i) {
        const std::ptrdiff_t at1 = job.list[i] * 2 * job.stride, at2 = at1 + job.stride;
        const V x1 = hn::Load(d, here + at1), x2 = hn::Load(d, here + at2);
        for (int g = 0; g < G; ++g) {
            const V y1 = hn::LoadU(d, there[g] + at1), y2 = hn::LoadU(d, there[g] + at2);
            const V sum1 = hn::Add(x1, y1), sum2 = hn::Add(x2, y2);
            V t1, t2;
            if constexpr (equal_counts) {
                t1 = hn::Sub(x1, y1);
                t2 = hn::Sub(x2, y2);
            } else {
                t1 = hn::Sub(hn::Mul(a[g], x1), hn::Mul(b[g], y1));
                t2 = hn::Sub(hn::Mul(a[g], x2), hn::Mul(b[g], y2));
            }
            const M used1 = hn::Gt(sum1, one), used2 = hn::Gt(sum2, one);
            const V n1 = hn::IfThenElseZero(used1, hn::Mul(t1, t1));
            const V n2 = hn::IfThenElseZero(used2, hn::Mul(t2, t2));
            const V s1 = hn::IfThenElse(used1, sum1, one), s2 = hn::IfThenElse(used2, sum2, one);
            const V numerator = hn::Add(hn::Mul(n1, s2), hn::Mul(n2, s1));
            sum[g] = hn::Add(sum[g], hn::Div(numerator, hn::Mul(s1, s2)));
            bins[g] = Counted(Counted(bins[g], used1), used2);
        }
    }
    for (int g = 0; g < G; ++g) {
        const std::ptrdiff_t at =
            static_cast<std::ptrdiff_t>(first + static_cast<std::size_t>(g)) * job.result_stride +
            x;
        hn::Store(hn::IfThenElseZero(valid[g], sum[g]), d, job.chi + at);
        hn::Store(hn::IfThenElseZero(valid[g], bins[g]), d, job.bins + at);
    }
}

template <bool equal_counts>
HWY_INLINE void ChiBlock(const ChiJob& job, int pairs, int block)
{
    const int lanes = LaneCount();
    const std::size_t n = job.offsets.size();
    for (int x = block * block_size; x < (block + 1) * block_size; x += lanes) {
        std::size_t i = 0;
        for (; i + group_size <= n; i += group_size)
            ChiGroup<group_size, equal_counts>(job, i, pairs, x);
        if constexpr (group_size == 4) {
            const std::size_t rest = n - i;
            if (rest == 3) ChiGroup<3, equal_counts>(job, i, pairs, x);
            if (rest == 2) ChiGroup<2, equal_counts>(job, i, pairs, x);
            if (rest == 1) ChiGroup<1, equal_counts>(job, i, pairs, x);
        } else {
            for (; i < n; ++i) ChiGroup<1, equal_counts>(job, i, pairs, x);
        }
    }
}

void ChiRow(const ChiJob& job)
{
    const bool equal_counts = job.here.count > 0.0f && job.here.count == job.there.count;
    for (int block = job.first_block; block < job.last_block; ++block) {
        int pairs = 0;
        for (int word = 0; word < job.words; ++word) {
            std::uint64_t used = job.here.used[block * job.words + word];
            for (int k = block - job.reach_blocks; k <= block + job.reach_blocks; ++k)
                used |= job.there.used[k * job.words + word];
            for (; used != 0; used &= used - 1)
                job.list[pairs++] = static_cast<std::uint16_t>(word * 64 + __builtin_ctzll(used));
        }
        if (equal_counts) {
            ChiBlock<true>(job, pairs, block);
        } else {
            ChiBlock<false>(job, pairs, block);
        }
    }
}

void MarkUsed(const float* bins, std::ptrdiff_t stride, int pairs, int blocks, int words,
              std::uint64_t* used)
{
    const D d;
    const V half = hn::Set(d, 0.5f);
    const int lanes = LaneCount();
    for (int i = 0; i < blocks * words; ++i) used[i] = 0;
    for (int pair = 0; pair < pairs; ++pair) {
        const float* row1 = bins + 2 * pair * stride;
        const float* row2 = row1 + stride;
        for (int block = 0; block < blocks; ++block) {
            M any = hn::Gt(hn::Zero(d), half);
            for (int x = block * block_size; x < (block + 1) * block_size; x += lanes)
                any = hn::Or(any, hn::Or(hn::Gt(hn::Load(d, row1 + x), half),
                                         hn::Gt(hn::Load(d, row2 + x), half)));
            if (!hn::AllFalse(d, any))
                used[block * words + pair / 64] |= std::uint64_t{1} << (pair % 64);
        }
    }
}

void PoolRow(const PoolJob& job)
{
    const D d;
    const int lanes = LaneCount();
    const std::size_t rows = job.chi.size();
    for (int x = 0; x < job.width; x += lanes) {
        V chi = hn::Load(d, job.chi[0] + x), bins = hn::Load(d, job.bins[0] + x);
        for (std::size_t row = 1; row < rows; ++row) {
            chi = hn::Add(chi, hn::Load(d, job.chi[row] + x));
            bins = hn::Add(bins, hn::Load(d, job.bins[row] + x));
        }
        hn::Store(chi, d, job.chi_column + x);
        hn::Store(bins, d, job.bins_column + x);
    }
    for (int x = 0; x < job.width; x += lanes) {
        V chi = hn::LoadU(d, job.chi_column + x - job.radius);
        V bins = hn::LoadU(d, job.bins_column + x - job.radius);
        for (int t = 1 - job.radius; t <= job.radius; ++t) {
            chi = hn::Add(chi, hn::LoadU(d, job.chi_column + x + t));
            bins = hn::Add(bins, hn::LoadU(d, job.bins_column + x + t));
        }
        hn::Store(
            hn::IfThenElse(hn::Gt(bins, hn::Zero(d)), hn::Div(chi, bins), hn::Set(d, infinity)), d,
            job.distance + x);
    }
}

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom::histogram_fusion
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace rayloom::histogram_fusion
{

HWY_EXPORT(ChiRow);
HWY_EXPORT(MarkUsed);
HWY_EXPORT(PoolRow);

void chi_row(const ChiJob& job) { HWY_DYNAMIC_DISPATCH(ChiRow)(job); }

void mark_used(const float* bins, std::ptrdiff_t stride, int pairs, int blocks, int words,
               std::uint64_t* used)
{
    HWY_DYNAMIC_DISPATCH(MarkUsed)(bins, stride, pairs, blocks, words, used);
}

void pool_row(const PoolJob& job) { HWY_DYNAMIC_DISPATCH(PoolRow)(job); }

} // namespace rayloom::histogram_fusion
#endif
