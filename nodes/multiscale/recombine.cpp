// SPDX-License-Identifier: Apache-2.0
#include "nodes/multiscale/resample.h"

#include "rayloom/core/registry.h"

#include <string>

namespace rayloom
{

namespace
{

/// Regions of every level (relative to its data window) that one region of the finest depends on.
struct LevelRegions {
    std::vector<Region> result; ///< recombined pixels
    std::vector<Region> source; ///< pixels of the input level
};

LevelRegions level_regions(const std::vector<Region>& windows, const Region& region)
{
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
            fine.hull({dh.source_begin, dv.source_begin, dh.source_end, dv.source_end});
        regions.result[i + 1] = regions.source[i + 1] = coarse;
    }
    return regions;
}

} // namespace

/// Puts filtered scales together again.
class Recombine final : public Node
{
public:
    struct Params {
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
                "The bicubic overshoots, so that next to strong edges the result can be slightly "
                "negative although no level is; it is not clamped, which would change the mean. "
                "An alpha channel is that of the finest level, and where it is 0 the colour is "
                "too.")
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
    }

    explicit Recombine(const Params&) {}

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
        context.needs("levels", [windows = m_windows](const Need& need) {
            const Region& window = windows.at(need.input_element);
            return level_regions(windows, need.region)
                .source[need.input_element]
                .shifted(window.x0, window.y0);
        });
    }

    void compute(const TileContext& context) const override
    {
        const ImageView out = context.output("image");
        const LevelRegions regions = level_regions(m_windows, context.region());
        const int channels = out.channels();
        const std::size_t last = m_windows.size() - 1;

        // `result` holds the recombined level i + 1; level i is made from it.
        ImageBuffer result = level_pixels(context, last, regions.result[last]);
        for (std::size_t i = last; i-- > 0;) {
            context.check_cancelled();
            const Region &fine = regions.result[i], &coarse = regions.result[i + 1];
            const Region &size = m_windows[i], &coarse_size = m_windows[i + 1];
            const ConstImageView level = context.input("levels", i);

            // U is linear: one interpolation of the difference does for both.
            ImageBuffer low(coarse, channels);
            resample(level, {size.x0, size.y0},
                     decimate_axis(size.width(), 1, coarse.x0, coarse.x1),
                     decimate_axis(size.height(), 1, coarse.y0, coarse.y1), 1.0f, low.view(), {});
            add(result.view(), -1.0f, low.view());
            ImageBuffer change(fine, channels);
            resample(low.view(), {},
                     interpolate_axis(coarse_size.width(), size.width(), fine.x0, fine.x1),
                     interpolate_axis(coarse_size.height(), size.height(), fine.y0, fine.y1), 1.0f,
                     change.view(), {});
            result = level_pixels(context, i, fine);
            add(change.view(), 1.0f, result.view());
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

    std::vector<Region> m_windows;
    int m_alpha = -1;
};

RAYLOOM_NODE(Recombine);

} // namespace rayloom
