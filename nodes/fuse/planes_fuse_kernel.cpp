// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/planes_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "nodes/fuse/planes_fuse_kernel.cpp"
#include <hwy/foreach_target.h>

#include "nodes/fuse/planes-inl.h"

#ifndef RAYLOOM_PLANES_FUSE_KERNEL_SHARED
#define RAYLOOM_PLANES_FUSE_KERNEL_SHARED
namespace rayloom
{
namespace
{

/// Places whose largest radius is known, so that what no square reaches is not looked at.
constexpr int block_width = 16;

/// What one row of centres adds to one row of pixels.
struct FuseJob {
    const PlaneScene* scene = nullptr;
    PlaneBlend blend = PlaneBlend::max;
    Region part;
    int y = 0, cy = 0;
    const float* planes = nullptr; ///< the row's coefficients, [channel][place]
    const int* largest = nullptr;  ///< radius, for each phase and block of places
    int blocks = 0;                ///< of a phase
    float* values = nullptr;       ///< scratch: [3 planes · colours][place]
    float* sums = nullptr;         ///< of the row of pixels: weight, colours; [channel][place]
    std::ptrdiff_t stride = 0;     ///< of planes, values and sums
    const std::ptrdiff_t* steps = nullptr; ///< of column_steps(), from max_radius on
    int max_radius = 0;
    std::array<int, max_plane_stride> reaches{}; ///< largest radius of the row's phases
    int reach = 0;                               ///< of all of them
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

/// b·dy + c of the square (plane 0) or of a quadrant, for a row of centres.
template <int C>
HWY_INLINE void Evaluate(const FuseJob& job, int plane, float dy, float* to)
{
    const D d;
    const int lanes = LaneCount();
    const V vy = hn::Set(d, dy);
    const PlaneColumns& columns = job.scene->columns;
    for (int phase = 0; phase < columns.stride; ++phase) {
        if (static_cast<float>(job.reaches[static_cast<std::size_t>(phase)]) < std::abs(dy))
            continue;
        const std::ptrdiff_t begin = phase * columns.segment;
        const int end = columns.first(phase, job.scene->area.x1);
        for (int c = 0; c < C; ++c) {
            const float* const b = job.planes + (2 + (plane * C + c) * 3 + 1) * job.stride + begin;
            const float* const k = b + job.stride;
            for (int i = 0; i < end; i += lanes)
                hn::StoreU(hn::Add(hn::Mul(hn::LoadU(d, b + i), vy), hn::LoadU(d, k + i)), d,
                           to + c * job.stride + begin + i);
        }
    }
}

HWY_INLINE V Eighth(V v)
{
    v = hn::Mul(v, v);
    v = hn::Mul(v, v);
    return hn::Mul(v, v);
}

/// Sums of one vector of pixels, and what equations 11 to 13 add to them.
template <int C, PlaneBlend blend>
class PixelSums
{
public:
    /// `place` is that of the pixels in a row.
    PixelSums(const FuseJob& job, std::ptrdiff_t place)
        : m_guide(*job.scene, job.scene->pixels.view().row(0, job.y) + place),
          m_scene(job.scene->pixels.view().row(0, job.cy) + place), m_planes(job.planes + place),
          m_values(job.values + place), m_to(job.sums + place), m_stride(job.stride),
          m_source(job.scene->source * job.scene->pixels.view().channel_stride()),
          m_rows_away(std::abs(job.y - job.cy))
    {
        const D d;
        m_weight = hn::LoadU(d, m_to);
        for (int c = 0; c < C; ++c) m_colour[c] = hn::LoadU(d, m_to + (1 + c) * m_stride);
    }

    /// Adds the planes of the centres `ox` to the right, `step` away in memory. `value` is the
    /// quadrant's row of values.
    HWY_INLINE void Add(int ox, std::ptrdiff_t step, int value, int quadrant, float share,
                        bool own = false)
    {
        const D d;
        const V one = hn::Set(d, 1.0f), zero = hn::Zero(d);
        const auto away = static_cast<float>(std::max(std::abs(ox), m_rows_away));
        const V radius = hn::LoadU(d, m_planes + step);
        const M covers = hn::Ge(radius, hn::Set(d, away));
        if (hn::AllFalse(d, covers)) return;
        const float* const other = m_scene + step;
        V guide = hn::Mul(m_guide.With(other), hn::LoadU(d, other + m_source));
        guide = hn::IfThenElseZero(covers, guide);
        // Across objects, and beside boundaries, there is nothing to add.
        if (!own && hn::AllFalse(d, hn::Gt(guide, zero))) return;
        if (own) {
            const V least = hn::Set(d, plane_own_weight);
            guide = hn::IfThenElse(hn::Gt(radius, zero), hn::Max(guide, least), least);
        }
        if (share != 1.0f) guide = hn::Mul(guide, hn::Set(d, share));

        const V dx = hn::Set(d, static_cast<float>(-ox));
        const float* const a = m_planes + 2 * m_stride + step;
        const float* const part_a = a + (quadrant + 1) * C * 3 * m_stride;
        const float* const rest = m_values + step;
        const float* const part_rest = rest + value * C * m_stride;
        V whole[C], part[C];
        for (int c = 0; c < C; ++c) {
            whole[c] = hn::Add(hn::Mul(hn::LoadU(d, a + c * 3 * m_stride), dx),
                               hn::LoadU(d, rest + c * m_stride));
            part[c] = hn::Add(hn::Mul(hn::LoadU(d, part_a + c * 3 * m_stride), dx),
                              hn::LoadU(d, part_rest + c * m_stride));
        }
        V whole_light = whole[0], part_light = part[0];
        for (int c = 1; c < C; ++c) {
            whole_light = hn::Add(whole_light, whole[c]);
            part_light = hn::Add(part_light, part[c]);
        }
        // Where one is not positive the ratio is 0.
        const V low = hn::Max(hn::Min(whole_light, part_light), zero);
        const V high = hn::Min(hn::Max(hn::Max(whole_light, part_light), hn::Set(d, 1e-30f)),
                               hn::Set(d, 1e38f));
        // Both by a power of two that brings the higher one to [1, 2): eighth powers stay numbers.
        const hn::RebindToSigned<D> di;
        const auto exponent = hn::And(hn::BitCast(di, high), hn::Set(di, 0x7f800000));
        const V scale = hn::BitCast(d, hn::Sub(hn::Set(di, 0x7f000000), exponent));
        const V high_eighth = Eighth(hn::Mul(high, scale)),
                low_eighth = Eighth(hn::Mul(low, scale));
        // One division for 1/high⁸ and 1/(high⁸ + low⁸).
        const V sum = hn::Add(high_eighth, low_eighth);
        const V inverse = hn::Div(one, hn::Mul(high_eighth, sum));
        const V ratio = hn::Mul(low_eighth, hn::Mul(sum, inverse));
        // (Z + w·Z_m) / (1 + w) with w the ratio (min) or one over it (max).
        V blended = hn::Mul(blend == PlaneBlend::min ? low_eighth : high_eighth,
                            hn::Mul(high_eighth, inverse));
        V base = ratio;
        if (own) {
            base = hn::Max(base, hn::Set(d, plane_own_weight));
            blended = hn::IfThenElseZero(hn::Gt(low, zero), blended);
        }
        const V all = hn::Mul(guide, base);
        const V of_part = hn::Mul(all, blended);
        const V of_whole = hn::Sub(all, of_part);
        m_weight = hn::Add(m_weight, all);
        for (int c = 0; c < C; ++c)
            m_colour[c] = hn::Add(m_colour[c],
                                  hn::Add(hn::Mul(of_whole, whole[c]), hn::Mul(of_part, part[c])));
    }

    HWY_INLINE void Store() const
    {
        const D d;
        hn::StoreU(m_weight, d, m_to);
        for (int c = 0; c < C; ++c) hn::StoreU(m_colour[c], d, m_to + (1 + c) * m_stride);
    }

private:
    const Guide m_guide;
    const float *const m_scene, *const m_planes, *const m_values;
    float* const m_to;
    const std::ptrdiff_t m_stride, m_source;
    const int m_rows_away;
    V m_weight, m_colour[C];
};

/// Largest radius, for each phase, of the centres whose squares may reach a vector of pixels.
/// \return the largest of them.
int Reaches(const FuseJob& job, int place, std::array<int, max_plane_stride>& reaches)
{
    const PlaneColumns& columns = job.scene->columns;
    const int away = job.reach / columns.stride + 1;
    const auto last_place = static_cast<int>(columns.segment) - 1;
    const int first = std::max(0, place - away) / block_width;
    const int last = std::min(last_place, place + LaneCount() - 1 + away) / block_width;
    int all = 0;
    for (int phase = 0; phase < columns.stride; ++phase) {
        const int* const largest = job.largest + phase * job.blocks;
        int& reach = reaches[static_cast<std::size_t>(phase)];
        for (int b = first; b <= last; ++b) reach = std::max(reach, largest[b]);
        all = std::max(all, reach);
    }
    return all;
}

template <int C, PlaneBlend blend>
void FuseRows(const FuseJob& job)
{
    const int lanes = LaneCount();
    const PlaneColumns& columns = job.scene->columns;
    const int down = job.y - job.cy, rows_away = std::abs(down);
    const auto dy = static_cast<float>(down);
    const std::ptrdiff_t values = C * job.stride;
    Evaluate<C>(job, 0, dy, job.values);
    // On the centres' own row a pixel lies in the lower quadrants and in the upper ones.
    for (int half = 0; half < (down == 0 ? 2 : 1); ++half) {
        const int right = down < 0 || half == 1 ? 2 : 0, left = right + 1;
        const float share = down == 0 ? 0.5f : 1.0f;
        Evaluate<C>(job, 1 + right, dy, job.values + values);
        Evaluate<C>(job, 1 + left, dy, job.values + 2 * values);
        for (int phase = 0; phase < columns.stride; ++phase) {
            const int end = columns.first(phase, job.part.x1);
            const std::ptrdiff_t* const steps =
                job.steps + phase * (2 * job.max_radius + 1) + job.max_radius;
            for (int i = columns.first(phase, job.part.x0); i < end; i += lanes) {
                std::array<int, max_plane_stride> reaches{};
                const int reach = Reaches(job, i, reaches);
                if (reach < rows_away) continue;
                PixelSums<C, blend> sums(job, phase * columns.segment + i);
                int next = (phase - reach) % columns.stride; // phase of the centres
                if (next < 0) next += columns.stride;
                const auto reached = [&](int ox) {
                    const int radius = reaches[static_cast<std::size_t>(next)];
                    if (++next == columns.stride) next = 0;
                    return radius >= std::max(std::abs(ox), rows_away);
                };
                for (int ox = -reach; ox < 0; ++ox)
                    if (reached(ox)) sums.Add(ox, steps[ox], 1, right, share);
                if (reached(0)) {
                    sums.Add(0, 0, 1, right, 0.5f * share, rows_away == 0);
                    sums.Add(0, 0, 2, left, 0.5f * share, rows_away == 0);
                }
                for (int ox = 1; ox <= reach; ++ox)
                    if (reached(ox)) sums.Add(ox, steps[ox], 2, left, share);
                sums.Store();
            }
        }
    }
}

template <int C>
void FuseWith(const FuseJob& job)
{
    if (job.blend == PlaneBlend::max)
        FuseRows<C, PlaneBlend::max>(job);
    else
        FuseRows<C, PlaneBlend::min>(job);
}
void FuseOne(const FuseJob& job) { FuseWith<1>(job); }
void FuseThree(const FuseJob& job) { FuseWith<3>(job); }

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace rayloom
{
HWY_EXPORT(FuseOne);
HWY_EXPORT(FuseThree);

std::size_t fuse_planes_scratch(const PlaneSettings& settings, int colours, int part_channels)
{
    return 2 * plane_scene_bytes(settings, colours, part_channels);
}

void fuse_planes(const PlaneSettings& settings, const Region& data, ConstImageView coefficients,
                 const PlaneGuides& guides, ImageView out, const std::function<void()>& each_row)
{
    const Region& part = out.region();
    const int colours = out.channels(), channels = coefficients.channels();
    const int largest = settings.max_radius;
    PlaneScene scene = make_plane_scene(settings, part, data, guides, 0);
    separate_columns(scene);
    const PlaneColumns& columns = scene.columns;
    const Region known = part.grown(Halo::all(largest)).intersect(data);
    const std::vector<std::ptrdiff_t> steps = column_steps(columns, largest);

    FuseJob job;
    job.scene = &scene;
    job.blend = settings.blend;
    job.part = part;
    job.steps = steps.data();
    job.max_radius = largest;
    // Zeros, and no square, beside the image.
    const auto stride = static_cast<std::size_t>(columns.stride * columns.segment);
    job.stride = static_cast<std::ptrdiff_t>(stride);
    std::vector<float> planes(static_cast<std::size_t>(channels) * stride, 0.0f);
    std::fill_n(planes.begin(), stride, -1.0f);
    std::vector<float> values(static_cast<std::size_t>(3 * colours) * stride, 0.0f);
    job.blocks = static_cast<int>(columns.segment) / block_width + 1;
    std::vector<int> blocks(static_cast<std::size_t>(columns.stride * job.blocks));
    job.planes = planes.data();
    job.values = values.data();
    job.largest = blocks.data();
    std::vector<float> sums(static_cast<std::size_t>((1 + colours) * part.height()) * stride, 0.0f);
    std::vector<float> radii(static_cast<std::size_t>(known.width()));
    std::vector<float> weights(static_cast<std::size_t>(part.width()));

    for (int cy = known.y0; cy < known.y1; ++cy) {
        each_row();
        std::fill(blocks.begin(), blocks.end(), 0);
        job.reaches.fill(0);
        const float* const chosen = coefficients.ptr(0, known.x0, cy);
        for (std::size_t x = 0; x < radii.size(); ++x)
            radii[x] = std::min(chosen[x], static_cast<float>(largest));
        separate_row(columns, radii.data(), known.x0, known.width(), planes.data());
        for (int phase = 0; phase < columns.stride; ++phase) {
            const float* const radius = job.planes + phase * columns.segment;
            int& reach = job.reaches[static_cast<std::size_t>(phase)];
            const int end = columns.first(phase, known.x1);
            for (int i = columns.first(phase, known.x0); i < end; ++i) {
                int& block = blocks[static_cast<std::size_t>(phase * job.blocks + i / block_width)];
                block = std::max(block, static_cast<int>(radius[i]));
                reach = std::max(reach, block);
            }
        }
        job.cy = cy;
        job.reach = *std::max_element(job.reaches.begin(), job.reaches.end());
        const int y0 = std::max(part.y0, cy - job.reach);
        const int y1 = std::min(part.y1, cy + job.reach + 1);
        if (y0 >= y1) continue;
        for (int c = 1; c < channels; ++c)
            separate_row(columns, coefficients.ptr(c, known.x0, cy), known.x0, known.width(),
                         planes.data() + c * job.stride);
        for (int y = y0; y < y1; ++y) {
            job.y = y;
            job.sums = sums.data() + (y - part.y0) * (1 + colours) * job.stride;
            if (colours == 1)
                HWY_DYNAMIC_DISPATCH(FuseOne)(job);
            else
                HWY_DYNAMIC_DISPATCH(FuseThree)(job);
        }
    }
    for (int y = part.y0; y < part.y1; ++y) {
        const float* const weight = sums.data() + (y - part.y0) * (1 + colours) * job.stride;
        join_row(columns, weight, part.x0, part.width(), weights.data());
        for (int c = 0; c < colours; ++c) {
            float* const to = out.row(c, y);
            join_row(columns, weight + (1 + c) * job.stride, part.x0, part.width(), to);
            for (std::size_t x = 0; x < weights.size(); ++x)
                to[x] = std::max(0.0f, to[x] / weights[x]);
        }
    }
}

} // namespace rayloom
#endif
