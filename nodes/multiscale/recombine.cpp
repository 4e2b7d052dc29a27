// SPDX-License-Identifier: Apache-2.0
#include "nodes/multiscale/resample.h"

#include "rayloom/core/registry.h"

#include <algorithm>
#include <string>
#include <vector>

namespace rayloom
{

namespace
{

/// What holds the recombination back where neighbouring pixels differ by orders of magnitude.
enum class Limit {
    none,  ///< the published recursion
    range, ///< no value beyond those around it
    share, ///< a dark pixel takes a share of the change of bright surroundings; and `range`
};

/// Pixels on either side whose values a limited result may reach.
constexpr int range_radius = 1;
/// Times its own value, in units of the coarse one, up to which a pixel takes a change in full.
constexpr float full_share = 2.0f;
/// Source pixels of U along an axis.
constexpr int interpolation_taps = 4;

/// Regions of every level (relative to its data window) that one region of the finest depends on.
struct LevelRegions {
    std::vector<Region> result; ///< recombined pixels
    std::vector<Region> source; ///< pixels of the input level
};

LevelRegions level_regions(const std::vector<Region>& windows, const Region& region, Limit limit)
{
    const Halo halo = Halo::all(limit == Limit::none ? 0 : range_radius);
    const std::size_t n = windows.size();
    LevelRegions regions{std::vector<Region>(n), std::vector<Region>(n)};
    regions.result[0] = regions.source[0] = region.shifted(-windows[0].x0, -windows[0].y0);
    for (std::size_t i = 0; i + 1 < n; ++i) {
        const Region& fine = regions.result[i];
        const Region &size = windows[i], &coarse_size = windows[i + 1];
        const auto h = interpolate_axis(coarse_size.width(), size.width(), fine.x0, fine.x1);
        const auto v = interpolate_axis(coarse_size.height(), size.height(), fine.y0, fine.y1);
        const Region coarse{h.source_begin, v.source_begin, h.source_end, v.source_end};
        const auto dh = decimate_axis(size.width(), 1, coarse.x0, coarse.x1);
        const auto dv = decimate_axis(size.height(), 1, coarse.y0, coarse.y1);
        regions.source[i] =
            fine.grown(halo)
                .intersect({0, 0, size.width(), size.height()})
                .hull({dh.source_begin, dv.source_begin, dh.source_end, dv.source_end});
        regions.result[i + 1] = regions.source[i + 1] = coarse;
    }
    return regions;
}

/// Adds U(û − D(u)) to the pixels u of a level, coarse pixel by coarse pixel: where D(u) is more
/// than `full_share` times u, the change it undergoes is mostly that of a brighter neighbour, and
/// u takes the share full_share · u / D(u) of it.
void add_shares(ConstImageView low, ConstImageView change, const ResampleAxis& horizontal,
                const ResampleAxis& vertical, ImageView level)
{
    const Region& region = level.region();
    const int origin = horizontal.source_begin;
    for (int y = region.y0; y < region.y1; ++y) {
        const auto v = static_cast<std::size_t>(y - vertical.begin) * interpolation_taps;
        for (int c = 0; c < level.channels(); ++c) {
            float* u = level.row(c, y);
            const float* low_rows[interpolation_taps];
            const float* change_rows[interpolation_taps];
            for (std::size_t j = 0; j < interpolation_taps; ++j) {
                low_rows[j] = low.ptr(c, origin, vertical.source[v + j]);
                change_rows[j] = change.ptr(c, origin, vertical.source[v + j]);
            }
            for (int x = region.x0; x < region.x1; ++x, ++u) {
                const auto h = static_cast<std::size_t>(x - horizontal.begin) * interpolation_taps;
                const float full = full_share * std::max(*u, 0.0f);
                float sum = 0.0f;
                for (std::size_t j = 0; j < interpolation_taps; ++j) {
                    float row = 0.0f;
                    for (std::size_t i = 0; i < interpolation_taps; ++i) {
                        const int at = horizontal.source[h + i] - origin;
                        const float share = low_rows[j][at] > full ? full / low_rows[j][at] : 1.0f;
                        row += horizontal.weight[h + i] * (share * change_rows[j][at]);
                    }
                    sum += vertical.weight[v + j] * row;
                }
                *u += sum;
            }
        }
    }
}

/// Brings every pixel of `result` between the least and the greatest of the pixels of its level
/// around it and of the coarser pixels that U takes for it. `window` is that of the level.
void keep_in_range(ConstImageView level, const Region& window, ConstImageView coarse,
                   const ResampleAxis& horizontal, const ResampleAxis& vertical, ImageView result)
{
    const Region& region = result.region();
    const Region near =
        region.shifted(window.x0, window.y0).grown(Halo::all(range_radius)).intersect(window);
    const auto width = static_cast<std::size_t>(near.width());
    const auto coarse_width =
        static_cast<std::size_t>(horizontal.source_end - horizontal.source_begin);
    // Of columns first: the least and the greatest of a rectangle do not depend on the order.
    std::vector<float> least(width), most(width), coarse_least(coarse_width),
        coarse_most(coarse_width);
    const auto take = [](const float* from, std::vector<float>& low, std::vector<float>& high) {
        for (std::size_t x = 0; x < low.size(); ++x) {
            low[x] = std::min(low[x], from[x]);
            high[x] = std::max(high[x], from[x]);
        }
    };
    for (int y = region.y0; y < region.y1; ++y) {
        const auto v = static_cast<std::size_t>(y - vertical.begin) * interpolation_taps;
        const int y0 = std::max(y + window.y0 - range_radius, near.y0);
        const int y1 = std::min(y + window.y0 + range_radius + 1, near.y1);
        for (int c = 0; c < result.channels(); ++c) {
            const float* first = level.ptr(c, near.x0, y0);
            std::copy_n(first, width, least.begin());
            std::copy_n(first, width, most.begin());
            for (int row = y0 + 1; row < y1; ++row) take(level.ptr(c, near.x0, row), least, most);
            first = coarse.ptr(c, horizontal.source_begin, vertical.source[v]);
            std::copy_n(first, coarse_width, coarse_least.begin());
            std::copy_n(first, coarse_width, coarse_most.begin());
            for (std::size_t j = 1; j < interpolation_taps; ++j)
                take(coarse.ptr(c, horizontal.source_begin, vertical.source[v + j]), coarse_least,
                     coarse_most);

            float* out = result.row(c, y);
            for (int x = region.x0; x < region.x1; ++x, ++out) {
                const int x0 = std::max(x + window.x0 - range_radius, near.x0) - near.x0;
                const int x1 = std::min(x + window.x0 + range_radius + 1, near.x1) - near.x0;
                float low = least[static_cast<std::size_t>(x0)];
                float high = most[static_cast<std::size_t>(x0)];
                for (auto i = static_cast<std::size_t>(x0 + 1); i < static_cast<std::size_t>(x1);
                     ++i) {
                    low = std::min(low, least[i]);
                    high = std::max(high, most[i]);
                }
                const auto h = static_cast<std::size_t>(x - horizontal.begin) * interpolation_taps;
                for (std::size_t i = 0; i < interpolation_taps; ++i) {
                    const auto at = static_cast<std::size_t>(horizontal.source[h + i] -
                                                             horizontal.source_begin);
                    low = std::min(low, coarse_least[at]);
                    high = std::max(high, coarse_most[at]);
                }
                *out = std::clamp(*out, low, high);
            }
        }
    }
}

} // namespace

/// Puts filtered scales together again.
class Recombine final : public Node
{
public:
    struct Params {
        std::string limit = "share";
    };

    static void describe(Declaration<Params>& d)
    {
        d.name("multiscale.recombine")
            .summary("Fine detail of each scale over the low frequencies of the coarser ones.")
            .doc(
                "From the coarsest level to the finest, û = u − U(D(u)) + U(û of the coarser "
                "level): D is the Gaussian of multiscale.pyramid between two neighbouring levels, "
                "U Keys' bicubic with a = −½, to the real size of the finer level. The detail of a "
                "level is what D and U cannot hold; everything below comes from the coarser "
                "level, where a filter removed noise of low frequency.\n\n"
                "Beside a lamp a hundred times brighter than the wall, a change of one hundredth "
                "of "
                "the lamp is as large as the wall: filters do not agree on the pixels that the "
                "edge "
                "crosses, D and U spread the difference, and the wall gets black and bright "
                "blotches. `limit: none` leaves them, and values below 0, as published. `range` "
                "keeps each value between the least and the greatest of the 3 × 3 pixels of its "
                "level and of the 4 × 4 of û it is interpolated from, in each channel; bright "
                "blotches stay. `share` removes both: each of those 4 × 4 pixels gives its change "
                "û − D(u) multiplied by min(1, 2·u / D(u)), u being the pixel that takes it, and "
                "then `range` holds. No level being negative, neither is the result of either.\n\n"
                "An alpha channel is that of the finest level, and where it is 0 the colour is "
                "too.")
            .version(2)
            .source("004_ae1655312894f2a2.txt, section 3.4, Algorithm 2 lines 7 to 10")
            .accuracy("Float against the double oracle: 1e-6 of the largest value nearby.")
            .example("rayloom: 1\n"
                     "name: recombine-example\n"
                     "doc: Two scales of an image, put together again.\n"
                     "inputs:\n"
                     "  color: {doc: linear radiance, channels: RGB}\n"
                     "nodes:\n"
                     "  levels: {op: multiscale.pyramid, image: color, scales: 2}\n"
                     "  whole: {op: multiscale.recombine, levels: levels}\n"
                     "outputs:\n"
                     "  image: whole\n");
        d.input("levels", "scales, finest first, each ⌈size / 2⌉ of the one before").list();
        d.output("image", "the finest level with the low frequencies of the coarser ones");
        d.param("limit", &Params::limit,
                "what keeps bright pixels from leaving blotches around them; none is as published")
            .choices({"none", "range", "share"});
    }

    explicit Recombine(const Params& p)
        : m_limit(p.limit == "none"    ? Limit::none
                  : p.limit == "range" ? Limit::range
                                       : Limit::share)
    {
    }

    void plan(PlanContext& context) override
    {
        const std::size_t levels = context.count("levels");
        if (levels == 0) throw NodeError("input 'levels' is an empty list");
        m_windows.clear();
        for (std::size_t i = 0; i < levels; ++i) {
            const ImageDesc& level = context.input("levels", i);
            m_windows.push_back(level.data);
            if (i == 0) continue;
            const ImageDesc& finer = context.input("levels", i - 1);
            if (level.channels != context.input("levels", 0).channels)
                throw NodeError("level " + std::to_string(i) +
                                " has other channels than level 0; all levels must agree");
            if (level.data.width() != decimated_size(finer.data.width(), 1) ||
                level.data.height() != decimated_size(finer.data.height(), 1))
                throw NodeError("level " + std::to_string(i) + " is " + level.data.text() +
                                "; half of level " + std::to_string(i - 1) + " (" +
                                finer.data.text() + "), rounded up, is needed");
        }
        const ImageDesc& finest = context.input("levels", 0);
        m_alpha = finest.alpha();
        context.output("image", finest);
        if (levels == 1) {
            context.pass_through("image", "levels");
        } else if (m_alpha >= 0) {
            context.pass_channel("image", m_alpha, "levels", m_alpha);
        }
        context.needs("levels", [windows = m_windows, limit = m_limit](const Need& need) {
            const Region& window = windows.at(need.input_element);
            return level_regions(windows, need.region, limit)
                .source[need.input_element]
                .shifted(window.x0, window.y0);
        });
    }

    void compute(const TileContext& context) const override
    {
        const ImageView out = context.output("image");
        const LevelRegions regions = level_regions(m_windows, context.region(), m_limit);
        const int channels = out.channels();
        const std::size_t last = m_windows.size() - 1;

        // `result` holds the recombined level i + 1; level i is made from it.
        ImageBuffer result = level_pixels(context, last, regions.result[last]);
        for (std::size_t i = last; i-- > 0;) {
            context.check_cancelled();
            const Region &fine = regions.result[i], &coarse = regions.result[i + 1];
            const Region &size = m_windows[i], &coarse_size = m_windows[i + 1];
            const ConstImageView level = context.input("levels", i);

            ImageBuffer low(coarse, channels);
            resample(level, {size.x0, size.y0},
                     decimate_axis(size.width(), 1, coarse.x0, coarse.x1),
                     decimate_axis(size.height(), 1, coarse.y0, coarse.y1), 1.0f, low.view(), {});
            const ResampleAxis horizontal =
                interpolate_axis(coarse_size.width(), size.width(), fine.x0, fine.x1);
            const ResampleAxis vertical =
                interpolate_axis(coarse_size.height(), size.height(), fine.y0, fine.y1);
            ImageBuffer recombined = level_pixels(context, i, fine);
            ImageBuffer change(coarse, channels);
            copy_pixels(low.view(), change.view());
            add(result.view(), -1.0f, change.view());
            if (m_limit == Limit::share) {
                add_shares(low.view(), change.view(), horizontal, vertical, recombined.view());
            } else {
                // U is linear: one interpolation of the difference does for both.
                ImageBuffer fine_change(fine, channels);
                resample(change.view(), {}, horizontal, vertical, 1.0f, fine_change.view(), {});
                add(fine_change.view(), 1.0f, recombined.view());
            }
            if (m_limit != Limit::none)
                keep_in_range(level, size, result.view(), horizontal, vertical, recombined.view());
            result = std::move(recombined);
        }
        const ConstImageView finest = context.input("levels", 0);
        const Region& region = context.region();
        for (int y = region.y0; y < region.y1; ++y)
            for (int c = 0; c < channels; ++c) {
                const float* from =
                    result.view().ptr(c, region.x0 - m_windows[0].x0, y - m_windows[0].y0);
                const float* kept = finest.ptr(c, region.x0, y);
                const float* alpha = m_alpha < 0 ? nullptr : finest.ptr(m_alpha, region.x0, y);
                float* to = out.row(c, y);
                for (int x = 0; x < region.width(); ++x) {
                    const bool keep = alpha && (c == m_alpha || !(alpha[x] > 0.0f));
                    to[x] = keep ? kept[x] : from[x];
                }
            }
    }

private:
    /// Pixels of an input level, in coordinates relative to its window.
    ImageBuffer level_pixels(const TileContext& context, std::size_t i, const Region& region) const
    {
        ImageBuffer pixels(region, context.input("levels", i).channels());
        const ConstImageView level = context.input("levels", i);
        const Region& window = m_windows[i];
        for (int y = region.y0; y < region.y1; ++y)
            for (int c = 0; c < pixels.channels(); ++c)
                std::copy_n(level.ptr(c, region.x0 + window.x0, y + window.y0), region.width(),
                            pixels.view().row(c, y));
        return pixels;
    }

    /// to = from + sign · to.
    static void add(ConstImageView from, float sign, ImageView to)
    {
        const Region& region = to.region();
        for (int y = region.y0; y < region.y1; ++y)
            for (int c = 0; c < to.channels(); ++c) {
                const float* a = from.row(c, y);
                float* b = to.row(c, y);
                for (int x = 0; x < region.width(); ++x) b[x] = a[x] + sign * b[x];
            }
    }

    Limit m_limit;
    std::vector<Region> m_windows;
    int m_alpha = -1;
};

RAYLOOM_NODE(Recombine);

} // namespace rayloom
