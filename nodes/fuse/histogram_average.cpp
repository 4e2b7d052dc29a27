// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/histogram_rows.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "nodes/fuse/histogram_average.cpp"
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

void SelectRow(const SelectJob& job)
{
    const D d;
    const int lanes = LaneCount();
    const V one = hn::Set(d, 1.0f), none = hn::Set(d, -1.0f), kappa = hn::Set(d, job.kappa);
    const V wanted = hn::Set(d, static_cast<float>(job.min_patches));
    const auto nearest = static_cast<std::size_t>(job.min_patches);
    for (int x = job.begin; x < job.end; x += lanes) {
        V found = hn::Zero(d);
        for (const float* distance : job.distance)
            found = Counted(found, hn::Lt(hn::LoadU(d, distance + x), kappa));
        V threshold = kappa, last_tie = none;
        const M few =
            hn::And(hn::Lt(found, wanted), hn::FirstN(d, static_cast<std::size_t>(job.end - x)));
        if (!hn::AllFalse(d, few)) {
            // The nearest candidates by insertion; in raster order, so the first of equals stays.
            float* const best = job.nearest.data();
            float* const best_index = best + nearest * hn::Lanes(d);
            for (std::size_t k = 0; k < nearest; ++k) {
                hn::StoreU(hn::Set(d, infinity), d, best + k * hn::Lanes(d));
                hn::StoreU(none, d, best_index + k * hn::Lanes(d));
            }
            for (std::size_t i = 0; i < job.distance.size(); ++i) {
                V value = hn::LoadU(d, job.distance[i] + x);
                V index = hn::Set(d, static_cast<float>(i));
                for (std::size_t k = 0; k < nearest; ++k) {
                    float* const slot = best + k * hn::Lanes(d);
                    float* const slot_index = best_index + k * hn::Lanes(d);
                    const V old = hn::LoadU(d, slot), old_index = hn::LoadU(d, slot_index);
                    const M nearer = hn::Lt(value, old);
                    hn::StoreU(hn::IfThenElse(nearer, value, old), d, slot);
                    hn::StoreU(hn::IfThenElse(nearer, index, old_index), d, slot_index);
                    value = hn::IfThenElse(nearer, old, value);
                    index = hn::IfThenElse(nearer, old_index, index);
                }
            }
            V kept = hn::Zero(d);
            for (std::size_t k = 0; k < nearest; ++k)
                kept = Counted(kept,
                               hn::Lt(hn::LoadU(d, best + k * hn::Lanes(d)), hn::Set(d, infinity)));
            const std::size_t last = (nearest - 1) * hn::Lanes(d);
            found = hn::IfThenElse(few, kept, found);
            threshold = hn::IfThenElse(few, hn::LoadU(d, best + last), threshold);
            last_tie = hn::IfThenElse(few, hn::LoadU(d, best_index + last), last_tie);
        }
        hn::StoreU(threshold, d, job.threshold + x);
        hn::StoreU(last_tie, d, job.last_tie + x);
        hn::StoreU(hn::Add(found, one), d, job.count + x);
    }
}

bool ShareRow(const ShareJob& job)
{
    const D d;
    const int lanes = LaneCount();
    const V index = hn::Set(d, job.index);
    M any = hn::Gt(hn::Zero(d), hn::Zero(d));
    for (int x = job.begin; x < job.end; x += lanes) {
        M accepted = hn::Eq(index, index);
        if (job.distance) {
            const V distance = hn::LoadU(d, job.distance + x);
            const V threshold = hn::LoadU(d, job.threshold + x);
            accepted = hn::Or(hn::Lt(distance, threshold),
                              hn::And(hn::Eq(distance, threshold),
                                      hn::Le(index, hn::LoadU(d, job.last_tie + x))));
        }
        for (int m = 0; m < job.classes; ++m) {
            const auto k = static_cast<std::size_t>(m);
            const V weight = hn::IfThenElseZero(accepted, hn::LoadU(d, job.weight[k] + x));
            any = hn::Or(any, hn::Gt(weight, hn::Zero(d)));
            hn::StoreU(weight, d, job.accepted[k] + x);
        }
    }
    if (hn::AllFalse(d, any)) return false;
    for (int v = 0; v < job.classes; ++v) {
        float* const share = job.share[static_cast<std::size_t>(v)];
        for (int z = job.out_begin; z < job.out_end; z += lanes) {
            V sum = hn::Zero(d);
            for (int t = -job.radius; t <= job.radius; ++t) {
                const int across = t < 0 ? -t : t;
                const int m = job.classes == 1 ? 0 : (across > v ? across : v);
                sum = hn::Add(sum, hn::LoadU(d, job.accepted[static_cast<std::size_t>(m)] + z - t));
            }
            hn::Store(sum, d, share + z);
        }
    }
    return true;
}

/// Sums of one offset added to registers: `C` channels of a vector of pixels.
template <int C, bool opacity>
HWY_INLINE void AverageBlock(const AverageJob& job, int first_channel, int x, bool with_weights)
{
    const D d;
    const auto channels = static_cast<std::size_t>(job.channels);
    const auto rows = static_cast<std::size_t>(job.rows);
    const std::size_t offsets = job.share.size() / rows;
    V sum[C], norm = hn::Zero(d), others = hn::Zero(d);
    for (int c = 0; c < C; ++c) sum[c] = hn::Zero(d);
    for (std::size_t i = 0; i < offsets; ++i) {
        const float* const* share = job.share.data() + i * rows;
        V weight = hn::Zero(d);
        bool none = true;
        for (std::size_t row = 0; row < rows; ++row) {
            if (!share[row]) continue;
            none = false;
            weight = hn::Add(weight, hn::Load(d, share[row] + x));
        }
        if (none) continue;
        const M any = hn::Gt(weight, hn::Zero(d));
        if (hn::AllFalse(d, any)) continue;
        const float* const* pixels = job.pixels.data() + i * (channels + 1);
        if constexpr (opacity) {
            norm = hn::Add(norm, hn::Mul(weight, hn::LoadU(d, pixels[channels] + x)));
        } else {
            norm = hn::Add(norm, weight);
        }
        if (i != job.self) others = hn::Add(others, weight);
        for (int c = 0; c < C; ++c) {
            const V u = hn::LoadU(d, pixels[static_cast<std::size_t>(first_channel + c)] + x);
            sum[c] = hn::Add(sum[c], hn::IfThenElseZero(any, hn::Mul(weight, u)));
        }
    }
    for (int c = 0; c < C; ++c)
        hn::Store(sum[c], d, job.sums[static_cast<std::size_t>(first_channel + c)] + x);
    if (with_weights) {
        hn::Store(norm, d, job.sums[channels] + x);
        hn::Store(others, d, job.sums[channels + 1] + x);
    }
}

template <bool opacity>
HWY_INLINE void AverageChannels(const AverageJob& job, int x)
{
    int c = 0;
    for (; c + 3 <= job.channels; c += 3) AverageBlock<3, opacity>(job, c, x, c == 0);
    for (; c < job.channels; ++c) AverageBlock<1, opacity>(job, c, x, c == 0);
}

void AverageRow(const AverageJob& job)
{
    const D d;
    const int lanes = LaneCount();
    const auto channels = static_cast<std::size_t>(job.channels);
    for (int x = job.begin; x < job.end; x += lanes) {
        if (job.opacity) {
            AverageChannels<true>(job, x);
        } else {
            AverageChannels<false>(job, x);
        }
        const V norm = hn::Load(d, job.sums[channels] + x);
        // A pixel nobody shares with keeps its value to the last bit.
        M fused = hn::And(hn::Gt(hn::Load(d, job.sums[channels + 1] + x), hn::Zero(d)),
                          hn::Gt(norm, hn::Zero(d)));
        V alpha = hn::Set(d, 1.0f);
        if (job.opacity) {
            alpha = hn::LoadU(d, job.input[channels] + x);
            fused = hn::And(fused, hn::Gt(alpha, hn::Zero(d)));
        }
        for (std::size_t c = 0; c < channels; ++c) {
            const V sum = hn::Load(d, job.sums[c] + x);
            V value = hn::Div(sum, norm);
            if (job.opacity) value = hn::Mul(alpha, value);
            hn::Store(hn::IfThenElse(fused, value, hn::LoadU(d, job.input[c] + x)), d,
                      job.out[c] + x);
        }
    }
}

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom::histogram_fusion
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace rayloom::histogram_fusion
{

HWY_EXPORT(SelectRow);
HWY_EXPORT(ShareRow);
HWY_EXPORT(AverageRow);

void select_row(const SelectJob& job) { HWY_DYNAMIC_DISPATCH(SelectRow)(job); }
bool share_row(const ShareJob& job) { return HWY_DYNAMIC_DISPATCH(ShareRow)(job); }
void average_row(const AverageJob& job) { HWY_DYNAMIC_DISPATCH(AverageRow)(job); }

} // namespace rayloom::histogram_fusion
#endif
