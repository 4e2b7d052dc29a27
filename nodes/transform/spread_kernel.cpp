// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/spread_kernel.h"

#include "rayloom/image/mirrored.h"
#include "rayloom/simd/row_filters.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace rayloom
{
namespace
{

/// [1 4 6 4 1]/16 at distance d along x and y: `in` covers r grown by 2d. `between` is scratch.
void smooth(ConstImageView in, int d, const Region& r, ImageBuffer& between, ImageBuffer& out)
{
    const Region tall{r.x0, r.y0 - 2 * d, r.x1, r.y1 + 2 * d};
    between.reshape(tall, 1);
    out.reshape(r, 1);
    const ImageView middle = between.view(), to = out.view();
    const auto n = static_cast<std::size_t>(r.width());
    for (int y = tall.y0; y < tall.y1; ++y) {
        const float* const c = in.ptr(0, r.x0, y);
        spline_row(c - 2 * d, c - d, c, c + d, c + 2 * d, middle.row(0, y), n);
    }
    for (int y = r.y0; y < r.y1; ++y)
        spline_row(middle.row(0, y - 2 * d), middle.row(0, y - d), middle.row(0, y),
                   middle.row(0, y + d), middle.row(0, y + 2 * d), to.row(0, y), n);
}

/// K of `in`, in place of it; `in` covers r grown by spread_reach().
void spread(int scale, const Region& r, ImageBuffer& in, ImageBuffer& between, ImageBuffer& other)
{
    for (int s = 0; s < scale; ++s) {
        const int rest = spread_reach(scale) - spread_reach(s + 1);
        smooth(in.view(), 1 << s, r.grown(Halo::all(rest)), between, other);
        std::swap(in, other);
    }
}

} // namespace

std::size_t restore_energy_scratch(int scale, const Region& region)
{
    return 4 * ImageBuffer::bytes_for(region.grown(Halo::all(2 * spread_reach(scale))), 1);
}

void restore_energy(int scale, const Region& window, ConstImageView image, ConstImageView reference,
                    ImageView out)
{
    const Region& r = out.region();
    const Region once = r.grown(Halo::all(spread_reach(scale)));
    const Region twice = r.grown(Halo::all(2 * spread_reach(scale)));
    ImageBuffer share(twice, 1), between, other;
    for (int y = twice.y0; y < twice.y1; ++y) {
        float* const to = share.view().row(0, y);
        load_mirrored_row(image, window, y, twice, to);
        for (int i = 0; i < twice.width(); ++i) to[i] = to[i] > 0.0f ? to[i] : 0.0f;
    }
    spread(scale, once, share, between, other);

    // n / K f where there is something to share it by, and what there is not.
    ImageBuffer kept(r, 1);
    std::vector<float> n(static_cast<std::size_t>(once.width()));
    constexpr float least = 1e-30f;
    for (int y = once.y0; y < once.y1; ++y) {
        load_mirrored_row(reference, window, y, once, n.data());
        float* const to = share.view().row(0, y);
        if (y >= r.y0 && y < r.y1) {
            float* const keep = kept.view().row(0, y);
            const float* const mean = to + (r.x0 - once.x0);
            const float* const own = n.data() + (r.x0 - once.x0);
            for (int i = 0; i < r.width(); ++i) keep[i] = mean[i] > least ? 0.0f : own[i];
        }
        for (int i = 0; i < once.width(); ++i) {
            const float mean = to[i];
            const float safe = mean > least ? mean : 1.0f;
            const float ratio = n[static_cast<std::size_t>(i)] / safe;
            to[i] = mean > least ? ratio : 0.0f;
        }
    }
    spread(scale, r, share, between, other);
    for (int y = r.y0; y < r.y1; ++y) {
        const float* const f = image.ptr(0, r.x0, y);
        const float* const k = share.view().row(0, y);
        const float* const keep = kept.view().row(0, y);
        float* const to = out.row(0, y);
        for (int i = 0; i < r.width(); ++i) to[i] = (f[i] > 0.0f ? f[i] : 0.0f) * k[i] + keep[i];
    }
}

void restore_local_mean(int scale, const Region& window, ConstImageView image,
                        ConstImageView reference, ImageView out)
{
    const Region& r = out.region();
    const Region wide = r.grown(Halo::all(spread_reach(scale)));
    ImageBuffer have(wide, 1), want(wide, 1), between, other;
    for (int y = wide.y0; y < wide.y1; ++y) {
        float* const f = have.view().row(0, y);
        load_mirrored_row(image, window, y, wide, f);
        for (int i = 0; i < wide.width(); ++i) f[i] = f[i] > 0.0f ? f[i] : 0.0f;
        load_mirrored_row(reference, window, y, wide, want.view().row(0, y));
    }
    spread(scale, r, have, between, other);
    spread(scale, r, want, between, other);
    constexpr float least = 1e-30f;
    for (int y = r.y0; y < r.y1; ++y) {
        const float *const f = image.ptr(0, r.x0, y), *const n = reference.ptr(0, r.x0, y);
        const float *const kf = have.view().row(0, y), *const kn = want.view().row(0, y);
        float* const to = out.row(0, y);
        for (int i = 0; i < r.width(); ++i) {
            const float ratio = kn[i] > 0.0f ? kn[i] / (kf[i] > least ? kf[i] : 1.0f) : 0.0f;
            to[i] = kf[i] > least ? f[i] * ratio : n[i];
        }
    }
}

} // namespace rayloom
