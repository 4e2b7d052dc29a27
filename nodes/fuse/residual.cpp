// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <cmath>
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
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("fuse.residual")
            .summary("Gives a filtered image back what it lost beyond noise.")
            .doc("out = f + s·(z − f) with s = max(0, 1 − factor·v / b): b is the mean of (z − f)² "
                 "over a square and the colours, v that of the noise variance of z. Where a filter "
                 "changed no more than noise can be (b ≤ factor·v) the filtered pixel stays; where "
                 "it changed much more (an edge it went over, a reflection it blurred) the "
                 "original comes back, noise and all. Of all mixtures of the two this one has the "
                 "least expected error when `factor` is 1 and b and v are known exactly; a larger "
                 "one allows for their being estimates. An image without noise comes back bit for "
                 "bit.\n\n"
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
            if (context.has(port)) context.needs(port, Halo::all(m.radius));
        context.output("image", image);
        m_passed.plan(context, "image", m_image);
    }

    void compute(const TileContext& context) const override
    {
        const Region& r = context.region();
        const Region wide = r.grown(Halo::all(m.radius)).intersect(m_data);
        ImageBuffer sums(wide, 2); // (z − f)² and variance, added over the colours
        for (int y = wide.y0; y < wide.y1; ++y) add_row(context, wide, y, sums.view());
        const auto width = static_cast<std::size_t>(wide.width());
        std::vector<float> change(width), noise(width), share(static_cast<std::size_t>(r.width()));
        for (int y = r.y0; y < r.y1; ++y) {
            std::fill(change.begin(), change.end(), 0.0f);
            std::fill(noise.begin(), noise.end(), 0.0f);
            for (int v = std::max(y - m.radius, wide.y0); v <= std::min(y + m.radius, wide.y1 - 1);
                 ++v) {
                const float *const b = sums.view().row(0, v), *const n = sums.view().row(1, v);
                for (std::size_t i = 0; i < width; ++i) {
                    change[i] += b[i];
                    noise[i] += n[i];
                }
            }
            for (int x = r.x0; x < r.x1; ++x) {
                float b = 0.0f, n = 0.0f;
                for (int u = std::max(x - m.radius, wide.x0);
                     u <= std::min(x + m.radius, wide.x1 - 1); ++u) {
                    b += change[static_cast<std::size_t>(u - wide.x0)];
                    n += noise[static_cast<std::size_t>(u - wide.x0)];
                }
                const float left = b - m.factor * n;
                share[static_cast<std::size_t>(x - r.x0)] = left > 0.0f ? left / b : 0.0f;
            }
            mix_row(context, y, share);
        }
        m_passed.copy(context.input("image"), context.output("image"));
    }

private:
    bool skipped(const TileContext& context, std::size_t c, int x, int y) const
    {
        return !m_marked.empty() && context.input("marked").at(m_marked[c], x, y) != 0.0f;
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
            for (int x = 0; x < wide.width(); ++x) {
                const float difference = (z[x] - f[x]) * (z[x] - f[x]);
                const float variance = std::max(v[x], 0.0f);
                if (!std::isfinite(difference + variance) || skipped(context, c, wide.x0 + x, y))
                    continue;
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
            float* const to = out.row(m_image[c], y);
            for (int x = 0; x < r.width(); ++x) {
                const float s = share[static_cast<std::size_t>(x)];
                const bool alone = !std::isfinite(z[x]) || skipped(context, c, r.x0 + x, y);
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
