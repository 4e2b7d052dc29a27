// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"
#include "rayloom/image/border.h"
#include "rayloom/image/window_sums.h"

#include <algorithm>
#include <vector>

namespace rayloom
{
namespace
{

/// Mean of the smaller of the squares of two standard normal variables with correlation 2/3, the
/// correlation of the two second differences at a pixel: 1 − (2/π)·√(1 − 4/9).
constexpr double smaller_square = 0.525491636;

/// transform.local_variance: noise of each pixel as seen from its surroundings.
class LocalVariance final : public Node
{
public:
    struct Params {
        int radius = 3;
        float limit_factor = 1.0f;
        float floor_factor = 0.0f;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("transform.local_variance")
            .summary("Estimates the noise variance of each pixel from one image.")
            .version(2)
            .doc("At each pixel the second differences (2a − left − right)²/6 along x and along y "
                 "are both estimates of the variance of independent noise; the smaller one is "
                 "taken, "
                 "so that an edge or a ramp in one direction does not count as noise, divided by "
                 "its "
                 "expectation for normal noise, and averaged over a square. For images without "
                 "sample statistics, and for guides. Texture that changes from pixel to pixel in "
                 "both directions reads as noise; noise that is correlated between pixels (a wide "
                 "pixel filter) reads as too little. Not for gates that must keep theorem 3.1.\n\n"
                 "`limit` is a variance that is known to be at least as large, such as that of the "
                 "mean of a render of which the image holds a part: it is averaged over the same "
                 "square, and the smaller of both is given. That tells texture from noise wherever "
                 "the render itself has little noise. With `floor_factor` the noise counts as at "
                 "least that share of the averaged `limit`: for a guide without noise in a noisy "
                 "render, where next to nothing would be like anything else.")
            .source("second-difference noise estimators: Gasser, Sroka and Jennen-Steinmetz 1986")
            .accuracy("Unbiased for independent normal noise on a constant or linear image.")
            .example("rayloom: 1\n"
                     "name: local-variance-example\n"
                     "inputs:\n"
                     "  image: {doc: noisy image, channels: RGB}\n"
                     "nodes:\n"
                     "  noise: {op: transform.local_variance, image: image}\n"
                     "outputs:\n"
                     "  variance: noise.variance\n");
        d.input("image", "noisy image");
        d.input("limit", "variance that the image's cannot exceed, channel by channel").optional();
        d.output("variance", "estimated variance, channel by channel (not of alpha)");
        d.param("radius", &Params::radius, "Half-size of the square that is averaged over.")
            .range(0, 64)
            .unit("px");
        d.param("limit_factor", &Params::limit_factor,
                "The share of `limit` that the noise of this image can be.")
            .range(0, 1e6);
        d.param("floor_factor", &Params::floor_factor,
                "The share of `limit` that it counts as at least.")
            .range(0, 1e6);
    }

    explicit LocalVariance(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_window = image.data;
        m_channels = require_colours(context, "image");
        context.output("variance", image.with_channels(channel_names(image, m_channels)));
        context.needs("image", Halo::all(m.radius + 1));
        if (!context.has("limit")) return;
        m_limit_channels = matching_colours(context, "image", "limit");
        context.needs("limit", Halo::all(m.radius));
    }

    void compute(const TileContext& context) const override
    {
        const Region& region = context.region();
        const Region wide = region.grown(Halo::all(m.radius)).intersect(m_window);
        const ConstImageView image = context.input("image");
        ImageBuffer noise(wide, 1);
        std::vector<float> limit;
        for (std::size_t c = 0; c < m_channels.size(); ++c) {
            const int channel = m_channels[c];
            const auto value = [&](int x, int y) {
                return static_cast<double>(
                    image.at(channel, border_index(x, m_window.x0, m_window.x1, Border::mirror),
                             border_index(y, m_window.y0, m_window.y1, Border::mirror)));
            };
            const auto own = [](double middle, double left, double right, double up, double down) {
                const double twice = 2.0 * middle, h = twice - left - right, v = twice - up - down;
                return static_cast<float>(std::min(h * h, v * v) / (6.0 * smaller_square));
            };
            // Where all four neighbours are in the image.
            const int x0 = std::max(wide.x0, m_window.x0 + 1);
            const int x1 = std::min(wide.x1, m_window.x1 - 1);
            for (int y = wide.y0; y < wide.y1; ++y) {
                const bool inside = y > m_window.y0 && y < m_window.y1 - 1 && x0 < x1;
                for (int x = wide.x0; x < wide.x1; ++x) {
                    if (inside && x == x0) {
                        const float* const at = image.ptr(channel, x0, y);
                        const float* const up = image.ptr(channel, x0, y - 1);
                        const float* const down = image.ptr(channel, x0, y + 1);
                        float* const to = noise.view().ptr(0, x0, y);
                        for (int i = 0; i < x1 - x0; ++i)
                            to[i] = own(at[i], at[i - 1], at[i + 1], up[i], down[i]);
                        x = x1 - 1;
                        continue;
                    }
                    noise.view().at(0, x, y) = own(value(x, y), value(x - 1, y), value(x + 1, y),
                                                   value(x, y - 1), value(x, y + 1));
                }
            }
            const ConstImageView seen = noise.view();
            for (int y = region.y0; y < region.y1; ++y) {
                const auto to = context.output("variance").row_span(static_cast<int>(c), y);
                average(seen, 0, wide, y, region.x0, to);
                if (!context.has("limit")) continue;
                limit.resize(to.size());
                average(context.input("limit"), m_limit_channels[c], wide, y, region.x0, limit);
                for (std::size_t i = 0; i < to.size(); ++i)
                    to[i] = std::min(std::max(to[i], m.floor_factor * limit[i]),
                                     m.limit_factor * limit[i]);
            }
        }
    }

private:
    /// Averages squares of one channel over the part of them inside `wide`, for a row from x0 on.
    void average(const ConstImageView& from, int channel, const Region& wide, int y, int x0,
                 std::span<float> to) const
    {
        const int v0 = std::max(y - m.radius, wide.y0), v1 = std::min(y + m.radius + 1, wide.y1);
        std::vector<double> column(static_cast<std::size_t>(wide.width()), 0.0);
        for (int v = v0; v < v1; ++v) {
            const float* row = from.ptr(channel, wide.x0, v);
            for (std::size_t i = 0; i < column.size(); ++i)
                column[i] += static_cast<double>(row[i]);
        }
        std::vector<double> means(to.size());
        window_means(column, v1 - v0, x0 - wide.x0, m.radius, means);
        std::ranges::transform(means, to.begin(),
                               [](double mean) { return static_cast<float>(mean); });
    }

    Params m;
    Region m_window;
    std::vector<int> m_channels, m_limit_channels;
};

RAYLOOM_NODE(LocalVariance);

} // namespace
} // namespace rayloom
