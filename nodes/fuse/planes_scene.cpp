// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/planes_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "nodes/fuse/planes_scene.cpp"
#include <hwy/foreach_target.h>

#include "nodes/fuse/planes-inl.h"

#ifndef RAYLOOM_PLANES_SCENE_SHARED
#define RAYLOOM_PLANES_SCENE_SHARED
namespace rayloom
{
namespace
{

constexpr int near_radius = 2; ///< σ is taken over 5×5 pixels

/// One row of light: what is read, and what is made of it. Rows hold whole vectors.
struct LightRow {
    std::array<float*, 3> z{};
    std::array<const float*, 3> marked{}, variance{};
    int colours = 0, variances = 0, n = 0;
    bool marks = false;
    float *light = nullptr, *noise = nullptr, *use = nullptr;
};

/// One row of σ: sums over the rows around, each with near_radius more columns on both sides.
struct SourceRow {
    const float *light = nullptr, *noise = nullptr, *count = nullptr, *use = nullptr;
    const float* source = nullptr; ///< weight without σ
    float* weight = nullptr;
    float max_noise = 0.0f;
    int n = 0;
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

/// \return whether a pixel among the first n has no normal.
bool NormaliseRow(float* x, float* y, float* z, float* none, int n)
{
    const D d;
    const int lanes = LaneCount();
    const V one = hn::Set(d, 1.0f), zero = hn::Zero(d);
    bool lacks = false;
    for (int i = 0; i < n; i += lanes) {
        const V a = hn::LoadU(d, x + i), b = hn::LoadU(d, y + i), c = hn::LoadU(d, z + i);
        const V length = hn::Sqrt(hn::Add(hn::Add(hn::Mul(a, a), hn::Mul(b, b)), hn::Mul(c, c)));
        const M is = hn::And(hn::Gt(length, hn::Set(d, 0.05f)), hn::Lt(length, hn::Set(d, 1e18f)));
        const V inverse = hn::Div(one, hn::IfThenElse(is, length, one));
        hn::StoreU(hn::IfThenElseZero(is, hn::Mul(a, inverse)), d, x + i);
        hn::StoreU(hn::IfThenElseZero(is, hn::Mul(b, inverse)), d, y + i);
        hn::StoreU(hn::IfThenElseZero(is, hn::Mul(c, inverse)), d, z + i);
        hn::StoreU(hn::IfThenElse(is, zero, one), d, none + i);
        const M inside = hn::FirstN(d, static_cast<std::size_t>(std::min(lanes, n - i)));
        lacks = lacks || !hn::AllFalse(d, hn::AndNot(is, inside));
    }
    return lacks;
}

void MakeLightRow(const LightRow& row)
{
    const D d;
    const int lanes = LaneCount();
    const V one = hn::Set(d, 1.0f), zero = hn::Zero(d);
    const V per_colour = hn::Set(d, 1.0f / static_cast<float>(row.colours));
    const V per_variance = hn::Set(d, 1.0f / static_cast<float>(row.variances));
    for (int i = 0; i < row.n; i += lanes) {
        V z[3] = {zero, zero, zero}, bad = zero, sum = zero, unmarked = zero;
        M mark[3] = {hn::Lt(one, zero), hn::Lt(one, zero), hn::Lt(one, zero)};
        for (int c = 0; c < row.colours; ++c) {
            const auto k = static_cast<std::size_t>(c);
            z[c] = hn::LoadU(d, row.z[k] + i);
            bad = hn::Add(bad, hn::Sub(z[c], z[c])); // 0, or NaN
            if (row.marks) mark[c] = hn::Ne(hn::LoadU(d, row.marked[k] + i), zero);
            sum = hn::Add(sum, hn::IfThenElse(mark[c], zero, z[c]));
            unmarked = hn::Add(unmarked, hn::IfThenElse(mark[c], zero, one));
        }
        V deviation = zero;
        for (int c = 0; c < row.variances; ++c) {
            const V v = hn::LoadU(d, row.variance[static_cast<std::size_t>(c)] + i);
            bad = hn::Add(bad, hn::Sub(v, v));
            deviation = hn::Add(deviation, hn::Sqrt(hn::Max(v, zero)));
        }
        deviation = hn::Mul(deviation, per_variance);
        const M use = hn::And(hn::Eq(bad, zero), hn::Gt(unmarked, zero));
        // Light of a marked colour is not known: take it to be grey.
        const V grey = hn::Div(sum, hn::Max(unmarked, one));
        V light = zero;
        for (int c = 0; c < row.colours; ++c) {
            z[c] = hn::IfThenElseZero(use, hn::IfThenElse(mark[c], grey, z[c]));
            hn::StoreU(z[c], d, row.z[static_cast<std::size_t>(c)] + i);
            light = hn::Add(light, z[c]);
        }
        hn::StoreU(hn::Mul(light, per_colour), d, row.light + i);
        hn::StoreU(hn::IfThenElseZero(use, hn::Mul(deviation, deviation)), d, row.noise + i);
        hn::StoreU(hn::IfThenElseZero(use, one), d, row.use + i);
    }
}

void MakeSourceRow(const SourceRow& row)
{
    const D d;
    const int lanes = LaneCount();
    const V zero = hn::Zero(d), one = hn::Set(d, 1.0f);
    const auto around = [&](const float* from, int i) HWY_ATTR {
        V sum = hn::LoadU(d, from + i);
        for (int k = 1; k <= 2 * near_radius; ++k) sum = hn::Add(sum, hn::LoadU(d, from + i + k));
        return sum;
    };
    for (int i = 0; i < row.n; i += lanes) {
        const V light = around(row.light, i), noise = around(row.noise, i);
        const V n = around(row.count, i);
        const M known = hn::And(hn::Gt(noise, zero), hn::Gt(light, zero));
        const V sigma = hn::IfThenElseZero(
            known, hn::Div(hn::Sqrt(hn::Mul(noise, n)), hn::IfThenElse(known, light, one)));
        const V bad = hn::Add(hn::Sub(light, light), hn::Sub(noise, noise));
        M use = hn::And(hn::Gt(hn::LoadU(d, row.use + i), zero), hn::Eq(bad, zero));
        use = hn::And(use, hn::Le(sigma, hn::Set(d, row.max_noise)));
        const V t[1] = {hn::Mul(sigma, hn::Set(d, 1.44269504088896341f))};
        V weight[1] = {hn::LoadU(d, row.source + i)};
        TimesExp2Minus(t, weight);
        hn::StoreU(hn::IfThenElseZero(use, weight[0]), d, row.weight + i);
    }
}

/// Between a row and its columns in the order of PlaneColumns; a whole vector of every remainder at
/// a time.
template <int stride, bool separate, class From, class To>
HWY_INLINE void MoveRow(const PlaneColumns& columns, From row, int x, int n, To apart)
{
    const D d;
    const int lanes = LaneCount();
    const std::ptrdiff_t segment = columns.segment;
    const auto move = [&](int i) {
        const std::ptrdiff_t at = columns.at(x + i);
        if constexpr (separate)
            apart[at] = row[i];
        else
            row[i] = apart[at];
    };
    int i = 0;
    for (; i < n && columns.phase(x + i) != 0; ++i) move(i);
    auto at = apart + (x + i - columns.x0) / stride;
    for (; i + stride * lanes <= n; i += stride * lanes, at += lanes) {
        V a, b, c;
        if constexpr (separate && stride == 2) {
            hn::LoadInterleaved2(d, row + i, a, b);
            hn::StoreU(a, d, at);
            hn::StoreU(b, d, at + segment);
        } else if constexpr (separate) {
            hn::LoadInterleaved3(d, row + i, a, b, c);
            hn::StoreU(a, d, at);
            hn::StoreU(b, d, at + segment);
            hn::StoreU(c, d, at + 2 * segment);
        } else if constexpr (stride == 2) {
            hn::StoreInterleaved2(hn::LoadU(d, at), hn::LoadU(d, at + segment), d, row + i);
        } else {
            hn::StoreInterleaved3(hn::LoadU(d, at), hn::LoadU(d, at + segment),
                                  hn::LoadU(d, at + 2 * segment), d, row + i);
        }
    }
    for (; i < n; ++i) move(i);
}

void SeparateRow(const PlaneColumns& columns, const float* from, int x, int n, float* to)
{
    if (columns.stride == 2)
        MoveRow<2, true>(columns, from, x, n, to);
    else
        MoveRow<3, true>(columns, from, x, n, to);
}

void JoinRow(const PlaneColumns& columns, const float* from, int x, int n, float* to)
{
    if (columns.stride == 2)
        MoveRow<2, false>(columns, to, x, n, from);
    else
        MoveRow<3, false>(columns, to, x, n, from);
}

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace rayloom
{
HWY_EXPORT(SeparateRow);
HWY_EXPORT(JoinRow);
HWY_EXPORT(NormaliseRow);
HWY_EXPORT(MakeLightRow);
HWY_EXPORT(MakeSourceRow);

namespace
{

/// The pairs of one row, shares of 1; nothing at all is a part too.
void parts_row(const PlaneScene& s, ConstImageView parts, ImageView to, int x0, int y, int n)
{
    for (int i = 0; i < s.part_pairs; ++i) {
        std::copy_n(parts.ptr(2 * i, x0, y), n, to.ptr(s.parts + 2 * i, x0, y));
        std::copy_n(parts.ptr(2 * i + 1, x0, y), n, to.ptr(s.parts + 2 * i + 1, x0, y));
    }
    const float* const first_cover = to.ptr(s.parts + 1, x0, y);
    for (int x = 0; x < n; ++x) {
        if (s.part_pairs == 1 && first_cover[x] == 1.0f) continue;
        float total = 0.0f;
        for (int i = 0; i < s.part_pairs; ++i)
            total += std::max(0.0f, to.at(s.parts + 2 * i + 1, x0 + x, y));
        const bool covered = total > 0.0f && std::isfinite(total);
        for (int i = 0; i < s.part_pairs; ++i) {
            float& id = to.at(s.parts + 2 * i, x0 + x, y);
            float& cover = to.at(s.parts + 2 * i + 1, x0 + x, y);
            if (!covered) id = 0.0f;
            if (covered)
                cover = cover > 0.0f ? cover / total : 0.0f;
            else
                cover = i == 0 ? 1.0f : 0.0f;
        }
    }
}

/// A pixel's light is its radiance over the pivot, noise and all: the darker, the less it says.
void weight_by_pivot(ConstImageView pivot, int x0, int y, float* source, int n)
{
    for (int x = 0; x < n; ++x) {
        float most = 0.0f;
        for (int c = 0; c < pivot.channels(); ++c) most = std::max(most, pivot.at(c, x0 + x, y));
        source[x] *= std::sqrt(std::min(most, 1.0f));
    }
}

} // namespace

std::size_t plane_scene_bytes(const PlaneSettings& settings, int colours, int part_channels)
{
    constexpr int tile = 256; // of the size the engine likes
    const int side = tile + 2 * settings.max_radius;
    return ImageBuffer::bytes_for({0, 0, side + settings.stride * 2 * plane_tail, side},
                                  colours + 8 + part_channels);
}

PlaneScene make_plane_scene(const PlaneSettings& settings, const Region& part, const Region& data,
                            const PlaneGuides& guides, int colours)
{
    PlaneScene s;
    s.colours = colours;
    s.area = part.grown(Halo::all(settings.max_radius));
    s.known = s.area.intersect(data); // the columns that come on top of these are not asked for
    const int stride = settings.stride, over = s.area.x0 % stride;
    s.area.x0 -= over < 0 ? over + stride : over;
    const int longest = (s.area.width() + stride - 1) / stride;
    s.columns = {stride, s.area.x0, ImageBuffer::padded_width(longest + plane_tail)};
    s.has_normal = !guides.normal.empty();
    s.part_pairs =
        guides.parts.empty() ? 0 : std::min(guides.parts.channels() / 2, max_plane_parts);
    s.normal = s.source + 1;
    s.parts = s.normal + (s.has_normal ? 4 : 0);
    s.z = s.parts + 2 * s.part_pairs;
    s.light = s.z + colours;
    s.variance = s.light + 1;
    s.weight = s.variance + 1;
    const Region known = s.known;
    Region padded = s.area;
    padded.x1 = padded.x0 + stride * static_cast<int>(s.columns.segment);
    s.pixels = ImageBuffer(padded, colours > 0 ? s.weight + 1 : s.z);
    s.pixels.fill(0.0f);
    const ImageView to = s.pixels.view();
    for (int y = known.y0; y < known.y1; ++y) {
        float* const source = to.ptr(s.source, known.x0, y);
        if (guides.boundary.empty()) {
            std::fill_n(source, known.width(), 1.0f);
        } else {
            const float* const edge = guides.boundary.ptr(0, known.x0, y);
            for (int x = 0; x < known.width(); ++x) // NaN counts as a boundary
                source[x] = std::max(plane_boundary_weight, std::min(1.0f - edge[x], 1.0f));
        }
        if (!guides.pivot.empty())
            weight_by_pivot(guides.pivot, known.x0, y, source, known.width());
        if (s.has_normal) {
            std::array<float*, 4> n{};
            for (int c = 0; c < 4; ++c) {
                n[static_cast<std::size_t>(c)] = to.ptr(s.normal + c, known.x0, y);
                if (c < 3)
                    std::copy_n(guides.normal.ptr(c, known.x0, y), known.width(),
                                n[static_cast<std::size_t>(c)]);
            }
            if (HWY_DYNAMIC_DISPATCH(NormaliseRow)(n[0], n[1], n[2], n[3], known.width()))
                s.lacks_normals = true;
        }
        if (s.part_pairs > 0) parts_row(s, guides.parts, to, known.x0, y, known.width());
    }
    return s;
}

void add_plane_light(PlaneScene& s, const PlaneSettings& settings, const Region& data,
                     const PlaneGuides& guides)
{
    const ImageView to = s.pixels.view();
    const Region known = s.known;
    // Light, noise and use of all rows around, then their sums over five rows; zeros outside.
    Region wide = known.grown(Halo::all(near_radius));
    wide.x1 += plane_tail;
    ImageBuffer around(wide, 3 + s.colours), sums({wide.x0, 0, wide.x1, 1}, 3);
    around.fill(0.0f);
    const ImageView near = around.view();
    const Region read = known.grown(Halo::all(near_radius)).intersect(data);
    ImageBuffer extra({read.x0, 0, read.x1 + plane_tail, 1}, 6);
    LightRow row;
    row.colours = s.colours;
    row.variances = guides.variance.channels();
    row.marks = !guides.marked.empty();
    row.n = read.width();
    for (int y = read.y0; y < read.y1; ++y) {
        for (int c = 0; c < 3; ++c) {
            const auto k = static_cast<std::size_t>(c);
            float *const v = extra.view().row(c, 0), *const mark = extra.view().row(3 + c, 0);
            if (c < row.variances) std::copy_n(guides.variance.ptr(c, read.x0, y), row.n, v);
            row.variance[k] = v;
            if (c >= s.colours) continue;
            row.z[k] = near.ptr(3 + c, read.x0, y);
            std::copy_n(guides.image.ptr(c, read.x0, y), row.n, row.z[k]);
            if (row.marks) std::copy_n(guides.marked.ptr(c, read.x0, y), row.n, mark);
            row.marked[k] = mark;
        }
        row.light = near.ptr(0, read.x0, y);
        row.noise = near.ptr(1, read.x0, y);
        row.use = near.ptr(2, read.x0, y);
        HWY_DYNAMIC_DISPATCH(MakeLightRow)(row);
        // Whole vectors were written: what lies beyond the image is nothing again.
        for (int c = 0; c < near.channels(); ++c)
            std::fill_n(near.ptr(c, read.x1, y), wide.x1 - read.x1, 0.0f);
    }
    SourceRow source;
    source.max_noise = settings.max_noise;
    source.n = known.width();
    // Pixels on boundaries count as others do: guides tell both sides apart, and what is thin has
    // no other pixels.
    std::vector<float> own(static_cast<std::size_t>(source.n + plane_tail), 1.0f);
    source.source = own.data();
    for (int y = known.y0; y < known.y1; ++y) {
        for (int c = 0; c < s.colours; ++c)
            std::copy_n(near.ptr(3 + c, known.x0, y), known.width(), to.ptr(s.z + c, known.x0, y));
        std::copy_n(near.ptr(0, known.x0, y), known.width(), to.ptr(s.light, known.x0, y));
        std::copy_n(near.ptr(1, known.x0, y), known.width(), to.ptr(s.variance, known.x0, y));
        for (int c = 0; c < 3; ++c) {
            float* const sum = sums.view().row(c, 0);
            const float* const middle = near.row(c, y);
            std::copy_n(middle, wide.width(), sum);
            for (int dy = -near_radius; dy <= near_radius; ++dy) {
                if (dy == 0) continue;
                const float* const other = near.row(c, y + dy);
                for (int x = 0; x < wide.width(); ++x) sum[x] += other[x];
            }
        }
        source.light = sums.view().row(0, 0);
        source.noise = sums.view().row(1, 0);
        source.count = sums.view().row(2, 0);
        source.use = near.ptr(2, known.x0, y);
        if (!guides.pivot.empty()) {
            std::fill(own.begin(), own.end(), 1.0f);
            weight_by_pivot(guides.pivot, known.x0, y, own.data(), known.width());
        }
        source.weight = to.ptr(s.weight, known.x0, y);
        HWY_DYNAMIC_DISPATCH(MakeSourceRow)(source);
        std::fill_n(to.ptr(s.weight, known.x1, y), to.region().x1 - known.x1, 0.0f);
    }
}

void separate_row(const PlaneColumns& columns, const float* from, int x, int n, float* to)
{
    static_assert(max_plane_stride == 3);
    if (columns.stride == 1)
        std::copy_n(from, n, to + columns.at(x));
    else
        HWY_DYNAMIC_DISPATCH(SeparateRow)(columns, from, x, n, to);
}

void join_row(const PlaneColumns& columns, const float* from, int x, int n, float* to)
{
    if (columns.stride == 1)
        std::copy_n(from + columns.at(x), n, to);
    else
        HWY_DYNAMIC_DISPATCH(JoinRow)(columns, from, x, n, to);
}

void separate_columns(PlaneScene& s)
{
    const int width = s.area.width();
    if (s.columns.stride == 1) return;
    const ImageView pixels = s.pixels.view();
    std::vector<float> row(static_cast<std::size_t>(width));
    for (int y = s.area.y0; y < s.area.y1; ++y)
        for (int c = 0; c < pixels.channels(); ++c) {
            float* const to = pixels.row(c, y);
            std::copy_n(to, width, row.data());
            separate_row(s.columns, row.data(), s.area.x0, width, to);
            for (int phase = 0; phase < s.columns.stride; ++phase)
                std::fill(to + phase * s.columns.segment + s.columns.first(phase, s.area.x1),
                          to + (phase + 1) * s.columns.segment, 0.0f);
        }
}

std::vector<std::ptrdiff_t> column_steps(const PlaneColumns& columns, int reach)
{
    std::vector<std::ptrdiff_t> steps;
    const int middle = columns.column(0, reach + 1);
    for (int phase = 0; phase < columns.stride; ++phase)
        for (int dx = -reach; dx <= reach; ++dx)
            steps.push_back(columns.at(middle + phase + dx) - columns.at(middle + phase));
    return steps;
}

} // namespace rayloom
#endif
