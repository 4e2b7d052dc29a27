// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/planes_scene.h"

#include <algorithm>
#include <cmath>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "nodes/fuse/planes_fit_kernel.cpp"
#include <hwy/foreach_target.h>

#include "nodes/fuse/planes-inl.h"

#ifndef RAYLOOM_PLANES_FIT_KERNEL_SHARED
#define RAYLOOM_PLANES_FIT_KERNEL_SHARED
namespace rayloom
{
namespace
{

/// What equation 10 takes off for distance, log₂ e · (dx² + dy²) / r², at one radius.
struct FitRadius {
    int r = 0;
    std::vector<float> distance; ///< [dx² + dy² ≥ 0: (|dy|) · (r + 1) + |dx|]
};

struct FitJob {
    const PlaneSettings* settings = nullptr;
    const PlaneScene* scene = nullptr;
    const std::vector<FitRadius>* radii = nullptr;
    int y = 0;
    int phase = 0, first = 0, end = 0;     ///< columns, as places of scene->columns
    const std::ptrdiff_t* steps = nullptr; ///< to the column dx away, of this phase
    float* guide_weights = nullptr;        ///< scratch: (2·max + 1)² vectors
    float* results = nullptr;              ///< [channel][place]
    std::ptrdiff_t result_stride = 0;
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

/// Vectors that are worked on side by side.
constexpr int side_by_side = 4;

/// Weighted moments of deviations from the reference colour, with x and y counted away from the
/// centre: sums of a quadrant are sums of what is positive.
template <int C>
struct Moments {
    V s, sx, sy, sxx, sxy, syy, noise; ///< noise: Σ w²·variance
    V z[C], zx[C], zy[C];

    HWY_INLINE void Clear()
    {
        const D d;
        s = sx = sy = sxx = sxy = syy = noise = hn::Zero(d);
        for (int c = 0; c < C; ++c) z[c] = zx[c] = zy[c] = hn::Zero(d);
    }
};

/// Sums over a run of one row.
template <int C>
struct RowSums {
    V s, sx, sxx, noise, z[C], zx[C];
};

/// Moments of rows that come one after the other, the farthest first: Σ y·s is the sum of what has
/// been summed before each step, and Σ y·(y + 1)/2·s the sum of those.
template <int C>
struct Block {
    Moments<C> m; ///< syy holds Σ y·(y + 1)/2·s until Finish()

    HWY_INLINE void AddRow(const RowSums<C>& r)
    {
        m.s = hn::Add(m.s, r.s);
        m.sy = hn::Add(m.sy, m.s);
        m.syy = hn::Add(m.syy, m.sy);
        m.sx = hn::Add(m.sx, r.sx);
        m.sxy = hn::Add(m.sxy, m.sx);
        m.sxx = hn::Add(m.sxx, r.sxx);
        m.noise = hn::Add(m.noise, r.noise);
        for (int c = 0; c < C; ++c) {
            m.z[c] = hn::Add(m.z[c], r.z[c]);
            m.zy[c] = hn::Add(m.zy[c], m.z[c]);
            m.zx[c] = hn::Add(m.zx[c], r.zx[c]);
        }
    }
    HWY_INLINE void Finish() { m.syy = hn::Sub(hn::Add(m.syy, m.syy), m.sy); }
};

/// Adds moments counted leftwards and/or upwards to moments counted rightwards and downwards.
template <int C>
HWY_INLINE void AddMirrored(const Moments<C>& from, bool left, bool upper, Moments<C>& to)
{
    const auto add = [](bool minus, V a, V b)
                         HWY_ATTR { return minus ? hn::Sub(a, b) : hn::Add(a, b); };
    to.s = hn::Add(to.s, from.s);
    to.sx = add(left, to.sx, from.sx);
    to.sy = add(upper, to.sy, from.sy);
    to.sxx = hn::Add(to.sxx, from.sxx);
    to.sxy = add(left != upper, to.sxy, from.sxy);
    to.syy = hn::Add(to.syy, from.syy);
    to.noise = hn::Add(to.noise, from.noise);
    for (int c = 0; c < C; ++c) {
        to.z[c] = hn::Add(to.z[c], from.z[c]);
        to.zx[c] = add(left, to.zx[c], from.zx[c]);
        to.zy[c] = add(upper, to.zy[c], from.zy[c]);
    }
}

template <int C>
struct Plane {
    V a[C], b[C], c[C];
    V light;    ///< value at the centre, mean of the colours
    V variance; ///< of that value
};

/// The plane of least squares; the weighted mean where the pixels are too few or in a line.
template <int C>
HWY_INLINE void Solve(const Moments<C>& m, const V (&reference)[C], Plane<C>& plane)
{
    const D d;
    const V one = hn::Set(d, 1.0f);
    const M any = hn::Gt(m.s, hn::Zero(d));
    const V inverse = hn::IfThenElseZero(any, hn::Div(one, hn::IfThenElse(any, m.s, one)));
    const V x = hn::Mul(m.sx, inverse), y = hn::Mul(m.sy, inverse);
    const V xx = hn::Sub(m.sxx, hn::Mul(x, m.sx));
    const V xy = hn::Sub(m.sxy, hn::Mul(x, m.sy));
    const V yy = hn::Sub(m.syy, hn::Mul(y, m.sy));
    const V both = hn::Mul(xx, yy);
    const V det = hn::Sub(both, hn::Mul(xy, xy));
    const V spread = hn::Mul(m.s, hn::Set(d, 0.1f)); // a tenth of a squared pixel
    M fits = hn::And(hn::Gt(xx, spread), hn::Gt(yy, spread));
    // Two pixels, or many in a line, have no determinant.
    fits = hn::And(fits, hn::Gt(det, hn::Mul(both, hn::Set(d, 1e-2f))));
    const V inverse_det = hn::IfThenElseZero(fits, hn::Div(one, hn::IfThenElse(fits, det, one)));
    plane.light = hn::Zero(d);
    for (int c = 0; c < C; ++c) {
        const V zx = hn::Sub(m.zx[c], hn::Mul(x, m.z[c]));
        const V zy = hn::Sub(m.zy[c], hn::Mul(y, m.z[c]));
        plane.a[c] = hn::Mul(hn::Sub(hn::Mul(zx, yy), hn::Mul(zy, xy)), inverse_det);
        plane.b[c] = hn::Mul(hn::Sub(hn::Mul(zy, xx), hn::Mul(zx, xy)), inverse_det);
        const V tilt = hn::Add(hn::Mul(plane.a[c], x), hn::Mul(plane.b[c], y));
        plane.c[c] = hn::Add(hn::Sub(hn::Mul(m.z[c], inverse), tilt), reference[c]);
        plane.light = hn::Add(plane.light, plane.c[c]);
    }
    plane.light = hn::Mul(plane.light, hn::Set(d, 1.0f / C));
    const V lever = hn::Add(
        hn::Sub(hn::Mul(hn::Mul(x, x), yy), hn::Mul(hn::Set(d, 2.0f), hn::Mul(hn::Mul(x, y), xy))),
        hn::Mul(hn::Mul(y, y), xx));
    plane.variance = hn::Mul(hn::Mul(m.noise, inverse),
                             hn::Add(inverse, hn::Max(hn::Zero(d), hn::Mul(lever, inverse_det))));
}

template <int C>
HWY_INLINE void Keep(M mask, const Plane<C>& from, Plane<C>& to)
{
    for (int c = 0; c < C; ++c) {
        to.a[c] = hn::IfThenElse(mask, from.a[c], to.a[c]);
        to.b[c] = hn::IfThenElse(mask, from.b[c], to.b[c]);
        to.c[c] = hn::IfThenElse(mask, from.c[c], to.c[c]);
    }
}

/// The pixels of one vector of centres, and the sums of equation 10 over them.
template <int C>
class FitSums
{
public:
    /// `own` is channel 0 of the centres.
    FitSums(const FitJob& job, const float* own)
        : m_scene(*job.scene), m_weights(job.guide_weights), m_own(own), m_steps(job.steps),
          m_largest(job.settings->max_radius)
    {
        const D d;
        m_lanes = LaneCount();
        m_row = m_scene.pixels.view().row_stride();
        m_channel = m_scene.pixels.view().channel_stride();
        for (int c = 0; c < C; ++c) reference[c] = hn::LoadU(d, own + (m_scene.z + c) * m_channel);
        m_weight_sum = m_light_sum = m_noise_sum = hn::Zero(d);
    }

    V reference[C];

    /// Takes in the guides of all pixels beyond `from` and up to `to` away (−1: none so far).
    HWY_INLINE void Grow(int from, int to)
    {
        const D d;
        const Guide guide(m_scene, m_own);
        for (int dy = -to; dy <= to; ++dy) {
            const bool outside = std::abs(dy) > from;
            AddGuides(guide, dy, -to, outside ? to : -from - 1);
            if (!outside) AddGuides(guide, dy, from + 1, to);
        }
        if (from < 0) {
            // Whatever its guides are, the centre has itself.
            float* const own = weight_at(0, 0);
            const V was = hn::LoadU(d, own);
            const V now = hn::Max(was, hn::Set(d, plane_own_weight));
            hn::StoreU(now, d, own);
            const V more = hn::Sub(now, was);
            const V light = hn::LoadU(d, m_own + m_scene.light * m_channel);
            const V variance = hn::LoadU(d, m_own + m_scene.variance * m_channel);
            m_weight_sum = hn::Add(m_weight_sum, more);
            m_light_sum = hn::Add(m_light_sum, hn::Mul(more, light));
            m_noise_sum = hn::Add(m_noise_sum, hn::Mul(more, variance));
        }
    }

    /// Mean over the square, and what a difference from it is measured against.
    HWY_INLINE void SetRange(const PlaneSettings& set)
    {
        const D d;
        m_mean = hn::Div(m_light_sum, m_weight_sum);
        V scale = m_mean;
        if (set.range_scale == PlaneRange::noise)
            scale = hn::Add(scale, hn::Sqrt(hn::Div(m_noise_sum, m_weight_sum)));
        const M lit = hn::Gt(scale, hn::Zero(d));
        const V k = hn::Set(d, set.range * 1.44269504088896341f);
        m_range = hn::IfThenElseZero(lit, hn::Div(k, hn::IfThenElse(lit, scale, hn::Set(d, 1.0f))));
    }

    /// Moments of the square, and of its quadrants with x and y counted away from the centre.
    HWY_INLINE void Sum(const FitRadius& radius, Moments<C>& square, Moments<C> (&quadrant)[4])
    {
        Block<C> corner[4], column[2]; // as the quadrants; x = 0 below and above
        RowSums<C> left, middle, right;
        for (int upper = 0; upper < 2; ++upper) {
            Block<C>&r = corner[2 * upper], &l = corner[2 * upper + 1], &m = column[upper];
            r.m.Clear();
            l.m.Clear();
            m.m.Clear();
            for (int ay = radius.r; ay >= 1; --ay) {
                SumRow(radius, upper != 0 ? -ay : ay, left, middle, right);
                r.AddRow(right);
                l.AddRow(left);
                m.AddRow(middle);
            }
            r.Finish();
            l.Finish();
            m.Finish();
        }
        SumRow(radius, 0, left, middle, right);
        Moments<C> centre, row[2]; // y = 0, right and left
        FromRow(middle, centre);
        FromRow(right, row[0]);
        FromRow(left, row[1]);
        square = centre;
        for (int q = 0; q < 4; ++q) {
            const bool is_left = (q & 1) != 0, is_upper = (q & 2) != 0;
            quadrant[q] = corner[q].m;
            AddMirrored(quadrant[q], is_left, is_upper, square);
            AddMirrored(row[is_left ? 1 : 0], false, false, quadrant[q]);
            AddMirrored(column[is_upper ? 1 : 0].m, false, false, quadrant[q]);
            AddMirrored(centre, false, false, quadrant[q]);
        }
        for (int side = 0; side < 2; ++side) {
            AddMirrored(row[side], side != 0, false, square);
            AddMirrored(column[side].m, false, side != 0, square);
        }
    }

private:
    float* weight_at(int dx, int dy) const
    {
        return m_weights + ((dy + m_largest) * (2 * m_largest + 1) + dx + m_largest) * m_lanes;
    }

    HWY_INLINE void AddGuides(const Guide& guide, int dy, int from, int to)
    {
        const D d;
        V weight_sum = m_weight_sum, light_sum = m_light_sum, noise_sum = m_noise_sum;
        const std::ptrdiff_t weight = m_scene.weight * m_channel, light = m_scene.light * m_channel,
                             variance = m_scene.variance * m_channel;
        float* store = weight_at(from, dy);
        const float* const row = m_own + dy * m_row;
        const std::ptrdiff_t* step = m_steps + from;
        const auto add = [&](V w, const float* pixel) HWY_ATTR {
            weight_sum = hn::Add(weight_sum, w);
            light_sum = hn::Add(light_sum, hn::Mul(w, hn::LoadU(d, pixel + light)));
            noise_sum = hn::Add(noise_sum, hn::Mul(w, hn::LoadU(d, pixel + variance)));
        };
        int n = to - from + 1;
        for (; n >= 2; n -= 2, step += 2, store += 2 * m_lanes) {
            const float *const one = row + step[0], *const other = row + step[1];
            const V first = hn::Mul(guide.With(one), hn::LoadU(d, one + weight));
            const V second = hn::Mul(guide.With(other), hn::LoadU(d, other + weight));
            hn::StoreU(first, d, store);
            hn::StoreU(second, d, store + m_lanes);
            add(first, one);
            add(second, other);
        }
        if (n > 0) {
            const float* const at = row + *step;
            const V last = hn::Mul(guide.With(at), hn::LoadU(d, at + weight));
            hn::StoreU(last, d, store);
            add(last, at);
        }
        m_weight_sum = weight_sum;
        m_light_sum = light_sum;
        m_noise_sum = noise_sum;
    }

    /// Sums over the pixels of one row and one side, the farthest first: as in Block, Σ x·w is the
    /// sum of what has been summed before each step.
    struct Run {
        V s, sx, triangle, noise, z[C], zx[C];
    };

    /// Adds N pixels of a row, from the one `steps` leads to on, `step` apart.
    template <int N>
    HWY_INLINE void AddPixels(const float* row, const std::ptrdiff_t* steps, const float* guide,
                              const float* distance, int step, Run& run) const
    {
        const D d;
        const float* at[N];
        for (int i = 0; i < N; ++i) at[i] = row + steps[i * step];
        const std::ptrdiff_t light = m_scene.light * m_channel,
                             variance = m_scene.variance * m_channel, z = m_scene.z * m_channel;
        V t[N], w[N];
        for (int i = 0; i < N; ++i) w[i] = hn::LoadU(d, guide + i * step * m_lanes);
        V most = w[0];
        for (int i = 1; i < N; ++i) most = hn::Max(most, w[i]);
        if (hn::AllFalse(d, hn::Gt(most, hn::Zero(d)))) {
            // Other objects: only the sums of sums go on.
            for (int i = 0; i < N; ++i) {
                run.sx = hn::Add(run.sx, run.s);
                run.triangle = hn::Add(run.triangle, run.sx);
                for (int c = 0; c < C; ++c) run.zx[c] = hn::Add(run.zx[c], run.z[c]);
            }
            return;
        }
        for (int i = 0; i < N; ++i) t[i] = hn::Sub(hn::LoadU(d, at[i] + light), m_mean);
        for (int i = 0; i < N; ++i) t[i] = hn::Mul(hn::Abs(t[i]), m_range);
        for (int i = 0; i < N; ++i) t[i] = hn::Add(t[i], hn::Set(d, distance[-i]));
        TimesExp2Minus(t, w);
        for (int i = 0; i < N; ++i) {
            run.s = hn::Add(run.s, w[i]);
            run.sx = hn::Add(run.sx, run.s);
            run.triangle = hn::Add(run.triangle, run.sx);
            run.noise =
                hn::Add(run.noise, hn::Mul(hn::Mul(w[i], w[i]), hn::LoadU(d, at[i] + variance)));
            for (int c = 0; c < C; ++c) {
                const V value = hn::LoadU(d, at[i] + z + c * m_channel);
                run.z[c] = hn::Add(run.z[c], hn::Mul(w[i], hn::Sub(value, reference[c])));
                run.zx[c] = hn::Add(run.zx[c], run.z[c]);
            }
        }
    }

    /// The pixels on one side of the centre's column, `outwards` ±1.
    HWY_INLINE void SumRun(const FitRadius& radius, int dy, int outwards, RowSums<C>& sums) const
    {
        const D d;
        const V zero = hn::Zero(d);
        Run run{zero, zero, zero, zero, {}, {}};
        for (int c = 0; c < C; ++c) run.z[c] = run.zx[c] = zero;
        const int r = radius.r;
        const float* distance = radius.distance.data() + std::abs(dy) * (r + 1) + r;
        const float* guide = weight_at(outwards * r, dy);
        const float* const row = m_own + dy * m_row;
        const std::ptrdiff_t* steps = m_steps + outwards * r;
        int n = r;
        for (; n >= side_by_side; n -= side_by_side) {
            AddPixels<side_by_side>(row, steps, guide, distance, -outwards, run);
            distance -= side_by_side;
            guide -= outwards * m_lanes * side_by_side;
            steps -= outwards * side_by_side;
        }
        if (n == 3) AddPixels<3>(row, steps, guide, distance, -outwards, run);
        if (n == 2) AddPixels<2>(row, steps, guide, distance, -outwards, run);
        if (n == 1) AddPixels<1>(row, steps, guide, distance, -outwards, run);
        sums.s = run.s;
        sums.sx = run.sx;
        sums.sxx = hn::Sub(hn::Add(run.triangle, run.triangle), run.sx);
        sums.noise = run.noise;
        for (int c = 0; c < C; ++c) {
            sums.z[c] = run.z[c];
            sums.zx[c] = run.zx[c];
        }
    }

    HWY_INLINE void SumRow(const FitRadius& radius, int dy, RowSums<C>& left, RowSums<C>& middle,
                           RowSums<C>& right) const
    {
        SumRun(radius, dy, -1, left);
        SumRun(radius, dy, 1, right);
        SumMiddle(radius, dy, middle);
    }

    /// The pixel in the centre's column.
    HWY_INLINE void SumMiddle(const FitRadius& radius, int dy, RowSums<C>& sums) const
    {
        const V zero = hn::Zero(D());
        Run run{zero, zero, zero, zero, {}, {}};
        for (int c = 0; c < C; ++c) run.z[c] = run.zx[c] = zero;
        AddPixels<1>(m_own + dy * m_row, m_steps, weight_at(0, dy),
                     radius.distance.data() + std::abs(dy) * (radius.r + 1), 0, run);
        sums.s = run.s;
        sums.noise = run.noise;
        sums.sx = sums.sxx = zero;
        for (int c = 0; c < C; ++c) {
            sums.z[c] = run.z[c];
            sums.zx[c] = zero;
        }
    }

    static HWY_INLINE void FromRow(const RowSums<C>& row, Moments<C>& m)
    {
        m.Clear();
        m.s = row.s;
        m.sx = row.sx;
        m.sxx = row.sxx;
        m.noise = row.noise;
        for (int c = 0; c < C; ++c) {
            m.z[c] = row.z[c];
            m.zx[c] = row.zx[c];
        }
    }

    const PlaneScene& m_scene;
    float* m_weights;
    const float* m_own;
    const std::ptrdiff_t* m_steps;
    int m_largest, m_lanes = 0;
    std::ptrdiff_t m_row = 0, m_channel = 0;
    V m_weight_sum, m_light_sum, m_noise_sum, m_mean, m_range;
};

/// The centres that grow beyond settings.dense: those of the lattice, and those no neighbour on it
/// can stand in for; none that counts for nothing.
M GoOn(const FitJob& job, const float* own)
{
    const D d;
    const PlaneScene& scene = *job.scene;
    const ConstImageView view = scene.pixels.view();
    const int stride = scene.columns.stride, over = job.y % stride;
    const int down = over < 0 ? over + stride : over;
    const std::ptrdiff_t source = scene.source * view.channel_stride();
    const V open = hn::LoadU(d, own + source);
    const M counts = hn::Gt(open, hn::Zero(d));
    if (job.phase == 0 && down == 0) return counts;
    const Guide guide(scene, own);
    V best = hn::Zero(d);
    for (int v = 0; v < (down > 0 ? 2 : 1); ++v)
        for (int u = 0; u < (job.phase > 0 ? 2 : 1); ++u) {
            const float* const other =
                own + (v * stride - down) * view.row_stride() + job.steps[u * stride - job.phase];
            best = hn::Max(best, hn::Mul(guide.With(other), hn::LoadU(d, other + source)));
        }
    return hn::And(counts, hn::Lt(best, hn::Mul(open, hn::Set(d, plane_stand_in))));
}

template <int C>
void FitRow(const FitJob& job)
{
    const D d;
    const int lanes = LaneCount();
    const PlaneSettings& set = *job.settings;
    const V one = hn::Set(d, 1.0f), zero = hn::Zero(d);
    const std::ptrdiff_t begin = job.phase * job.scene->columns.segment;
    const float* const row = job.scene->pixels.view().row(0, job.y) + begin;
    for (int place = job.first; place < job.end; place += lanes) {
        FitSums<C> sums(job, row + place);
        Plane<C> best[5];
        for (auto& p : best)
            for (int c = 0; c < C; ++c) p.a[c] = p.b[c] = p.c[c] = zero;
        V radius = zero, noise = zero;
        // Lanes beyond the region have nothing to find out.
        M growing = hn::FirstN(d, static_cast<std::size_t>(std::min(lanes, job.end - place)));
        M first = hn::Eq(zero, zero), left_out = hn::Lt(one, zero);
        int known = -1;
        bool thinned = set.stride == 1;
        for (const FitRadius& step : *job.radii) {
            if (!thinned && known >= 0 && step.r > set.dense) {
                const M on = GoOn(job, row + place);
                left_out = hn::AndNot(on, growing);
                growing = hn::And(on, growing);
                if (hn::AllFalse(d, growing)) break;
                thinned = true;
            }
            sums.Grow(known, step.r);
            known = step.r;
            sums.SetRange(set);
            Moments<C> square, quadrant[4];
            sums.Sum(step, square, quadrant);

            Plane<C> plane[5];
            Solve(square, sums.reference, plane[0]);
            const V allowed = hn::Mul(hn::Abs(plane[0].light), hn::Set(d, set.variation));
            M uneven = hn::Lt(one, zero);
            for (int q = 0; q < 4; ++q) {
                Plane<C>& part = plane[q + 1];
                Solve(quadrant[q], sums.reference, part);
                for (int c = 0; c < C; ++c) {
                    if ((q & 1) != 0) part.a[c] = hn::Neg(part.a[c]);
                    if ((q & 2) != 0) part.b[c] = hn::Neg(part.b[c]);
                }
                const V error = hn::Mul(hn::Set(d, set.confidence), hn::Sqrt(part.variance));
                const V difference = hn::Abs(hn::Sub(plane[0].light, part.light));
                uneven = hn::Or(uneven, hn::Gt(difference, hn::Add(allowed, error)));
            }
            // An uneven square is not taken, unless it is the smallest.
            const M taken = hn::Or(first, hn::AndNot(uneven, growing));
            first = hn::Lt(one, zero);
            const V error = hn::Sqrt(plane[0].variance);
            for (int p = 0; p < 5; ++p) Keep(taken, plane[p], best[p]);
            radius = hn::IfThenElse(taken, hn::Set(d, static_cast<float>(step.r)), radius);
            const V level = hn::Abs(plane[0].light);
            const M lit = hn::Gt(level, zero);
            const V relative =
                hn::IfThenElseZero(lit, hn::Div(error, hn::IfThenElse(lit, level, one)));
            noise = hn::IfThenElse(taken, relative, noise);
            const M noisy = hn::Gt(error, hn::Mul(level, hn::Set(d, set.target_noise)));
            growing = hn::And(hn::AndNot(uneven, growing), noisy);
            if (hn::AllFalse(d, growing)) break;
        }

        float* const to = job.results + begin + place;
        const std::ptrdiff_t stride = job.result_stride;
        hn::StoreU(hn::IfThenElse(left_out, zero, radius), d, to);
        hn::StoreU(noise, d, to + stride);
        for (int p = 0; p < 5; ++p)
            for (int c = 0; c < C; ++c) {
                float* const at = to + (2 + (p * C + c) * 3) * stride;
                hn::StoreU(best[p].a[c], d, at);
                hn::StoreU(best[p].b[c], d, at + stride);
                hn::StoreU(best[p].c[c], d, at + 2 * stride);
            }
    }
}

void FitOne(const FitJob& job) { FitRow<1>(job); }
void FitThree(const FitJob& job) { FitRow<3>(job); }
std::size_t VectorLanes() { return hn::Lanes(D()); }

} // namespace
} // namespace HWY_NAMESPACE
} // namespace rayloom
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace rayloom
{
HWY_EXPORT(FitOne);
HWY_EXPORT(FitThree);
HWY_EXPORT(VectorLanes);

std::vector<int> plane_radii(const PlaneSettings& settings)
{
    std::vector<int> radii{settings.min_radius};
    while (radii.back() < settings.max_radius) {
        const int r = radii.back();
        int next = r + std::max(1, static_cast<int>(settings.growth * static_cast<float>(r)));
        // A last step of a few pixels would cost as much as the one before and gain little.
        if (settings.growth > 0.0f && 6 * next > 5 * settings.max_radius)
            next = settings.max_radius;
        radii.push_back(std::min(next, settings.max_radius));
    }
    return radii;
}

std::size_t fit_planes_scratch(const PlaneSettings& settings, int colours, int part_channels)
{
    const std::size_t side = 2 * static_cast<std::size_t>(settings.max_radius) + 1;
    return 2 * plane_scene_bytes(settings, colours, part_channels) +
           side * side * plane_tail * sizeof(float);
}

double fit_planes(const PlaneSettings& settings, const Region& data, const PlaneGuides& guides,
                  ImageView out, const std::function<void()>& each_row)
{
    const Region& part = out.region();
    const int colours = guides.image.channels(), channels = plane_coefficients(colours);
    PlaneScene scene = make_plane_scene(settings, part, data, guides, colours);
    add_plane_light(scene, settings, data, guides);
    separate_columns(scene);
    std::vector<FitRadius> radii;
    for (const int r : plane_radii(settings)) {
        FitRadius step{r, {}};
        for (int y = 0; y <= r; ++y)
            for (int x = 0; x <= r; ++x)
                step.distance.push_back(static_cast<float>(x * x + y * y) * 1.44269504f /
                                        static_cast<float>(r * r));
        radii.push_back(std::move(step));
    }
    const std::size_t side = 2 * static_cast<std::size_t>(settings.max_radius) + 1;
    std::vector<float> weights(side * side * HWY_DYNAMIC_DISPATCH(VectorLanes)());
    FitJob job;
    job.settings = &settings;
    job.scene = &scene;
    job.radii = &radii;
    const PlaneColumns& columns = scene.columns;
    const std::vector<std::ptrdiff_t> steps = column_steps(columns, settings.max_radius);
    job.guide_weights = weights.data();
    job.result_stride = scene.pixels.region().width();
    std::vector<float> results(static_cast<std::size_t>(channels) *
                               static_cast<std::size_t>(job.result_stride));
    job.results = results.data();
    double chosen = 0.0;
    for (int y = part.y0; y < part.y1; ++y) {
        each_row();
        job.y = y;
        for (job.phase = 0; job.phase < columns.stride; ++job.phase) {
            job.first = columns.first(job.phase, part.x0);
            job.end = columns.first(job.phase, part.x1);
            job.steps =
                steps.data() + job.phase * (2 * settings.max_radius + 1) + settings.max_radius;
            if (colours == 1)
                HWY_DYNAMIC_DISPATCH(FitOne)(job);
            else
                HWY_DYNAMIC_DISPATCH(FitThree)(job);
        }
        for (int c = 0; c < channels; ++c)
            join_row(columns, job.results + c * job.result_stride, part.x0, part.width(),
                     out.row(c, y));
        for (const float r : out.row_span(0, y)) chosen += static_cast<double>(r);
    }
    return chosen;
}

} // namespace rayloom
#endif
