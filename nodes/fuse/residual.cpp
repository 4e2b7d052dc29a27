// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"
#include "rayloom/image/window_sums.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

namespace rayloom
{
namespace
{

/// fuse.residual: a filtered image with those of its changes undone that noise does not explain.
class Residual final : public Node
{
public:
    struct Params {
        int radius = 1;
        float factor = 2.0f;
        float support = 0.5f;
        int support_radius = 2;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("fuse.residual")
            .version(2)
            .summary("Gives a filtered image back what it lost beyond noise.")
            .doc("out = f + s·(z − f) with s = max(0, 1 − factor·v / b): b is the mean of (z − f)² "
                 "over a square and the colours, v that of the noise variance of z. Where a filter "
                 "changed no more than noise can be (b ≤ factor·v) the filtered pixel stays; where "
                 "it changed much more (an edge it went over, a reflection it blurred) the "
                 "original comes back, noise and all. Of all mixtures of the two this one has the "
                 "least expected error when `factor` is 1 and b and v are known exactly; a larger "
                 "one allows for their being estimates. An image without noise comes back bit for "
                 "bit.\n\n"
                 "Where s has a mean below `support` in the square of `support_radius` around, it "
                 "is lowered by as much: detail goes on from pixel to pixel, while the dark gaps "
                 "between fireflies, which look free of noise, and fireflies beside what looks "
                 "so are specks.\n\n"
                 "For `variance` from a single image take transform.local_variance with radius 0: "
                 "the square averages it. Pixels that are marked or not finite are left out of the "
                 "sums, and stay as filtered. Alpha and other channels of `image` pass through.")
            .source("the linear combination of least mean squared error: James and Stein 1961, "
                    "Estimation with quadratic loss")
            .accuracy("Float against the double oracle: 1e-5 of the larger value.")
            .example("rayloom: 1\n"
                     "name: residual-example\n"
                     "doc: A blur that keeps edges.\n"
                     "inputs:\n"
                     "  image: {doc: noisy image, channels: RGB}\n"
                     "nodes:\n"
                     "  blurred: {op: oiio.blur, image: image, width: 5, height: 5}\n"
                     "  noise: {op: transform.local_variance, image: image, radius: 0}\n"
                     "  kept: {op: fuse.residual, image: blurred, original: image, variance: "
                     "noise}\n"
                     "outputs:\n"
                     "  image: kept\n");
        d.input("image", "filtered image f");
        d.input("original", "noisy image z, colour channels as `image`");
        d.input("variance", "noise variance of z: as many colour channels, or one");
        d.input("marked", "not 0: the pixel is left alone (transform.demodulate)").optional();
        d.output("image", "the mixture, channels as `image`");
        d.param("radius", &Params::radius, "half-size of the square").range(0, 16).unit("px");
        d.param("factor", &Params::factor,
                "how many times the noise variance a change may be; 0 gives the original")
            .range(0, 1e6);
        d.param("support", &Params::support,
                "mean share around a pixel from which on its own counts in full; 0: it always does")
            .range(0, 1);
        d.param("support_radius", &Params::support_radius, "half-size of the square around")
            .range(0, 16)
            .unit("px");
    }

    explicit Residual(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_data = image.data;
        m_image = require_colours(context, "image");
        m_original = matching_colours(context, "image", "original");
        m_variance = matching_colours(context, "image", "variance", ColourCount::same_or_one);
        if (context.has("marked"))
            m_marked = matching_colours(context, "image", "marked", ColourCount::same_or_one);
        for (const char* port : {"image", "original", "variance", "marked"})
            if (context.has(port)) context.needs(port, Halo::all(m.radius + support_reach()));
        context.output("image", image);
        m_passed.plan(context, "image", m_image);
    }

    void compute(const TileContext& context) const override
    {
        const Region& r = context.region();
        const Region around = r.grown(Halo::all(support_reach())).intersect(m_data);
        const Region wide = around.grown(Halo::all(m.radius)).intersect(m_data);
        ImageBuffer sums(wide, 2); // (z − f)² and variance, added over the colours
        for (int y = wide.y0; y < wide.y1; ++y) add_row(context, wide, y, sums.view());
        ImageBuffer shares(around, 1);
        std::vector<float> noise(static_cast<std::size_t>(around.width()));
        for (int y = around.y0; y < around.y1; ++y) {
            const std::span<float> share = shares.view().row_span(0, y);
            square_sums(sums.view(), 0, m.radius, around.x0, y, share);
            square_sums(sums.view(), 1, m.radius, around.x0, y, noise);
            for (std::size_t i = 0; i < share.size(); ++i) {
                const float allowed = m.factor * noise[i], left = share[i] - allowed;
                // Without noise all of a change counts, and where nothing changed it is all the
                // same.
                share[i] = allowed <= 0.0f ? 1.0f : left > 0.0f ? 1.0f - allowed / share[i] : 0.0f;
            }
        }
        std::vector<float> share(static_cast<std::size_t>(r.width()));
        for (int y = r.y0; y < r.y1; ++y) {
            std::copy_n(shares.view().ptr(0, r.x0, y), r.width(), share.data());
            if (m.support > 0.0f) support_row(shares.view(), r.x0, y, share);
            mix_row(context, y, share);
        }
        m_passed.copy(context.input("image"), context.output("image"));
    }

private:
    int support_reach() const { return m.support > 0.0f ? m.support_radius : 0; }

    /// Sums over the square around each pixel of a row from x0 on, as far as `from` has it.
    static void square_sums(ConstImageView from, int channel, int radius, int x0, int y,
                            std::span<float> to)
    {
        const Region& in = from.region();
        std::vector<float> column(static_cast<std::size_t>(in.width()), 0.0f);
        for (int v = std::max(y - radius, in.y0); v <= std::min(y + radius, in.y1 - 1); ++v) {
            const float* const row = from.row(channel, v);
            for (std::size_t i = 0; i < column.size(); ++i) column[i] += row[i];
        }
        window_sums<float>(column, x0 - in.x0, radius, to);
    }

    /// Lowers the shares of a row from x0 on whose surroundings have less.
    void support_row(ConstImageView shares, int x0, int y, std::vector<float>& share) const
    {
        const int reach = m.support_radius;
        std::vector<float> sum(share.size());
        square_sums(shares, 0, reach, x0, y, sum);
        const int rows = std::min(y + reach, m_data.y1 - 1) - std::max(y - reach, m_data.y0) + 1;
        for (std::size_t i = 0; i < share.size(); ++i) {
            const int x = x0 + static_cast<int>(i);
            const int columns =
                std::min(x + reach, m_data.x1 - 1) - std::max(x - reach, m_data.x0) + 1;
            const float mean = sum[i] / static_cast<float>(rows * columns);
            if (mean < m.support) share[i] *= mean / m.support;
        }
    }

    /// The marks of a colour, from pixel x on; nothing when none can be marked.
    const float* marks(const TileContext& context, std::size_t c, int x, int y) const
    {
        return m_marked.empty() ? nullptr : context.input("marked").ptr(m_marked[c], x, y);
    }

    void add_row(const TileContext& context, const Region& wide, int y, ImageView sums) const
    {
        float *const change = sums.row(0, y), *const noise = sums.row(1, y);
        std::fill_n(change, wide.width(), 0.0f);
        std::fill_n(noise, wide.width(), 0.0f);
        for (std::size_t c = 0; c < m_image.size(); ++c) {
            const float* const f = context.input("image").ptr(m_image[c], wide.x0, y);
            const float* const z = context.input("original").ptr(m_original[c], wide.x0, y);
            const float* const v = context.input("variance").ptr(m_variance[c], wide.x0, y);
            const float* const mark = marks(context, c, wide.x0, y);
            for (int x = 0; x < wide.width(); ++x) {
                const float difference = (z[x] - f[x]) * (z[x] - f[x]);
                const float variance = std::max(v[x], 0.0f);
                if (!std::isfinite(difference + variance) || (mark && mark[x] != 0.0f)) continue;
                change[x] += difference;
                noise[x] += variance;
            }
        }
    }

    void mix_row(const TileContext& context, int y, const std::vector<float>& share) const
    {
        const Region& r = context.region();
        const ConstImageView image = context.input("image");
        const ImageView out = context.output("image");
        for (std::size_t c = 0; c < m_image.size(); ++c) {
            const float* const f = image.ptr(m_image[c], r.x0, y);
            const float* const z = context.input("original").ptr(m_original[c], r.x0, y);
            const float* const mark = marks(context, c, r.x0, y);
            float* const to = out.row(m_image[c], y);
            for (int x = 0; x < r.width(); ++x) {
                const float s = share[static_cast<std::size_t>(x)];
                const bool alone = !std::isfinite(z[x]) || (mark && mark[x] != 0.0f);
                to[x] = alone ? f[x] : s == 1.0f ? z[x] : f[x] + s * (z[x] - f[x]);
            }
        }
    }

    Params m;
    Region m_data;
    std::vector<int> m_image, m_original, m_variance, m_marked;
    PassedChannels m_passed;
};

RAYLOOM_NODE(Residual);

} // namespace
} // namespace rayloom
