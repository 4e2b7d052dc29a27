// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/planes_kernel.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "nodes/fuse/planes_kernel.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef RAYLOOM_PLANES_KERNEL_SHARED
#define RAYLOOM_PLANES_KERNEL_SHARED
namespace rayloom
{
namespace
{

/// Columns beyond the right edge that whole vectors may touch; at least a vector of any target.
constexpr int plane_tail = 64;
/// A pixel that lies on a boundary still has itself.
constexpr float own_weight = 1e-3f;

/// Planes of guides around the centres, zeros outside the image.
struct PlaneScene {
    ImageBuffer pixels;
    int z = 0, light = 0, source = 0, variance = 0, normal = 0, parts = 0; ///< first channels
    int colours = 0;
    bool has_normal = false;
    int part_pairs = 0;
};

struct FitJob {
    const PlaneSettings* settings = nullptr;
    const PlaneScene* scene = nullptr;
    Region part;
    int y = 0;
    float* guide_weights = nullptr; ///< scratch: (2·max + 1)² vectors
    float* results = nullptr;       ///< [channel][width + tail]
    std::ptrdiff_t stride = 0;
};

struct FuseJob {
    const PlaneSettings* settings = nullptr;
    const PlaneScene* scene = nullptr;
    ConstImageView coefficients; ///< padded; radius −1 outside the image
    Region part;
    int y = 0, largest = 0;
    float* results = nullptr; ///< [channel][width + tail]
    std::ptrdiff_t stride = 0;
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

/// e^−t for t ≥ 0; relative error below 2e-7, 0 beyond t = 87.
HWY_INLINE V ExpMinus(V t)
{
    const D d;
    const hn::RebindToSigned<D> di;
    const V x = hn::Mul(hn::Min(t, hn::Set(d, 87.0f)), hn::Set(d, -1.44269504088896341f));
    const V n = hn::Round(x);
    const V f = hn::Mul(hn::Sub(x, n), hn::Set(d, 0.693147180559945309f));
    V p = hn::Set(d, 1.0f / 720.0f);
    p = hn::Add(hn::Mul(p, f), hn::Set(d, 1.0f / 120.0f));
    p = hn::Add(hn::Mul(p, f), hn::Set(d, 1.0f / 24.0f));
    p = hn::Add(hn::Mul(p, f), hn::Set(d, 1.0f / 6.0f));
    p = hn::Add(hn::Mul(p, f), hn::Set(d, 0.5f));
    p = hn::Add(hn::Mul(p, f), hn::Set(d, 1.0f));
    p = hn::Add(hn::Mul(p, f), hn::Set(d, 1.0f));
    const auto exponent = hn::ShiftLeft<23>(hn::Add(hn::ConvertTo(di, n), hn::Set(di, 127)));
    const V result = hn::Mul(p, hn::BitCast(d, exponent));
    return hn::IfThenElseZero(hn::Lt(t, hn::Set(d, 87.0f)), result);
}

/// w_n · w_part of pixels at (x, y) with those at (x + dx, y + dy).
HWY_INLINE V GuideWeight(const PlaneScene& s, ConstImageView v, int x, int y, int dx, int dy)
{
    const D d;
    V w = hn::Set(d, 1.0f);
    if (s.has_normal) {
        V dot = hn::Zero(d);
        for (int c = 0; c < 4; ++c)
            dot = hn::Add(dot, hn::Mul(hn::LoadU(d, v.ptr(s.normal + c, x, y)),
                                       hn::LoadU(d, v.ptr(s.normal + c, x + dx, y + dy))));
        const V square = hn::Mul(dot, dot);
        w = hn::IfThenElseZero(hn::Gt(dot, hn::Set(d, 0.5f)), hn::Mul(square, square));
    }
    if (s.part_pairs > 0) {
        V shared = hn::Zero(d);
        for (int i = 0; i < s.part_pairs; ++i) {
            const V id = hn::LoadU(d, v.ptr(s.parts + 2 * i, x, y));
            const V cover = hn::LoadU(d, v.ptr(s.parts + 2 * i + 1, x, y));
            for (int j = 0; j < s.part_pairs; ++j) {
                const V other = hn::LoadU(d, v.ptr(s.parts + 2 * j, x + dx, y + dy));
                const V other_cover = hn::LoadU(d, v.ptr(s.parts + 2 * j + 1, x + dx, y + dy));
                shared = hn::Add(
                    shared, hn::IfThenElseZero(hn::Eq(id, other), hn::Min(cover, other_cover)));
            }
        }
        w = hn::Mul(w, hn::Min(shared, hn::Set(d, 1.0f)));
    }
    return w;
}

/// Weighted moments of deviations from the reference colour.
template <int C>
struct Moments {
    V s, sx, sy, sxx, sxy, syy, n, noise; ///< noise: Σ w²·variance
    V z[C], zx[C], zy[C];

    HWY_INLINE void Clear()
    {
        const D d;
        s = sx = sy = sxx = sxy = syy = n = noise = hn::Zero(d);
        for (int c = 0; c < C; ++c) z[c] = zx[c] = zy[c] = hn::Zero(d);
    }
};

/// Sums over a run of one row; the row's height comes in when they are added to Moments.
template <int C>
struct RowSums {
    V s, sx, sxx, n, noise, z[C], zx[C];

    HWY_INLINE void Clear()
    {
        const D d;
        s = sx = sxx = n = noise = hn::Zero(d);
        for (int c = 0; c < C; ++c) z[c] = zx[c] = hn::Zero(d);
    }
};

template <int C>
HWY_INLINE void AddRow(Moments<C>& m, const RowSums<C>& r, float dy)
{
    const D d;
    const V y = hn::Set(d, dy);
    m.s = hn::Add(m.s, r.s);
    m.sx = hn::Add(m.sx, r.sx);
    m.sxx = hn::Add(m.sxx, r.sxx);
    const V sy = hn::Mul(r.s, y);
    m.sy = hn::Add(m.sy, sy);
    m.syy = hn::Add(m.syy, hn::Mul(sy, y));
    m.sxy = hn::Add(m.sxy, hn::Mul(r.sx, y));
    m.n = hn::Add(m.n, r.n);
    m.noise = hn::Add(m.noise, r.noise);
    for (int c = 0; c < C; ++c) {
        m.z[c] = hn::Add(m.z[c], r.z[c]);
        m.zx[c] = hn::Add(m.zx[c], r.zx[c]);
        m.zy[c] = hn::Add(m.zy[c], hn::Mul(r.z[c], y));
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
    fits = hn::And(fits, hn::Gt(det, hn::Mul(both, hn::Set(d, 1e-2f))));
    fits = hn::And(fits, hn::Gt(m.n, hn::Set(d, 2.5f)));
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
    to.light = hn::IfThenElse(mask, from.light, to.light);
    to.variance = hn::IfThenElse(mask, from.variance, to.variance);
}

template <int C>
void FitRow(const FitJob& job)
{
    const D d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const PlaneSettings& set = *job.settings;
    const PlaneScene& scene = *job.scene;
    const ConstImageView v = scene.pixels.view();
    const int y = job.y, side = 2 * set.max_radius + 1;
    const V one = hn::Set(d, 1.0f), zero = hn::Zero(d);
    float* const weights = job.guide_weights;
    const auto weight_at = [&](int dx, int dy) HWY_ATTR {
        return weights + ((dy + set.max_radius) * side + dx + set.max_radius) * lanes;
    };

    for (int x = job.part.x0; x < job.part.x1; x += lanes) {
        V reference[C];
        for (int c = 0; c < C; ++c) reference[c] = hn::LoadU(d, v.ptr(scene.z + c, x, y));
        // Guides and the plain mean take in one ring of pixels at a time.
        V weight_sum = zero, light_sum = zero, variance_sum = zero;
        const auto add_pixel = [&](int dx, int dy) HWY_ATTR {
            const V light = hn::LoadU(d, v.ptr(scene.light, x + dx, y + dy));
            V w = hn::Mul(GuideWeight(scene, v, x, y, dx, dy),
                          hn::LoadU(d, v.ptr(scene.source, x + dx, y + dy)));
            if (dx == 0 && dy == 0) w = hn::Max(w, hn::Set(d, own_weight));
            hn::StoreU(w, d, weight_at(dx, dy));
            weight_sum = hn::Add(weight_sum, w);
            light_sum = hn::Add(light_sum, hn::Mul(w, light));
            variance_sum = hn::Add(variance_sum,
                                   hn::Mul(w, hn::LoadU(d, v.ptr(scene.variance, x + dx, y + dy))));
        };
        const auto add_ring = [&](int r) HWY_ATTR {
            for (int dx = -r; dx <= r; ++dx) {
                add_pixel(dx, -r);
                if (r > 0) add_pixel(dx, r);
            }
            for (int dy = -r + 1; dy < r; ++dy) {
                add_pixel(-r, dy);
                add_pixel(r, dy);
            }
        };
        for (int r = 0; r < set.min_radius; ++r) add_ring(r);

        Plane<C> best, best_quadrant[4];
        V radius = hn::Set(d, static_cast<float>(set.min_radius)), noise = zero;
        M growing = hn::Lt(zero, one);
        for (int r = set.min_radius; r <= set.max_radius; ++r) {
            add_ring(r);
            const V mean = hn::Div(light_sum, weight_sum);
            V scale = mean;
            if (set.range_scale == PlaneRange::noise)
                scale = hn::Add(scale, hn::Sqrt(hn::Div(variance_sum, weight_sum)));
            const M lit = hn::Gt(scale, zero);
            const V range = hn::IfThenElseZero(
                lit, hn::Div(hn::Set(d, set.range), hn::IfThenElse(lit, scale, one)));
            const float per_square = 1.0f / static_cast<float>(r * r);

            Moments<C> square, quadrant[4];
            square.Clear();
            for (auto& q : quadrant) q.Clear();
            for (int dy = -r; dy <= r; ++dy) {
                RowSums<C> run[3]; // left, middle, right
                for (int side_of = 0; side_of < 3; ++side_of) {
                    RowSums<C>& sums = run[side_of];
                    sums.Clear();
                    const int begin = side_of == 0 ? -r : side_of == 1 ? 0 : 1;
                    const int end = side_of == 0 ? -1 : side_of == 1 ? 0 : r;
                    for (int dx = begin; dx <= end; ++dx) {
                        const V light = hn::LoadU(d, v.ptr(scene.light, x + dx, y + dy));
                        const V t =
                            hn::Add(hn::Mul(hn::Abs(hn::Sub(light, mean)), range),
                                    hn::Set(d, static_cast<float>(dx * dx + dy * dy) * per_square));
                        const V guide = hn::LoadU(d, weight_at(dx, dy));
                        const V w = hn::Mul(guide, ExpMinus(t));
                        const V fx = hn::Set(d, static_cast<float>(dx));
                        const V wx = hn::Mul(w, fx);
                        sums.s = hn::Add(sums.s, w);
                        sums.sx = hn::Add(sums.sx, wx);
                        sums.sxx = hn::Add(sums.sxx, hn::Mul(wx, fx));
                        sums.n = hn::Add(sums.n,
                                         hn::IfThenElseZero(hn::Gt(guide, hn::Set(d, 1e-6f)), one));
                        const V variance = hn::LoadU(d, v.ptr(scene.variance, x + dx, y + dy));
                        sums.noise = hn::Add(sums.noise, hn::Mul(hn::Mul(w, w), variance));
                        for (int c = 0; c < C; ++c) {
                            const V z = hn::Sub(hn::LoadU(d, v.ptr(scene.z + c, x + dx, y + dy)),
                                                reference[c]);
                            sums.z[c] = hn::Add(sums.z[c], hn::Mul(w, z));
                            sums.zx[c] = hn::Add(sums.zx[c], hn::Mul(wx, z));
                        }
                    }
                }
                const auto fy = static_cast<float>(dy);
                for (const auto& sums : run) AddRow(square, sums, fy);
                for (int q = 0; q < 4; ++q) {
                    const bool left = (q & 1) != 0, upper = (q & 2) != 0;
                    if (upper ? dy > 0 : dy < 0) continue;
                    AddRow(quadrant[q], run[1], fy);
                    AddRow(quadrant[q], run[left ? 0 : 2], fy);
                }
            }

            Plane<C> plane, plane_quadrant[4];
            Solve(square, reference, plane);
            const V allowed = hn::Mul(hn::Abs(plane.light), hn::Set(d, set.variation));
            M uneven = hn::Lt(one, zero);
            for (int q = 0; q < 4; ++q) {
                Solve(quadrant[q], reference, plane_quadrant[q]);
                const V error =
                    hn::Mul(hn::Set(d, set.confidence), hn::Sqrt(plane_quadrant[q].variance));
                const V difference = hn::Abs(hn::Sub(plane.light, plane_quadrant[q].light));
                uneven = hn::Or(uneven, hn::Gt(difference, hn::Add(allowed, error)));
            }
            // An uneven square is not taken, unless it is the smallest.
            const M taken = r == set.min_radius ? growing : hn::AndNot(uneven, growing);
            const V error = hn::Sqrt(plane.variance);
            Keep(taken, plane, best);
            for (int q = 0; q < 4; ++q) Keep(taken, plane_quadrant[q], best_quadrant[q]);
            radius = hn::IfThenElse(taken, hn::Set(d, static_cast<float>(r)), radius);
            const V level = hn::Abs(plane.light);
            const M lit_plane = hn::Gt(level, zero);
            noise = hn::IfThenElse(
                taken,
                hn::IfThenElseZero(lit_plane,
                                   hn::Div(error, hn::IfThenElse(lit_plane, level, one))),
                noise);
            const M noisy = hn::Gt(error, hn::Mul(level, hn::Set(d, set.target_noise)));
            growing = hn::And(hn::AndNot(uneven, growing), noisy);
            if (hn::AllFalse(d, growing)) break;
        }

        float* const to = job.results + (x - job.part.x0);
        hn::StoreU(radius, d, to);
        hn::StoreU(noise, d, to + job.stride);
        for (int p = 0; p < 5; ++p) {
            const Plane<C>& plane = p == 0 ? best : best_quadrant[p - 1];
            for (int c = 0; c < C; ++c) {
                float* const at = to + (2 + (p * C + c) * 3) * job.stride;
                hn::StoreU(plane.a[c], d, at);
                hn::StoreU(plane.b[c], d, at + job.stride);
                hn::StoreU(plane.c[c], d, at + 2 * job.stride);
            }
        }
    }
}

/// Adds one quadrant's blend of one centre, equations 11 to 13.
template <int C>
HWY_INLINE void AddPlane(const ConstImageView& k, int q, int cx, int cy, float dx, float dy,
                         const V (&whole)[C], V whole_light, V guide, bool own, PlaneBlend blend,
                         V& weight_sum, V (&sum)[C])
{
    const D d;
    const V one = hn::Set(d, 1.0f), zero = hn::Zero(d);
    V part[C];
    V part_light = zero;
    for (int c = 0; c < C; ++c) {
        const int first = 2 + ((q + 1) * C + c) * 3;
        part[c] = hn::Add(hn::Add(hn::Mul(hn::LoadU(d, k.ptr(first, cx, cy)), hn::Set(d, dx)),
                                  hn::Mul(hn::LoadU(d, k.ptr(first + 1, cx, cy)), hn::Set(d, dy))),
                          hn::LoadU(d, k.ptr(first + 2, cx, cy)));
        part_light = hn::Add(part_light, part[c]);
    }
    const M positive = hn::And(hn::Gt(whole_light, zero), hn::Gt(part_light, zero));
    const V low = hn::Min(whole_light, part_light);
    const V high = hn::IfThenElse(positive, hn::Max(whole_light, part_light), one);
    V ratio = hn::IfThenElseZero(positive, hn::Div(low, high));
    ratio = hn::Mul(ratio, ratio);
    ratio = hn::Mul(ratio, ratio);
    ratio = hn::Mul(ratio, ratio);
    V base = ratio;
    if (own) base = hn::Max(base, hn::Set(d, own_weight));
    const V weight = hn::Mul(guide, base);
    // (Z + w·Z_m) / (1 + w) with w the ratio (min) or one over it (max).
    const bool falls = blend == PlaneBlend::min;
    const V share = hn::Div(falls ? ratio : one, hn::Add(one, ratio));
    const V quadrant_share = hn::IfThenElseZero(positive, share);
    const M used = hn::Gt(weight, zero);
    weight_sum = hn::Add(weight_sum, weight);
    for (int c = 0; c < C; ++c) {
        const V value = hn::Add(whole[c], hn::Mul(quadrant_share, hn::Sub(part[c], whole[c])));
        sum[c] = hn::Add(sum[c], hn::IfThenElseZero(used, hn::Mul(weight, value)));
    }
}

template <int C>
void FuseRow(const FuseJob& job)
{
    const D d;
    const int lanes = static_cast<int>(hn::Lanes(d));
    const PlaneSettings& set = *job.settings;
    const PlaneScene& scene = *job.scene;
    const ConstImageView v = scene.pixels.view();
    const ConstImageView& k = job.coefficients;
    const int y = job.y;
    const V zero = hn::Zero(d);
    for (int x = job.part.x0; x < job.part.x1; x += lanes) {
        V weight_sum = zero;
        V sum[C];
        for (int c = 0; c < C; ++c) sum[c] = zero;
        for (int oy = -job.largest; oy <= job.largest; ++oy)
            for (int ox = -job.largest; ox <= job.largest; ++ox) {
                const int cx = x + ox, cy = y + oy;
                const int reach = std::max(std::abs(ox), std::abs(oy));
                const V radius = hn::LoadU(d, k.ptr(0, cx, cy));
                const M covers = hn::Ge(radius, hn::Set(d, static_cast<float>(reach)));
                if (hn::AllFalse(d, covers)) continue;
                const bool own = ox == 0 && oy == 0;
                V guide =
                    hn::IfThenElseZero(covers, hn::Mul(GuideWeight(scene, v, x, y, ox, oy),
                                                       hn::LoadU(d, v.ptr(scene.source, cx, cy))));
                if (own) guide = hn::Max(guide, hn::Set(d, own_weight));
                const auto dx = static_cast<float>(-ox), dy = static_cast<float>(-oy);
                V whole[C];
                V light = zero;
                for (int c = 0; c < C; ++c) {
                    const int first = 2 + c * 3;
                    whole[c] = hn::Add(
                        hn::Add(hn::Mul(hn::LoadU(d, k.ptr(first, cx, cy)), hn::Set(d, dx)),
                                hn::Mul(hn::LoadU(d, k.ptr(first + 1, cx, cy)), hn::Set(d, dy))),
                        hn::LoadU(d, k.ptr(first + 2, cx, cy)));
                    light = hn::Add(light, whole[c]);
                }
                // A pixel on an axis lies in two quadrants, the centre in all four.
                const float share = (ox == 0 ? 0.5f : 1.0f) * (oy == 0 ? 0.5f : 1.0f);
                const V shared = hn::Mul(guide, hn::Set(d, share));
                for (int q = 0; q < 4; ++q) {
                    if ((q & 1) != 0 ? dx > 0.0f : dx < 0.0f) continue;
                    if ((q & 2) != 0 ? dy > 0.0f : dy < 0.0f) continue;
                    AddPlane<C>(k, q, cx, cy, dx, dy, whole, light, shared, own, set.blend,
                                weight_sum, sum);
                }
            }
        for (int c = 0; c < C; ++c)
            hn::StoreU(hn::Max(zero, hn::Div(sum[c], weight_sum)), d,
                       job.results + c * job.stride + (x - job.part.x0));
    }
}

void FitOne(const FitJob& job) { FitRow<1>(job); }
void FitThree(const FitJob& job) { FitRow<3>(job); }
void FuseOne(const FuseJob& job) { FuseRow<1>(job); }
void FuseThree(const FuseJob& job) { FuseRow<3>(job); }
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
HWY_EXPORT(FuseOne);
HWY_EXPORT(FuseThree);
HWY_EXPORT(VectorLanes);

namespace
{

std::size_t index(int i) { return static_cast<std::size_t>(i); }

int part_pairs(int channels) { return std::min(channels / 2, max_plane_parts); }

/// Guides over `part` grown by `radius`, ready for the row kernels.
PlaneScene make_scene(int radius, const Region& part, const Region& data, const PlaneGuides& guides,
                      int colours)
{
    PlaneScene s;
    s.colours = colours;
    s.has_normal = !guides.normal.empty();
    s.part_pairs = guides.parts.empty() ? 0 : part_pairs(guides.parts.channels());
    s.z = 0;
    s.light = colours;
    s.variance = colours + 1;
    s.source = colours + 2;
    s.normal = colours + 3;
    s.parts = s.normal + (s.has_normal ? 4 : 0);
    Region area = part.grown(Halo::all(radius));
    area.x1 += plane_tail;
    s.pixels = ImageBuffer(area, s.parts + 2 * s.part_pairs);
    s.pixels.fill(0.0f);
    const ImageView to = s.pixels.view();
    const Region known = part.grown(Halo::all(radius)).intersect(data);
    for (int y = known.y0; y < known.y1; ++y)
        for (int x = known.x0; x < known.x1; ++x) {
            const float edge = guides.boundary.empty() ? 0.0f : guides.boundary.at(0, x, y);
            to.at(s.source, x, y) = 1.0f - std::clamp(edge == edge ? edge : 1.0f, 0.0f, 1.0f);
            if (s.has_normal) {
                float n[3], length = 0.0f;
                for (int c = 0; c < 3; ++c) {
                    n[c] = guides.normal.at(c, x, y);
                    length += n[c] * n[c];
                }
                length = std::sqrt(length);
                const bool is_normal = std::isfinite(length) && length > 0.05f;
                for (int c = 0; c < 3; ++c)
                    to.at(s.normal + c, x, y) = is_normal ? n[c] / length : 0.0f;
                to.at(s.normal + 3, x, y) = is_normal ? 0.0f : 1.0f;
            }
            if (s.part_pairs > 0) {
                float total = 0.0f;
                for (int i = 0; i < s.part_pairs; ++i) {
                    const float cover = guides.parts.at(2 * i + 1, x, y);
                    total += cover > 0.0f ? cover : 0.0f;
                }
                const bool covered = total > 0.0f && std::isfinite(total);
                for (int i = 0; i < s.part_pairs; ++i) {
                    const float id = guides.parts.at(2 * i, x, y);
                    const float cover = guides.parts.at(2 * i + 1, x, y);
                    // Nothing at all is a part too.
                    to.at(s.parts + 2 * i, x, y) = covered ? id : 0.0f;
                    to.at(s.parts + 2 * i + 1, x, y) = covered
                                                           ? (cover > 0.0f ? cover / total : 0.0f)
                                                       : i == 0 ? 1.0f
                                                                : 0.0f;
                }
            }
        }
    return s;
}

/// Adds z, its mean over the colours, its variance, and e^−σ to the scene.
void add_light(PlaneScene& s, const PlaneSettings& settings, const Region& data,
               const PlaneGuides& guides)
{
    constexpr int near = 2;
    const ImageView to = s.pixels.view();
    Region known = to.region();
    known.x1 -= plane_tail;
    known = known.intersect(data);
    const Region wide = known.grown(Halo::all(near)).intersect(data);
    ImageBuffer around(wide, 3); // light, variance, 1 where both are of use
    const ImageView near_view = around.view();
    const auto colours = static_cast<float>(s.colours);
    for (int y = wide.y0; y < wide.y1; ++y)
        for (int x = wide.x0; x < wide.x1; ++x) {
            float z[3] = {0.0f, 0.0f, 0.0f}, sum = 0.0f;
            int unmarked = 0;
            bool finite = true;
            const auto marked = [&](int c) {
                return !guides.marked.empty() && guides.marked.at(c, x, y) != 0.0f;
            };
            for (int c = 0; c < s.colours; ++c) {
                z[c] = guides.image.at(c, x, y);
                finite = finite && std::isfinite(z[c]);
                if (marked(c)) continue;
                sum += z[c];
                ++unmarked;
            }
            float deviation = 0.0f;
            const int variances = guides.variance.channels();
            for (int c = 0; c < variances; ++c) {
                const float v = guides.variance.at(c, x, y);
                finite = finite && std::isfinite(v);
                deviation += v > 0.0f ? std::sqrt(v) : 0.0f;
            }
            deviation /= static_cast<float>(variances);
            const bool use = finite && unmarked > 0;
            // Light of a marked colour is not known: take it to be grey.
            const float grey = unmarked > 0 ? sum / static_cast<float>(unmarked) : 0.0f;
            float light = 0.0f;
            for (int c = 0; c < s.colours; ++c) {
                if (marked(c)) z[c] = grey;
                light += z[c];
            }
            near_view.at(0, x, y) = use ? light / colours : 0.0f;
            near_view.at(1, x, y) = use ? deviation * deviation : 0.0f;
            near_view.at(2, x, y) = use ? 1.0f : 0.0f;
            if (!known.contains(x, y)) continue;
            for (int c = 0; c < s.colours; ++c) to.at(s.z + c, x, y) = use ? z[c] : 0.0f;
            to.at(s.light, x, y) = near_view.at(0, x, y);
            to.at(s.variance, x, y) = near_view.at(1, x, y);
        }
    for (int y = known.y0; y < known.y1; ++y)
        for (int x = known.x0; x < known.x1; ++x) {
            float n = 0.0f, light = 0.0f, variance = 0.0f;
            for (int v = std::max(y - near, data.y0); v < std::min(y + near + 1, data.y1); ++v)
                for (int u = std::max(x - near, data.x0); u < std::min(x + near + 1, data.x1);
                     ++u) {
                    light += near_view.at(0, u, v);
                    variance += near_view.at(1, u, v);
                    n += near_view.at(2, u, v);
                }
            float& source = to.at(s.source, x, y);
            if (near_view.at(2, x, y) == 0.0f || !std::isfinite(light) || !std::isfinite(variance))
                source = 0.0f;
            if (source == 0.0f) continue;
            const float sigma =
                variance > 0.0f && light > 0.0f ? std::sqrt(variance * n) / light : 0.0f;
            if (sigma > settings.max_noise)
                source = 0.0f;
            else
                source *= std::exp(-sigma);
        }
}

std::size_t buffer_bytes(int radius, int channels)
{
    constexpr int tile = 256; // of the size the engine likes
    return ImageBuffer::bytes_for({0, 0, tile + 2 * radius + plane_tail, tile + 2 * radius},
                                  channels);
}

} // namespace

std::size_t fit_planes_scratch(const PlaneSettings& settings, int colours, int part_channels)
{
    const auto side = static_cast<std::size_t>(2 * settings.max_radius + 1);
    return buffer_bytes(settings.max_radius, colours + 7 + part_channels) +
           buffer_bytes(settings.max_radius + 2, 3) + side * side * plane_tail * sizeof(float);
}

std::size_t fuse_planes_scratch(const PlaneSettings& settings, int colours, int part_channels)
{
    return buffer_bytes(settings.max_radius,
                        colours + 7 + part_channels + plane_coefficients(colours));
}

double fit_planes(const PlaneSettings& settings, const Region& data, const PlaneGuides& guides,
                  ImageView out, const std::function<void()>& each_row)
{
    const Region& part = out.region();
    const int colours = guides.image.channels(), channels = plane_coefficients(colours);
    PlaneScene scene = make_scene(settings.max_radius, part, data, guides, colours);
    add_light(scene, settings, data, guides);
    const std::size_t side = index(2 * settings.max_radius + 1);
    std::vector<float> weights(side * side * HWY_DYNAMIC_DISPATCH(VectorLanes)());
    FitJob job;
    job.settings = &settings;
    job.scene = &scene;
    job.part = part;
    job.guide_weights = weights.data();
    job.stride = part.width() + plane_tail;
    std::vector<float> results(index(channels) * static_cast<std::size_t>(job.stride));
    job.results = results.data();
    double radii = 0.0;
    for (int y = part.y0; y < part.y1; ++y) {
        each_row();
        job.y = y;
        if (colours == 1)
            HWY_DYNAMIC_DISPATCH(FitOne)(job);
        else
            HWY_DYNAMIC_DISPATCH(FitThree)(job);
        for (int c = 0; c < channels; ++c)
            std::copy_n(job.results + c * job.stride, part.width(), out.row(c, y));
        for (const float r : out.row_span(0, y)) radii += static_cast<double>(r);
    }
    return radii;
}

void fuse_planes(const PlaneSettings& settings, const Region& data, ConstImageView coefficients,
                 const PlaneGuides& guides, ImageView out, const std::function<void()>& each_row)
{
    const Region& part = out.region();
    const int colours = out.channels();
    const PlaneScene scene = make_scene(settings.max_radius, part, data, guides, colours);
    Region area = part.grown(Halo::all(settings.max_radius));
    const Region known = area.intersect(data);
    area.x1 += plane_tail;
    ImageBuffer padded(area, coefficients.channels());
    padded.fill(0.0f);
    float largest = 0.0f;
    for (int y = area.y0; y < area.y1; ++y)
        std::fill_n(padded.view().row(0, y), area.width(), -1.0f);
    for (int y = known.y0; y < known.y1; ++y)
        for (int c = 0; c < coefficients.channels(); ++c) {
            std::copy_n(coefficients.ptr(c, known.x0, y), known.width(),
                        padded.view().ptr(c, known.x0, y));
            if (c == 0)
                for (int x = known.x0; x < known.x1; ++x)
                    largest = std::max(largest, coefficients.at(0, x, y));
        }
    FuseJob job;
    job.settings = &settings;
    job.scene = &scene;
    job.coefficients = padded.view();
    job.part = part;
    job.largest = std::min(settings.max_radius, static_cast<int>(largest));
    job.stride = part.width() + plane_tail;
    std::vector<float> results(index(colours) * static_cast<std::size_t>(job.stride));
    job.results = results.data();
    for (int y = part.y0; y < part.y1; ++y) {
        each_row();
        job.y = y;
        if (colours == 1)
            HWY_DYNAMIC_DISPATCH(FuseOne)(job);
        else
            HWY_DYNAMIC_DISPATCH(FuseThree)(job);
        for (int c = 0; c < colours; ++c)
            std::copy_n(job.results + c * job.stride, part.width(), out.row(c, y));
    }
}

} // namespace rayloom
#endif
