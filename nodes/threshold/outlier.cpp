// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "rayloom/core/registry.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

namespace rayloom
{
namespace
{

/// threshold.outlier: takes off what a pixel has beyond its neighbourhood.
class Outlier final : public Node
{
public:
    struct Params {
        int radius = 3;
        double share = 0.2;
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("threshold.outlier")
            .summary("Splits fireflies off: an image without them, and the light they hold.")
            .doc("A pixel is an outlier when, in every colour channel, it is brighter than all but "
                 "a few of its neighbours *and* its samples do not bear that out. The cap of a "
                 "channel is the k-th brightest of the neighbours in a square (clipped at the "
                 "border), k = ⌈share · their number⌉, or `low`, the lower end of the pixel's "
                 "confidence interval, if that is more. Colours are scaled by one factor, the "
                 "largest cap/value of the channels, never above 1.\n\n"
                 "`image` + `excess` is the input to rounding: no light is lost. Filtered images "
                 "get it back, spread, from transform.restore_mean (mode share). Where bright "
                 "samples lie close together (a caustic) the k-th brightest is bright as well and "
                 "nothing is taken. A highlight smaller than k pixels stays if its samples agree, "
                 "for `low` is then near its value; without `low` it is an outlier. Channels that "
                 "are not colours are handed on.")
            .source("rank-conditioned rank selection, Hardie and Barner 1994; samples without "
                    "neighbours of like value as outliers: DeCoro, Weyrich and Rusinkiewicz 2010")
            .accuracy("Exact decisions in float; image + excess is the input to one rounding.")
            .example("rayloom: 1\n"
                     "name: outlier-example\n"
                     "inputs:\n"
                     "  image: {doc: noisy radiance, channels: RGB}\n"
                     "nodes:\n"
                     "  split: {op: threshold.outlier, image: image}\n"
                     "outputs:\n"
                     "  image: split.image\n"
                     "  fireflies: split.excess\n");
        d.input("image", "linear radiance");
        d.input("low", "lower end of each pixel's interval, one channel per colour").optional();
        d.input("variance", "variance of the image's pixels, one channel per colour").optional();
        d.output("image", "the image without what its outliers have too much").optional();
        d.output("excess", "what was taken, colour channels").optional();
        d.output("variance", "variance times the square of the factor").optional();
        d.param("radius", &Params::radius, "Half-size of the square of neighbours.")
            .range(1, 32)
            .unit("px");
        d.param("share", &Params::share,
                "Share of the neighbours that must be as bright as a pixel for it to stay; 0: all "
                "pixels stay.")
            .range(0, 1)
            .source("by measurement, docs/methods/virtual-flash.md");
    }

    explicit Outlier(const Params& p) : m(p) {}

    void plan(PlanContext& context) override
    {
        const ImageDesc& image = context.input("image");
        m_window = image.data;
        m_colour = require_colours(context, "image");
        if (context.has("low")) m_low = matching_colours(context, "image", "low");
        if (context.has("variance")) m_variance = matching_colours(context, "image", "variance");
        const std::vector<std::string> names = channel_names(image, m_colour);
        context.output("image", image);
        context.output("excess", image.with_channels(names));
        if (!m_variance.empty()) context.output("variance", image.with_channels(names));
        m_passed.plan(context, "image", m_colour);
        if (m.share == 0.0) {
            context.pass_through("image", "image");
            if (!m_variance.empty()) context.pass_through("variance", "variance");
            context.constant("excess", 0.0f);
            return;
        }
        context.needs("image", Halo::all(m.radius));
    }

    void compute(const TileContext& context) const override
    {
        const Region& region = context.region();
        const ConstImageView image = context.input("image");
        const auto wanted = [&](const char* port) {
            return context.wants(port) ? context.output(port) : ImageView();
        };
        const ImageView out = wanted("image"), excess = wanted("excess");
        const ImageView out_variance = m_variance.empty() ? ImageView() : wanted("variance");
        const ConstImageView variance =
            out_variance.empty() ? ConstImageView() : context.input("variance");
        const auto width = static_cast<std::size_t>(region.width());
        std::vector<float> neighbours, kept(width);
        Candidates candidates;
        if (!out.empty()) m_passed.copy(image, out);
        for (int y = region.y0; y < region.y1; ++y) {
            context.check_cancelled();
            find_candidates(image, region, y, candidates);
            for (std::size_t i = 0; i < width; ++i)
                kept[i] =
                    candidates.found[i] != 0
                        ? factor(context, image, region.x0 + static_cast<int>(i), y, neighbours)
                        : 1.0f;
            for (std::size_t k = 0; k < m_colour.size(); ++k) {
                const auto to = static_cast<int>(k);
                const float* const value = image.ptr(m_colour[k], region.x0, y);
                if (!out.empty()) {
                    float* const row = out.row(m_colour[k], y);
                    for (std::size_t i = 0; i < width; ++i) row[i] = value[i] * kept[i];
                }
                if (!excess.empty()) {
                    float* const row = excess.row(to, y);
                    for (std::size_t i = 0; i < width; ++i) {
                        const float capped = value[i] * kept[i];
                        row[i] = value[i] - capped;
                    }
                }
                if (!out_variance.empty()) {
                    const float* const from = variance.ptr(m_variance[k], region.x0, y);
                    float* const row = out_variance.row(to, y);
                    for (std::size_t i = 0; i < width; ++i) row[i] = from[i] * kept[i] * kept[i];
                }
            }
        }
    }

private:
    /// Of each pixel of a row, whether it may be an outlier.
    struct Candidates {
        std::vector<char> found;
        std::vector<std::int32_t> as_bright; ///< scratch
    };

    static std::ptrdiff_t rank_of(double share, std::ptrdiff_t neighbours)
    {
        return std::max<std::ptrdiff_t>(
            1, static_cast<std::ptrdiff_t>(std::ceil(share * static_cast<double>(neighbours))));
    }

    /// Pixels that enough neighbours match in some channel are none. Where the square is whole that
    /// is counted for all of a row at once, which is much faster than asking pixel by pixel; beside
    /// the border every pixel is asked.
    void find_candidates(const ConstImageView& image, const Region& region, int y,
                         Candidates& candidates) const
    {
        candidates.found.assign(static_cast<std::size_t>(region.width()), 1);
        const int x0 = std::max(region.x0, m_window.x0 + m.radius),
                  x1 = std::min(region.x1, m_window.x1 - m.radius);
        if (x0 >= x1 || y < m_window.y0 + m.radius || y >= m_window.y1 - m.radius) return;
        const auto n = static_cast<std::size_t>(x1 - x0);
        char* const found = candidates.found.data() + (x0 - region.x0);
        const std::ptrdiff_t side = 2 * m.radius + 1;
        // The pixel is as bright as itself.
        const auto enough = static_cast<std::int32_t>(rank_of(m.share, side * side - 1) + 1);
        for (const int c : m_colour) {
            candidates.as_bright.assign(n, 0);
            std::int32_t* const as_bright = candidates.as_bright.data();
            const float* const value = image.ptr(c, x0, y);
            for (int v = y - m.radius; v <= y + m.radius; ++v)
                for (int dx = -m.radius; dx <= m.radius; ++dx) {
                    const float* const neighbour = image.ptr(c, x0 + dx, v);
                    for (std::size_t i = 0; i < n; ++i)
                        as_bright[i] += neighbour[i] >= value[i] ? 1 : 0;
                }
            int left = 0;
            for (std::size_t i = 0; i < n; ++i) {
                found[i] = found[i] != 0 && as_bright[i] < enough ? 1 : 0;
                left += found[i];
            }
            if (left == 0) return;
        }
    }

    /// What the pixel's colours are multiplied by.
    float factor(const TileContext& context, const ConstImageView& image, int x, int y,
                 std::vector<float>& neighbours) const
    {
        const Region around =
            Region{x, y, x + 1, y + 1}.grown(Halo::all(m.radius)).intersect(m_window);
        const auto number = static_cast<std::ptrdiff_t>(around.pixels()) - 1;
        if (number == 0 || m.share == 0.0) return 1.0f;
        const std::ptrdiff_t rank = rank_of(m.share, number);
        for (const int c : m_colour)
            if (is_matched(image, c, x, y, around, rank)) return 1.0f;
        float most = 0.0f;
        for (std::size_t k = 0; k < m_colour.size(); ++k) {
            const int c = m_colour[k];
            const float value = image.at(c, x, y);
            neighbours.clear();
            for (int v = around.y0; v < around.y1; ++v) {
                const float* row = image.ptr(c, around.x0, v);
                for (int i = 0; i < around.width(); ++i)
                    if (v != y || i != x - around.x0)
                        neighbours.push_back(std::isnan(row[i]) ? 0.0f : row[i]);
            }
            std::nth_element(neighbours.begin(), neighbours.begin() + (rank - 1), neighbours.end(),
                             std::greater<>());
            float cap = neighbours[static_cast<std::size_t>(rank - 1)];
            if (!m_low.empty()) cap = std::max(cap, context.input("low").at(m_low[k], x, y));
            most = std::max(most, cap / value);
        }
        return most < 1.0f ? most : 1.0f;
    }

    /// Whether `rank` neighbours are as bright. Pixels that are not above zero, or no number,
    /// always are; of most others it is known after a few neighbours.
    static bool is_matched(const ConstImageView& image, int c, int x, int y, const Region& around,
                           std::ptrdiff_t rank)
    {
        const float value = image.at(c, x, y);
        if (!(value > 0.0f && value <= std::numeric_limits<float>::max())) return true;
        std::ptrdiff_t found = -1; // the pixel itself
        for (int v = around.y0; v < around.y1; ++v) {
            const float* row = image.ptr(c, around.x0, v);
            for (int i = 0; i < around.width(); ++i) found += row[i] >= value ? 1 : 0;
            if (found >= rank) return true;
        }
        return false;
    }

    Params m;
    Region m_window;
    std::vector<int> m_colour, m_low, m_variance;
    PassedChannels m_passed;
};

RAYLOOM_NODE(Outlier);

} // namespace
} // namespace rayloom
