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

} // namespace

void spread(int scale, const Region& r, ImageBuffer& in, ImageBuffer& between, ImageBuffer& other)
{
    for (int s = 0; s < scale; ++s) {
        const int rest = spread_reach(scale) - spread_reach(s + 1);
        smooth(in.view(), 1 << s, r.grown(Halo::all(rest)), between, other);
        std::swap(in, other);
    }
}

namespace
{

/// Below it there is nothing to share by.
constexpr float least = 1e-30f;

/// Rows over the columns of `region`, times w.
class WeightedRows
{
public:
    WeightedRows(const Region& window, const EnergyImages& images, const Region& region)
        : m_window(window), m_images(images), m_region(region),
          m_weight(images.weight ? static_cast<std::size_t>(region.width()) : 0)
    {
    }

    void image(int y, float* to)
    {
        load_image(y, to);
        times_weight(y, to);
    }
    void reference(int y, float* to)
    {
        load_mirrored_row(m_images.reference, m_window, y, m_region, to);
        times_weight(y, to);
    }
    /// n − f.
    void change(int y, float* to)
    {
        m_image.resize(static_cast<std::size_t>(m_region.width()));
        load_image(y, m_image.data());
        load_mirrored_row(m_images.reference, m_window, y, m_region, to);
        for (std::size_t i = 0; i < m_image.size(); ++i)
            to[i] = m_images.offset + to[i] - m_image[i];
        times_weight(y, to);
    }

private:
    void load_image(int y, float* to)
    {
        load_mirrored_row(m_images.image, m_window, y, m_region, to);
        for (int i = 0; i < m_region.width(); ++i)
            to[i] = (to[i] > 0.0f ? to[i] : 0.0f) + m_images.offset;
    }
    void times_weight(int y, float* to)
    {
        if (!m_images.weight) return;
        load_mirrored_row(*m_images.weight, m_window, y, m_region, m_weight.data());
        for (std::size_t i = 0; i < m_weight.size(); ++i)
            to[i] *= m_weight[i] > 0.0f ? m_weight[i] : 0.0f;
    }

    const Region& m_window;
    const EnergyImages& m_images;
    Region m_region;
    std::vector<float> m_weight, m_image;
};

/// What of w n, or of w (n − f), each pixel hands out for a share of 1: that over `shares`, in
/// place of them. `kept` takes what of n finds nothing to be shared by.
void divide_by_shares(const Region& window, const EnergyImages& images, bool change,
                      ImageView shares, ImageView kept)
{
    const Region& part = shares.region();
    const Region& r = kept.region();
    std::vector<float> n(static_cast<std::size_t>(part.width()));
    WeightedRows rows(window, images, part);
    for (int y = part.y0; y < part.y1; ++y) {
        float* const to = shares.row(0, y);
        if (y >= r.y0 && y < r.y1) {
            float* const keep = kept.row(0, y);
            const float* const own = images.reference.ptr(0, r.x0, y);
            const float* const f = images.image.ptr(0, r.x0, y);
            for (int i = 0; i < r.width(); ++i) {
                const float left = change && f[i] > 0.0f ? own[i] - f[i] : own[i];
                keep[i] = to[r.x0 - part.x0 + i] > least ? 0.0f : left;
            }
        }
        if (change)
            rows.change(y, n.data());
        else
            rows.reference(y, n.data());
        for (int i = 0; i < part.width(); ++i) {
            const float safe = to[i] > least ? to[i] : 1.0f;
            const float ratio = n[static_cast<std::size_t>(i)] / safe;
            to[i] = to[i] > least ? ratio : 0.0f;
        }
    }
}

} // namespace

std::size_t restore_energy_scratch(int scale, const Region& region)
{
    return 5 * ImageBuffer::bytes_for(region.grown(Halo::all(3 * spread_reach(scale))), 1);
}

void restore_energy(int scale, const Region& window, const EnergyImages& images, ImageView out)
{
    const Region& r = out.region();
    const Region once = r.grown(Halo::all(spread_reach(scale)));
    const Region twice = r.grown(Halo::all(2 * spread_reach(scale)));
    ImageBuffer share(twice, 1), between, other, kept(r, 1);
    WeightedRows rows(window, images, twice);
    for (int y = twice.y0; y < twice.y1; ++y) rows.image(y, share.view().row(0, y));
    spread(scale, once, share, between, other);
    divide_by_shares(window, images, false, share.view(), kept.view());
    spread(scale, r, share, between, other);
    for (int y = r.y0; y < r.y1; ++y) {
        const float* const f = images.image.ptr(0, r.x0, y);
        const float* const k = share.view().row(0, y);
        const float* const keep = kept.view().row(0, y);
        float* const to = out.row(0, y);
        for (int i = 0; i < r.width(); ++i) to[i] = (f[i] > 0.0f ? f[i] : 0.0f) * k[i] + keep[i];
    }
}

void balance_energy(int scale, const Region& window, const EnergyImages& images, ImageView out)
{
    const Region& r = out.region();
    const Region once = r.grown(Halo::all(spread_reach(scale)));
    const Region twice = r.grown(Halo::all(2 * spread_reach(scale)));
    const Region thrice = r.grown(Halo::all(3 * spread_reach(scale)));
    ImageBuffer share(thrice, 1), own(twice, 1), between, other, factor(r, 1), kept(r, 1);
    WeightedRows rows(window, images, thrice);
    for (int y = thrice.y0; y < thrice.y1; ++y) rows.image(y, share.view().row(0, y));
    for (int y = twice.y0; y < twice.y1; ++y)
        std::copy_n(share.view().ptr(0, twice.x0, y), twice.width(), own.view().row(0, y));
    spread(scale, twice, share, between, other);
    for (int y = twice.y0; y < twice.y1; ++y) {
        float* const mean = share.view().row(0, y);
        if (y >= r.y0 && y < r.y1) {
            const float* const f = images.image.ptr(0, r.x0, y);
            float* const to = factor.view().row(0, y);
            for (int i = 0; i < r.width(); ++i) {
                const float k = mean[r.x0 - twice.x0 + i];
                const float whole = (f[i] > 0.0f ? f[i] : 0.0f) + images.offset;
                const float ratio = whole / (k > least ? k : 1.0f);
                to[i] = k > least ? ratio : 0.0f;
            }
        }
        const float* const wf = own.view().row(0, y);
        for (int i = 0; i < twice.width(); ++i) {
            const float ratio = wf[i] / (mean[i] > least ? mean[i] : 1.0f);
            mean[i] = mean[i] > least ? ratio : 0.0f;
        }
    }
    spread(scale, once, share, between, other);
    divide_by_shares(window, images, true, share.view(), kept.view());
    spread(scale, r, share, between, other);
    for (int y = r.y0; y < r.y1; ++y) {
        const float* const f = images.image.ptr(0, r.x0, y);
        const float* const share_of_it = factor.view().row(0, y);
        const float* const handed = share.view().row(0, y);
        const float* const keep = kept.view().row(0, y);
        float* const to = out.row(0, y);
        for (int i = 0; i < r.width(); ++i) {
            const float sum = (f[i] > 0.0f ? f[i] : 0.0f) + share_of_it[i] * handed[i] + keep[i];
            to[i] = sum > 0.0f ? sum : 0.0f;
        }
        if (!images.weight) continue;
        const float* const w = images.weight->ptr(0, r.x0, y);
        const float* const n = images.reference.ptr(0, r.x0, y);
        for (int i = 0; i < r.width(); ++i) to[i] = w[i] > 0.0f ? to[i] : n[i];
    }
}

void restore_local_mean(int scale, const Region& window, const EnergyImages& images, ImageView out)
{
    const Region& r = out.region();
    const Region wide = r.grown(Halo::all(spread_reach(scale)));
    ImageBuffer have(wide, 1), want(wide, 1), between, other;
    WeightedRows rows(window, images, wide);
    for (int y = wide.y0; y < wide.y1; ++y) {
        rows.image(y, have.view().row(0, y));
        rows.reference(y, want.view().row(0, y));
    }
    spread(scale, r, have, between, other);
    spread(scale, r, want, between, other);
    for (int y = r.y0; y < r.y1; ++y) {
        const float* const f = images.image.ptr(0, r.x0, y);
        const float* const n = images.reference.ptr(0, r.x0, y);
        const float *const kf = have.view().row(0, y), *const kn = want.view().row(0, y);
        float* const to = out.row(0, y);
        for (int i = 0; i < r.width(); ++i) {
            const float ratio = kn[i] > 0.0f ? kn[i] / (kf[i] > least ? kf[i] : 1.0f) : 0.0f;
            to[i] = kf[i] > least ? f[i] * ratio : n[i];
        }
    }
}

} // namespace rayloom
