// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/histogram_kernel.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "nodes/fuse/histogram_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef RAYLOOM_HISTOGRAM_KERNEL_SHARED
#define RAYLOOM_HISTOGRAM_KERNEL_SHARED
namespace rayloom
{
namespace
{

/// Columns handled together; a multiple of every vector length.
constexpr int block_size = 16;
constexpr float infinity = std::numeric_limits<float>::infinity();

struct Offset {
    int dx = 0, dy = 0;
};

/// One packed row of histograms: bins in pairs, an absent last one filled with zeros.
struct HistogramRow {
    const float* bins = nullptr;         ///< [bin][stride]
    const float* root = nullptr;         ///< √count, 0 where there are no samples
    const std::uint64_t* used = nullptr; ///< [block][word]: pairs of bins with a value above ½
    float count = 0.0f; ///< count of every pixel that has samples; −1 when they differ, 0: none has
};

/// χ² of a row of pixels with the row `dy` below, for neighbouring offsets.
struct ChiJob {
    HistogramRow here, there;
    std::ptrdiff_t stride = 0; ///< between bins
    int words = 1;             ///< 64-bit words of a block's `used`
    int first_block = 0, last_block = 0, reach_blocks = 0;
    std::span<const Offset> offsets; ///< of one dy
    float* chi = nullptr;            ///< [offset][result_stride]
    float* bins = nullptr;           ///< [offset][result_stride]
    std::ptrdiff_t result_stride = 0;
    std::uint16_t* list = nullptr; ///< room for every pair of bins
};

/// Pools rows of χ² over patches.
struct PoolJob {
    std::span<const float*const> chi, bins; ///< 2·radius + 1 rows
    int radius = 1;
    int width = 0;
    float* chi_column = nullptr; ///< scratch rows, `radius` zeros on both sides
    float* bins_column = nullptr;
    float* distance = nullptr;
};

/// Counts the matches of a row.
struct SelectJob {
    std::span<const float* const> distance; ///< per offset in raster order
    int begin = 0, end = 0;
    float kappa = 1.0f;
    int min_patches = 0;
    float* threshold = nullptr; ///< a candidate is accepted below it …
    float* last_tie = nullptr;  ///< … or at it up to this index
    float* count = nullptr;
    std::span<float> nearest; ///< scratch: 2 · min_patches blocks
};

/// Weights one offset's accepted candidates give to the pixels of the patch.
struct ShareJob {
    const float* distance = nullptr; ///< null for the pixel itself
    float index = 0.0f;
    int begin = 0, end = 0;         ///< reference pixels
    int out_begin = 0, out_end = 0; ///< pixels that are written
    const float* threshold = nullptr;
    const float* last_tie = nullptr;
    std::span<const float* const>
        weight; ///< [m]: 1/count where the half-size is at least m, else 0
    int radius = 1;
    int classes = 1;                  ///< 1: every pixel has the full half-size
    std::span<float* const> accepted; ///< scratch, one row per class, `radius` zeros either side
    std::span<float* const> share;    ///< result, one row per vertical distance class
};

/// Averages one output row.
struct AverageJob {
    /// [offset][2·radius + 1] rows of weights; null where all are zero.
    std::span<const float* const> share;
    int rows = 3;
    std::span<const float* const> pixels; ///< [offset][channels + 1]; opacity last
    int channels = 3;
    bool opacity = false;
    std::span<const float* const> input; ///< [channels + 1] at the written pixel
    std::size_t self = 0;                ///< index of offset (0, 0)
    int begin = 0, end = 0;
    std::span<float* const> sums; ///< [channels + 2] scratch rows
    std::span<float* const> out;  ///< [channels] rows
};

} // namespace
} // namespace rayloom
#endif

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

/// Offsets that share the loads of one pixel; bounded by the registers there are.
constexpr int group_size = HWY_TARGET <= HWY_AVX3 ? 4 : 2;

HWY_INLINE V Counted(V count, M mask)
{
    const D d;
#if HWY_TARGET <= HWY_AVX3
    return hn::IfThenElse(mask, hn::Add(count, hn::Set(d, 1.0f)), count);
#else
    return hn::Add(count, hn::IfThenElseZero(mask, hn::Set(d, 1.0f)));
#endif
}

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
    const int lanes = static_cast<int>(hn::Lanes(D()));
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

/// Bit per pair of bins that has a value above ½ somewhere in the block: without one no sum of two
/// pixels' bins can exceed 1.
void MarkUsed(const float* bins, std::ptrdiff_t stride, int pairs, int blocks, int words,
              std::uint64_t* used)
{
    const D d;
    const V half = hn::Set(d, 0.5f);
    const int lanes = static_cast<int>(hn::Lanes(d));
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
    const int lanes = static_cast<int>(hn::Lanes(d));
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

void SelectRow(const SelectJob& job)
{
    const D d;
    const int lanes = static_cast<int>(hn::Lanes(d));
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

/// Returns whether any weight is not zero.
bool ShareRow(const ShareJob& job)
{
    const D d;
    const int lanes = static_cast<int>(hn::Lanes(d));
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
    const int lanes = static_cast<int>(hn::Lanes(d));
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
} // namespace rayloom
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace rayloom
{

HWY_EXPORT(ChiRow);
HWY_EXPORT(MarkUsed);
HWY_EXPORT(PoolRow);
HWY_EXPORT(SelectRow);
HWY_EXPORT(ShareRow);
HWY_EXPORT(AverageRow);

namespace
{

/// Written columns of a strip. With the default window and 61 channels the rings then take about a
/// megabyte, and the columns read beyond the strip are one in eight.
constexpr int strip_width = 112;

int round_up(int n) { return (n + block_size - 1) / block_size * block_size; }
std::size_t index(int i) { return static_cast<std::size_t>(i); }

/// Rows of floats, each aligned to 64 bytes.
class Rows
{
public:
    Rows() = default;
    Rows(int rows, int width)
        : m_buffer(Region{0, 0, round_up(width), std::max(rows, 1)}, 1), m_rows(rows)
    {
        m_buffer.fill(0.0f);
    }
    float* row(int i) { return m_buffer.view().row(0, i); }
    const float* row(int i) const { return m_buffer.view().row(0, i); }
    std::ptrdiff_t stride() const { return m_buffer.view().row_stride(); }
    std::size_t bytes() const { return m_buffer.bytes(); }
    void clear(int first, int count)
    {
        std::fill_n(row(first), count * static_cast<int>(stride()), 0.0f);
    }

private:
    ImageBuffer m_buffer;
    int m_rows = 0;
};

/// Sizes that depend on the settings and channel counts alone.
struct Layout {
    Layout(const HistogramFusionSettings& s, int histogram_channels, int image_channels)
        : b(s.window_radius), w(s.patch_radius), bins(histogram_channels - 1),
          pairs((bins + 1) / 2), words((pairs + 63) / 64), channels(image_channels),
          margin(2 * w + b), pad(round_up(std::max(b, 1))),
          width(round_up(strip_width + 2 * margin)), blocks(width / block_size)
    {
        for (int dx = 1; dx <= b; ++dx) half.push_back({dx, 0});
        for (int dy = 1; dy <= b; ++dy)
            for (int dx = -b; dx <= b; ++dx) half.push_back({dx, dy});
    }
    /// Index of (dx, dy) in raster order without (0, 0).
    int offsets() const { return 2 * static_cast<int>(half.size()); }

    int b, w, bins, pairs, words, channels;
    int margin; ///< columns of histograms on either side of the written ones
    int pad;    ///< zeros on either side of a packed row
    int width;  ///< columns of a strip with its margins, in whole blocks
    int blocks;
    std::vector<Offset> half; ///< offsets after (0, 0) in raster order
};

/// Every ring of rows of a sweep.
class Sweep
{
public:
    Sweep(const HistogramFusionSettings& settings, const Region& data, ConstImageView histogram,
          ConstImageView image, int alpha)
        : m_settings(settings), m_layout(settings, histogram.channels(), image.channels()),
          m_data(data), m_histogram(histogram), m_image(image), m_alpha(alpha)
    {
        const Layout& l = m_layout;
        const int padded = l.width + 2 * l.pad;
        const int half = static_cast<int>(l.half.size()), patch_rows = 2 * l.w + 1;
        const int offsets = l.offsets();
        for (int c = 0; c < l.channels; ++c)
            if (c != alpha) m_colour.push_back(c);
        // Runs of an odd number of cache lines, so that the bins of a pixel fall into different
        // cache sets.
        const int lines = padded / block_size;
        m_bins = Rows((l.b + 1) * l.pairs * 2, (lines % 2 == 0 ? lines + 1 : lines) * block_size);
        m_roots = Rows(l.b + 1, padded);
        m_used.assign(index((l.b + 1) * (l.blocks + 2 * l.pad / block_size) * l.words), 0);
        m_counts.assign(index(l.b + 1), 0.0f);
        m_chi = Rows(patch_rows * half, l.width);
        m_chi_bins = Rows(patch_rows * half, l.width);
        m_columns = Rows(2, l.width + 2 * round_up(l.w));
        m_distance = Rows((l.b + 1) * half, l.width + 2 * block_size);
        m_border_distance = Rows(offsets, l.width + block_size);
        m_nothing = Rows(1, l.width + 2 * block_size);
        std::fill_n(m_nothing.row(0), m_nothing.stride(), infinity);
        m_selection = Rows(3, l.width + block_size);
        m_weights = Rows(l.w + 1, l.width + block_size);
        m_accepted = Rows(l.w + 1, l.width + 4 * block_size + 2 * l.w);
        m_shares = Rows(patch_rows * (l.w + 1) * (offsets + 1), l.width);
        m_share_used.assign(index(patch_rows * (offsets + 1)), 0);
        m_share_classes.assign(index(patch_rows), 1);
        m_pixels =
            Rows((2 * l.b + 1) * (static_cast<int>(m_colour.size()) + 1), padded + block_size);
        m_sums = Rows(static_cast<int>(m_colour.size()) + 2, l.width);
        m_out = Rows(static_cast<int>(m_colour.size()), l.width);
        m_list.resize(index(l.pairs));
        m_nearest.resize(index(2 * settings.min_patches * block_size));
    }

    std::size_t bytes() const
    {
        std::size_t sum = m_used.size() * sizeof(std::uint64_t);
        for (const Rows* rows : {&m_bins, &m_roots, &m_chi, &m_chi_bins, &m_columns, &m_distance,
                                 &m_border_distance, &m_nothing, &m_selection, &m_weights,
                                 &m_accepted, &m_shares, &m_pixels, &m_sums, &m_out})
            sum += rows->bytes();
        return sum;
    }

    /// Fills the columns and rows of `part`.
    void run(const Region& part, ImageView out, ImageView matches,
             const std::function<void()>& each_row)
    {
        const Layout& l = m_layout;
        m_part = part;
        m_x0 = part.x0 - l.margin;
        const int first = part.y0 - 2 * l.w - l.b, last = part.y1 + 2 * l.w;
        for (int y = first; y < first + l.b; ++y) pack_histogram(y);
        if (!out.empty())
            for (int z = part.y0 - l.b; z < part.y0 + l.b; ++z) pack_pixels(z);
        for (int y = first; y < last; ++y) {
            each_row();
            pack_histogram(y + l.b);
            chi_row(y);
            const int pooled = y - l.w;
            if (pooled >= part.y0 - l.w - l.b) pool_row(pooled);
            if (pooled >= part.y0 - l.w) select_row(pooled, !out.empty(), matches);
            if (const int z = y - 2 * l.w; z >= part.y0 && !out.empty()) {
                pack_pixels(z + l.b);
                average_row(z, out);
            }
        }
    }

private:
    static int modulo(int y, int n) { return (y % n + n) % n; }
    int histogram_slot(int y) const { return modulo(y, m_layout.b + 1); }
    int patch_slot(int y) const { return modulo(y, 2 * m_layout.w + 1); }
    int pixel_slot(int y) const { return modulo(y, 2 * m_layout.b + 1); }
    int half_count() const { return static_cast<int>(m_layout.half.size()); }

    bool has_row(int y) const { return y >= m_data.y0 && y < m_data.y1; }
    /// Distance of a row or column to the border; negative outside.
    int row_distance(int y) const { return std::min(y - m_data.y0, m_data.y1 - 1 - y); }
    int column_distance(int x) const { return std::min(x - m_data.x0, m_data.x1 - 1 - x); }

    HistogramRow histogram_row(int y)
    {
        const Layout& l = m_layout;
        const int slot = histogram_slot(y), all_blocks = l.blocks + 2 * l.pad / block_size;
        HistogramRow row;
        row.bins = m_bins.row(slot * l.pairs * 2) + l.pad;
        row.root = m_roots.row(slot) + l.pad;
        row.used = m_used.data() + (slot * all_blocks + l.pad / block_size) * l.words;
        row.count = m_counts[index(slot)];
        return row;
    }

    void pack_histogram(int y)
    {
        const Layout& l = m_layout;
        const int slot = histogram_slot(y);
        m_roots.clear(slot, 1);
        m_counts[index(slot)] = 0.0f;
        if (!has_row(y)) return;
        const int x0 = std::max(m_x0, m_data.x0);
        const int x1 = std::min(m_part.x1 + l.margin, m_data.x1);
        const int before = l.pad + x0 - m_x0;
        const auto n = index(x1 - x0);
        for (int i = 0; i < 2 * l.pairs; ++i) {
            float* row = m_bins.row(slot * l.pairs * 2 + i);
            std::fill_n(row, m_bins.stride(), 0.0f);
            if (i < l.bins) std::memcpy(row + before, m_histogram.ptr(i, x0, y), n * sizeof(float));
        }
        const float* count = m_histogram.ptr(l.bins, x0, y);
        float* root = m_roots.row(slot) + before;
        float common = 0.0f;
        for (std::size_t i = 0; i < n; ++i) {
            if (!(count[i] > 0.0f)) continue;
            root[i] = std::sqrt(count[i]);
            if (common == 0.0f) common = count[i];
            if (count[i] != common) common = -1.0f;
        }
        m_counts[index(slot)] = common;
        const int all_blocks = l.blocks + 2 * l.pad / block_size;
        HWY_DYNAMIC_DISPATCH(MarkUsed)
        (m_bins.row(slot * l.pairs * 2), m_bins.stride(), l.pairs, all_blocks, l.words,
         m_used.data() + slot * all_blocks * l.words);
    }

    void pack_pixels(int y)
    {
        const Layout& l = m_layout;
        const int channels = static_cast<int>(m_colour.size());
        const int first = pixel_slot(y) * (channels + 1);
        m_pixels.clear(first, channels + 1);
        if (!has_row(y)) return;
        const int x0 = std::max(m_part.x0 - l.b, m_data.x0);
        const int x1 = std::min(m_part.x1 + l.b, m_data.x1);
        const int before = l.pad + x0 - m_x0;
        const auto n = index(x1 - x0);
        float* opacity = m_pixels.row(first + channels) + before;
        if (m_alpha >= 0) {
            const float* alpha = m_image.ptr(m_alpha, x0, y);
            for (std::size_t i = 0; i < n; ++i) opacity[i] = alpha[i] > 0.0f ? alpha[i] : 0.0f;
        }
        for (int c = 0; c < channels; ++c) {
            float* row = m_pixels.row(first + c) + before;
            const float* from = m_image.ptr(m_colour[index(c)], x0, y);
            if (m_alpha < 0) {
                std::memcpy(row, from, n * sizeof(float));
            } else {
                for (std::size_t i = 0; i < n; ++i) row[i] = opacity[i] > 0.0f ? from[i] : 0.0f;
            }
        }
    }

    void chi_row(int y)
    {
        const Layout& l = m_layout;
        const int half = half_count(), first = patch_slot(y) * half;
        const HistogramRow here = histogram_row(y);
        for (int begin = 0; begin < half;) {
            const int dy = l.half[index(begin)].dy;
            int end = begin;
            while (end < half && l.half[index(end)].dy == dy) ++end;
            const HistogramRow there = histogram_row(y + dy);
            if (!has_row(y) || !has_row(y + dy) || here.count == 0.0f || there.count == 0.0f) {
                m_chi.clear(first + begin, end - begin);
                m_chi_bins.clear(first + begin, end - begin);
            } else {
                ChiJob job;
                job.here = here;
                job.there = there;
                job.stride = m_bins.stride();
                job.words = l.words;
                job.last_block = l.blocks;
                job.reach_blocks = l.pad / block_size;
                job.offsets = std::span(l.half).subspan(index(begin), index(end - begin));
                job.chi = m_chi.row(first + begin);
                job.bins = m_chi_bins.row(first + begin);
                job.result_stride = m_chi.stride();
                job.list = m_list.data();
                HWY_DYNAMIC_DISPATCH(ChiRow)(job);
            }
            begin = end;
        }
    }

    void pool_row(int y)
    {
        const Layout& l = m_layout;
        const int half = half_count(), slot = histogram_slot(y);
        if (!has_row(y)) return;
        const int column_pad = round_up(l.w);
        std::vector<const float*> chi(index(2 * l.w + 1)), bins(index(2 * l.w + 1));
        for (int i = 0; i < half; ++i) {
            const Offset o = l.half[index(i)];
            float* const distance = m_distance.row(slot * half + i);
            const int reach = std::min({l.w, row_distance(y), row_distance(y + o.dy)});
            if (reach < 0) {
                std::fill_n(distance, l.width, infinity);
                continue;
            }
            for (int v = -l.w; v <= l.w; ++v) {
                chi[index(v + l.w)] = m_chi.row(patch_slot(y + v) * half + i);
                bins[index(v + l.w)] = m_chi_bins.row(patch_slot(y + v) * half + i);
            }
            PoolJob job;
            job.chi = chi;
            job.bins = bins;
            job.radius = l.w;
            job.width = l.width;
            job.chi_column = m_columns.row(0) + column_pad;
            job.bins_column = m_columns.row(1) + column_pad;
            job.distance = distance;
            HWY_DYNAMIC_DISPATCH(PoolRow)(job);
            shrink_patches(o, reach, chi, bins, distance);
        }
    }

    /// Where the border is nearer than the patch half-size, pools over what is left of the patch.
    void shrink_patches(const Offset& o, int reach, std::span<const float* const> chi,
                        std::span<const float* const> bins, float* distance) const
    {
        const Layout& l = m_layout;
        const auto shrink = [&](int begin, int end) {
            for (int x = std::max(begin, m_x0 + l.w); x < std::min(end, m_part.x1 + l.margin - l.w);
                 ++x) {
                const int r = std::min({reach, column_distance(x), column_distance(x + o.dx)});
                if (r >= l.w) continue;
                float sum = 0.0f, used = 0.0f;
                for (int t = -r; t <= r; ++t) {
                    float column = 0.0f, column_used = 0.0f;
                    for (int v = -r; v <= r; ++v) {
                        column += chi[index(v + l.w)][x + t - m_x0];
                        column_used += bins[index(v + l.w)][x + t - m_x0];
                    }
                    sum += column;
                    used += column_used;
                }
                distance[x - m_x0] = used > 0.0f ? sum / used : infinity;
            }
        };
        if (reach < l.w) {
            shrink(m_x0, m_x0 + l.width);
            return;
        }
        const int near = l.w + l.b; // either pixel of the pair may be the one near the border
        shrink(m_x0, m_data.x0 + near);
        shrink(std::max(m_data.x1 - near, m_data.x0 + near), m_x0 + l.width);
    }

    /// Half-size of the patch of a reference pixel.
    int half_size(int x, int y) const
    {
        return std::min({m_layout.w, row_distance(y), column_distance(x)});
    }

    /// Distances of every candidate of row `y` in raster order; a candidate whose patch would leave
    /// the image is infinitely far.
    void gather_distances(int y)
    {
        const Layout& l = m_layout;
        const int half = half_count();
        m_candidates.assign(index(l.offsets()), nullptr);
        for (int i = 0; i < l.offsets(); ++i) {
            const bool forward = i >= half;
            const Offset o = l.half[index(forward ? i - half : half - 1 - i)];
            const int other = forward ? y : y - o.dy;
            m_candidates[index(i)] = has_row(other)
                                         ? m_distance.row(histogram_slot(other) * half +
                                                          (forward ? i - half : half - 1 - i)) -
                                               (forward ? 0 : o.dx)
                                         : m_nothing.row(0);
        }
        const int near = l.w + l.b;
        const int a0 = m_part.x0 - l.w, a1 = m_part.x1 + l.w;
        const bool rows_touch = row_distance(y) < near;
        if (!rows_touch && column_distance(a0) >= near && column_distance(a1 - 1) >= near) return;
        for (int i = 0; i < l.offsets(); ++i) {
            const bool forward = i >= half;
            Offset o = l.half[index(forward ? i - half : half - 1 - i)];
            if (!forward) o = {-o.dx, -o.dy};
            float* const row = m_border_distance.row(i);
            const float* const from = m_candidates[index(i)];
            std::memcpy(row + a0 - m_x0, from + a0 - m_x0, index(a1 - a0) * sizeof(float));
            for (int x = a0; x < a1; ++x) {
                if (!rows_touch && column_distance(x) >= near) continue;
                const int candidate = std::min(row_distance(y + o.dy), column_distance(x + o.dx));
                if (candidate < half_size(x, y) || candidate < 0) row[x - m_x0] = infinity;
            }
            m_candidates[index(i)] = row;
        }
    }

    void select_row(int y, bool share_them, ImageView matches)
    {
        const Layout& l = m_layout;
        const int slot = patch_slot(y), offsets = l.offsets();
        if (!has_row(y)) {
            std::fill_n(m_share_used.begin() + slot * (offsets + 1), offsets + 1, char{0});
            return;
        }
        gather_distances(y);
        SelectJob select;
        select.distance = m_candidates;
        select.begin = l.margin - l.w;
        select.end = m_part.x1 - m_x0 + l.w;
        select.kappa = m_settings.kappa;
        select.min_patches = m_settings.min_patches;
        select.threshold = m_selection.row(0);
        select.last_tie = m_selection.row(1);
        select.count = m_selection.row(2);
        select.nearest = m_nearest;
        HWY_DYNAMIC_DISPATCH(SelectRow)(select);
        if (!matches.empty() && y >= m_part.y0 && y < m_part.y1)
            std::copy_n(select.count + l.margin, m_part.width(), matches.ptr(0, m_part.x0, y));
        if (!share_them) return;

        bool full = true;
        for (int x = select.begin; x < select.end; ++x) {
            const int size = half_size(x + m_x0, y);
            full = full && size == l.w;
            for (int m = 0; m <= l.w; ++m)
                m_weights.row(m)[x] = size >= m ? 1.0f / select.count[x] : 0.0f;
        }
        // Lanes beyond the last reference pixel must not weigh in.
        for (int m = 0; m <= l.w; ++m) std::fill_n(m_weights.row(m) + select.end, block_size, 0.0f);

        const int classes = full ? 1 : l.w + 1;
        m_share_classes[index(slot)] = classes;
        std::vector<const float*> weight(index(l.w + 1));
        std::vector<float*> accepted(index(l.w + 1)), share(index(l.w + 1));
        for (int m = 0; m <= l.w; ++m) {
            weight[index(m)] = m_weights.row(m);
            accepted[index(m)] = m_accepted.row(m) + block_size;
        }
        ShareJob job;
        job.begin = select.begin;
        job.end = select.end;
        job.out_begin = l.margin / block_size * block_size;
        job.out_end = l.margin + m_part.width();
        job.threshold = select.threshold;
        job.last_tie = select.last_tie;
        job.weight = weight;
        job.radius = l.w;
        job.classes = classes;
        job.accepted = accepted;
        job.share = share;
        for (int i = 0; i <= offsets; ++i) {
            const int self = offsets / 2;
            const int candidate = i < self ? i : i - 1;
            job.distance = i == self ? nullptr : m_candidates[index(candidate)];
            job.index = static_cast<float>(candidate);
            for (int v = 0; v < classes; ++v) share[index(v)] = share_row(slot, v, i);
            m_share_used[index(slot * (offsets + 1) + i)] =
                HWY_DYNAMIC_DISPATCH(ShareRow)(job) ? 1 : 0;
        }
    }

    float* share_row(int slot, int vertical, int offset)
    {
        const Layout& l = m_layout;
        return m_shares.row((slot * (l.w + 1) + vertical) * (l.offsets() + 1) + offset);
    }

    void average_row(int z, ImageView out)
    {
        const Layout& l = m_layout;
        const int offsets = l.offsets() + 1, rows = 2 * l.w + 1;
        const int channels = static_cast<int>(m_colour.size());
        m_share_rows.assign(index(offsets * rows), nullptr);
        m_pixel_rows.assign(index(offsets * (channels + 1)), nullptr);
        for (int i = 0; i < offsets; ++i) {
            for (int v = -l.w; v <= l.w; ++v) {
                const int slot = patch_slot(z + v);
                if (!m_share_used[index(slot * offsets + i)]) continue;
                const int vertical = m_share_classes[index(slot)] == 1 ? 0 : (v < 0 ? -v : v);
                m_share_rows[index(i * rows + v + l.w)] = share_row(slot, vertical, i);
            }
            const int dy = i / (2 * l.b + 1) - l.b, dx = i % (2 * l.b + 1) - l.b;
            for (int c = 0; c <= channels; ++c)
                m_pixel_rows[index(i * (channels + 1) + c)] = pixel_row(z + dy, c) + dx;
        }
        std::vector<const float*> input(index(channels + 1));
        std::vector<float*> sums(index(channels + 2)), results(index(channels));
        // Where alpha is zero the premultiplied colour is kept as it came.
        for (int c = 0; c < channels; ++c) input[index(c)] = pixel_row(z, c);
        input[index(channels)] = pixel_row(z, channels);
        for (int c = 0; c < channels + 2; ++c) sums[index(c)] = m_sums.row(c);
        for (int c = 0; c < channels; ++c) results[index(c)] = m_out.row(c);
        AverageJob job;
        job.share = m_share_rows;
        job.rows = rows;
        job.pixels = m_pixel_rows;
        job.channels = channels;
        job.opacity = m_alpha >= 0;
        job.input = input;
        job.self = index(offsets / 2);
        job.begin = l.margin / block_size * block_size;
        job.end = l.margin + m_part.width();
        job.sums = sums;
        job.out = results;
        HWY_DYNAMIC_DISPATCH(AverageRow)(job);
        for (int c = 0; c < channels; ++c) {
            float* const to = out.ptr(m_colour[index(c)], m_part.x0, z);
            std::copy_n(results[index(c)] + l.margin, m_part.width(), to);
            if (m_alpha >= 0) {
                const float* const alpha = m_image.ptr(m_alpha, m_part.x0, z);
                const float* const from = m_image.ptr(m_colour[index(c)], m_part.x0, z);
                for (int x = 0; x < m_part.width(); ++x)
                    if (!(alpha[x] > 0.0f)) to[x] = from[x];
            }
        }
        if (m_alpha >= 0)
            std::copy_n(m_image.ptr(m_alpha, m_part.x0, z), m_part.width(),
                        out.ptr(m_alpha, m_part.x0, z));
    }

    const float* pixel_row(int y, int channel)
    {
        return m_pixels.row(pixel_slot(y) * (static_cast<int>(m_colour.size()) + 1) + channel) +
               m_layout.pad;
    }

    HistogramFusionSettings m_settings;
    Layout m_layout;
    Region m_data;
    ConstImageView m_histogram, m_image;
    int m_alpha = -1;
    std::vector<int> m_colour;

    Region m_part; ///< written pixels
    int m_x0 = 0;  ///< column of index 0 of the rings

    Rows m_bins, m_roots;
    std::vector<std::uint64_t> m_used;
    std::vector<float> m_counts;
    Rows m_chi, m_chi_bins, m_columns;
    Rows m_distance, m_border_distance, m_nothing;
    Rows m_selection, m_weights, m_accepted, m_shares;
    std::vector<char> m_share_used;
    std::vector<int> m_share_classes;
    Rows m_pixels, m_sums, m_out;
    std::vector<std::uint16_t> m_list;
    std::vector<float> m_nearest;
    std::vector<const float*> m_candidates, m_share_rows, m_pixel_rows;
};

} // namespace

int histogram_fusion_reach(const HistogramFusionSettings& settings)
{
    return settings.window_radius + 2 * settings.patch_radius;
}

std::size_t histogram_fusion_scratch(const HistogramFusionSettings& settings,
                                     int histogram_channels, int image_channels)
{
    const Layout l(settings, histogram_channels, image_channels);
    const auto row = [](int n) { return index(round_up(n)) * sizeof(float); };
    const int half = static_cast<int>(l.half.size()), patch_rows = 2 * l.w + 1;
    return index((l.b + 1) * (2 * l.pairs + 1)) * row(l.width + 2 * l.pad + block_size) +
           index(2 * patch_rows * half) * row(l.width) +
           index((l.b + 3) * half) * row(l.width + 2 * block_size) +
           index(patch_rows * (l.w + 1) * (l.offsets() + 1)) * row(l.width) +
           index((2 * l.b + 1) * (l.channels + 1)) * row(l.width + 2 * l.pad + block_size) +
           index(2 * l.channels + 3 * l.w + 16) * row(l.width + 6 * block_size);
}

void fuse_histogram(const HistogramFusionSettings& settings, const Region& data,
                    ConstImageView histogram, ConstImageView image, int alpha, ImageView out,
                    ImageView matches, const std::function<void()>& each_row)
{
    Sweep sweep(settings, data, histogram, image, alpha);
    const Region& all = out.empty() ? matches.region() : out.region();
    const int strips = (all.width() + strip_width - 1) / strip_width;
    for (int i = 0; i < strips; ++i) {
        const int x0 = all.x0 + i * all.width() / strips,
                  x1 = all.x0 + (i + 1) * all.width() / strips;
        sweep.run({x0, all.y0, x1, all.y1}, out, matches, each_row);
    }
}

} // namespace rayloom
#endif
