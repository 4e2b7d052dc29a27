// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/histogram_kernel.h"

#include "nodes/fuse/histogram_layout.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

namespace rayloom
{

namespace
{

using namespace histogram_fusion;

/// Every ring of rows of a sweep.
class Sweep
{
public:
    Sweep(const HistogramFusionSettings& settings, const Region& data, ConstImageView histogram,
          ConstImageView image, int alpha, int strip_columns)
        : m_settings(settings),
          m_layout(settings, histogram.channels(), image.channels(), strip_columns), m_data(data),
          m_histogram(histogram), m_image(image), m_alpha(alpha)
    {
        const Layout& l = m_layout;
        const int padded = l.width + 2 * l.pad;
        const int half = static_cast<int>(l.half.size()), patch_rows = 2 * l.w + 1;
        const int offsets = l.offsets();
        for (int c = 0; c < l.channels; ++c)
            if (c != alpha) m_colour.push_back(c);
        // Runs of an odd number of cache lines, so that the bins of a pixel fall into different
        // cache sets.
        const int lines = padded / block_size;
        m_bins = Rows((l.b + 1) * l.pairs * 2, (lines % 2 == 0 ? lines + 1 : lines) * block_size);
        m_roots = Rows(l.b + 1, padded);
        m_used.assign(index((l.b + 1) * (l.blocks + 2 * l.pad / block_size) * l.words), 0);
        m_counts.assign(index(l.b + 1), 0.0f);
        m_chi = Rows(patch_rows * half, l.width);
        m_chi_bins = Rows(patch_rows * half, l.width);
        m_columns = Rows(2, l.width + 2 * round_up(l.w));
        m_distance = Rows((l.b + 1) * half, l.width + 2 * block_size);
        m_border_distance = Rows(offsets, l.width + block_size);
        m_nothing = Rows(1, l.width + 2 * block_size);
        std::fill_n(m_nothing.row(0), m_nothing.stride(), infinity);
        m_selection = Rows(3, l.width + block_size);
        m_weights = Rows(l.w + 1, l.width + block_size);
        m_accepted = Rows(l.w + 1, l.width + 4 * block_size + 2 * l.w);
        m_shares = Rows(patch_rows * (l.w + 1) * (offsets + 1), l.width);
        m_share_used.assign(index(patch_rows * (offsets + 1)), 0);
        m_share_classes.assign(index(patch_rows), 1);
        m_pixels =
            Rows((2 * l.b + 1) * (static_cast<int>(m_colour.size()) + 1), padded + block_size);
        m_sums = Rows(static_cast<int>(m_colour.size()) + 2, l.width);
        m_out = Rows(static_cast<int>(m_colour.size()), l.width);
        m_list.resize(index(l.pairs));
        m_nearest.resize(index(2 * settings.min_patches * block_size));
    }

    /// Fills the columns and rows of `part`.
    void run(const Region& part, ImageView out, ImageView matches,
             const std::function<void()>& each_row)
    {
        const Layout& l = m_layout;
        m_part = part;
        m_x0 = part.x0 - l.margin;
        const int first = part.y0 - 2 * l.w - l.b, last = part.y1 + 2 * l.w;
        for (int y = first; y < first + l.b; ++y) pack_histogram(y);
        if (!out.empty())
            for (int z = part.y0 - l.b; z < part.y0 + l.b; ++z) pack_pixels(z);
        for (int y = first; y < last; ++y) {
            each_row();
            pack_histogram(y + l.b);
            chi_row(y);
            const int pooled = y - l.w;
            if (pooled >= part.y0 - l.w - l.b) pool_row(pooled);
            if (pooled >= part.y0 - l.w) select_row(pooled, !out.empty(), matches);
            if (const int z = y - 2 * l.w; z >= part.y0 && !out.empty()) {
                pack_pixels(z + l.b);
                average_row(z, out);
            }
        }
    }

private:
    static int modulo(int y, int n) { return (y % n + n) % n; }
    int histogram_slot(int y) const { return modulo(y, m_layout.b + 1); }
    int patch_slot(int y) const { return modulo(y, 2 * m_layout.w + 1); }
    int pixel_slot(int y) const { return modulo(y, 2 * m_layout.b + 1); }
    int half_count() const { return static_cast<int>(m_layout.half.size()); }

    bool has_row(int y) const { return y >= m_data.y0 && y < m_data.y1; }
    /// Distance of a row or column to the border; negative outside.
    int row_distance(int y) const { return std::min(y - m_data.y0, m_data.y1 - 1 - y); }
    int column_distance(int x) const { return std::min(x - m_data.x0, m_data.x1 - 1 - x); }

    HistogramRow histogram_row(int y)
    {
        const Layout& l = m_layout;
        const int slot = histogram_slot(y), all_blocks = l.blocks + 2 * l.pad / block_size;
        HistogramRow row;
        row.bins = m_bins.row(slot * l.pairs * 2) + l.pad;
        row.root = m_roots.row(slot) + l.pad;
        row.used = m_used.data() + (slot * all_blocks + l.pad / block_size) * l.words;
        row.count = m_counts[index(slot)];
        return row;
    }

    void pack_histogram(int y)
    {
        const Layout& l = m_layout;
        const int slot = histogram_slot(y);
        m_roots.clear(slot, 1);
        m_counts[index(slot)] = 0.0f;
        if (!has_row(y)) return;
        const int x0 = std::max(m_x0, m_data.x0);
        const int x1 = std::min(m_part.x1 + l.margin, m_data.x1);
        const int before = l.pad + x0 - m_x0;
        const auto n = index(x1 - x0);
        for (int i = 0; i < 2 * l.pairs; ++i) {
            float* row = m_bins.row(slot * l.pairs * 2 + i);
            std::fill_n(row, m_bins.stride(), 0.0f);
            if (i < l.bins) std::memcpy(row + before, m_histogram.ptr(i, x0, y), n * sizeof(float));
        }
        const float* count = m_histogram.ptr(l.bins, x0, y);
        float* root = m_roots.row(slot) + before;
        float common = 0.0f;
        for (std::size_t i = 0; i < n; ++i) {
            if (!(count[i] > 0.0f)) continue;
            root[i] = std::sqrt(count[i]);
            if (common == 0.0f) common = count[i];
            if (count[i] != common) common = -1.0f;
        }
        m_counts[index(slot)] = common;
        const int all_blocks = l.blocks + 2 * l.pad / block_size;
        histogram_fusion::mark_used(m_bins.row(slot * l.pairs * 2), m_bins.stride(), l.pairs,
                                    all_blocks, l.words,
                                    m_used.data() + slot * all_blocks * l.words);
    }

    void pack_pixels(int y)
    {
        const Layout& l = m_layout;
        const int channels = static_cast<int>(m_colour.size());
        const int first = pixel_slot(y) * (channels + 1);
        m_pixels.clear(first, channels + 1);
        if (!has_row(y)) return;
        const int x0 = std::max(m_part.x0 - l.b, m_data.x0);
        const int x1 = std::min(m_part.x1 + l.b, m_data.x1);
        const int before = l.pad + x0 - m_x0;
        const auto n = index(x1 - x0);
        float* opacity = m_pixels.row(first + channels) + before;
        if (m_alpha >= 0) {
            const float* alpha = m_image.ptr(m_alpha, x0, y);
            for (std::size_t i = 0; i < n; ++i) opacity[i] = alpha[i] > 0.0f ? alpha[i] : 0.0f;
        }
        for (int c = 0; c < channels; ++c) {
            float* row = m_pixels.row(first + c) + before;
            const float* from = m_image.ptr(m_colour[index(c)], x0, y);
            if (m_alpha < 0) {
                std::memcpy(row, from, n * sizeof(float));
            } else {
                for (std::size_t i = 0; i < n; ++i) row[i] = opacity[i] > 0.0f ? from[i] : 0.0f;
            }
        }
    }

    void chi_row(int y)
    {
        const Layout& l = m_layout;
        const int half = half_count(), first = patch_slot(y) * half;
        const HistogramRow here = histogram_row(y);
        for (int begin = 0; begin < half;) {
            const int dy = l.half[index(begin)].dy;
            int end = begin;
            while (end < half && l.half[index(end)].dy == dy) ++end;
            const HistogramRow there = histogram_row(y + dy);
            if (!has_row(y) || !has_row(y + dy) || here.count == 0.0f || there.count == 0.0f) {
                m_chi.clear(first + begin, end - begin);
                m_chi_bins.clear(first + begin, end - begin);
            } else {
                ChiJob job;
                job.here = here;
                job.there = there;
                job.stride = m_bins.stride();
                job.words = l.words;
                job.last_block = l.blocks;
                job.reach_blocks = l.pad / block_size;
                job.offsets = std::span(l.half).subspan(index(begin), index(end - begin));
                job.chi = m_chi.row(first + begin);
                job.bins = m_chi_bins.row(first + begin);
                job.result_stride = m_chi.stride();
                job.list = m_list.data();
                histogram_fusion::chi_row(job);
            }
            begin = end;
        }
    }

    void pool_row(int y)
    {
        const Layout& l = m_layout;
        const int half = half_count(), slot = histogram_slot(y);
        if (!has_row(y)) return;
        const int column_pad = round_up(l.w);
        std::vector<const float*> chi(index(2 * l.w + 1)), bins(index(2 * l.w + 1));
        for (int i = 0; i < half; ++i) {
            const Offset o = l.half[index(i)];
            float* const distance = m_distance.row(slot * half + i);
            const int reach = std::min({l.w, row_distance(y), row_distance(y + o.dy)});
            if (reach < 0) {
                std::fill_n(distance, l.width, infinity);
                continue;
            }
            for (int v = -l.w; v <= l.w; ++v) {
                chi[index(v + l.w)] = m_chi.row(patch_slot(y + v) * half + i);
                bins[index(v + l.w)] = m_chi_bins.row(patch_slot(y + v) * half + i);
            }
            PoolJob job;
            job.chi = chi;
            job.bins = bins;
            job.radius = l.w;
            job.width = l.width;
            job.chi_column = m_columns.row(0) + column_pad;
            job.bins_column = m_columns.row(1) + column_pad;
            job.distance = distance;
            histogram_fusion::pool_row(job);
            shrink_patches(o, reach, chi, bins, distance);
        }
    }

    /// Where the border is nearer than the patch half-size, pools over what is left of the patch.
    void shrink_patches(const Offset& o, int reach, std::span<const float* const> chi,
                        std::span<const float* const> bins, float* distance) const
    {
        const Layout& l = m_layout;
        const auto shrink = [&](int begin, int end) {
            for (int x = std::max(begin, m_x0 + l.w); x < std::min(end, m_part.x1 + l.margin - l.w);
                 ++x) {
                const int r = std::min({reach, column_distance(x), column_distance(x + o.dx)});
                if (r >= l.w) continue;
                float sum = 0.0f, used = 0.0f;
                for (int t = -r; t <= r; ++t) {
                    float column = 0.0f, column_used = 0.0f;
                    for (int v = -r; v <= r; ++v) {
                        column += chi[index(v + l.w)][x + t - m_x0];
                        column_used += bins[index(v + l.w)][x + t - m_x0];
                    }
                    sum += column;
                    used += column_used;
                }
                distance[x - m_x0] = used > 0.0f ? sum / used : infinity;
            }
        };
        if (reach < l.w) {
            shrink(m_x0, m_x0 + l.width);
            return;
        }
        const int near = l.w + l.b; // either pixel of the pair may be the one near the border
        shrink(m_x0, m_data.x0 + near);
        shrink(std::max(m_data.x1 - near, m_data.x0 + near), m_x0 + l.width);
    }

    /// Half-size of the patch of a reference pixel.
    int half_size(int x, int y) const
    {
        return std::min({m_layout.w, row_distance(y), column_distance(x)});
    }

    /// Distances of every candidate of row `y` in raster order; a candidate whose patch would leave
    /// the image is infinitely far.
    void gather_distances(int y)
    {
        const Layout& l = m_layout;
        const int half = half_count();
        m_candidates.assign(index(l.offsets()), nullptr);
        for (int i = 0; i < l.offsets(); ++i) {
            const bool forward = i >= half;
            const Offset o = l.half[index(forward ? i - half : half - 1 - i)];
            const int other = forward ? y : y - o.dy;
            m_candidates[index(i)] = has_row(other)
                                         ? m_distance.row(histogram_slot(other) * half +
                                                          (forward ? i - half : half - 1 - i)) -
                                               (forward ? 0 : o.dx)
                                         : m_nothing.row(0);
        }
        const int near = l.w + l.b;
        const int a0 = m_part.x0 - l.w, a1 = m_part.x1 + l.w;
        const bool rows_touch = row_distance(y) < near;
        if (!rows_touch && column_distance(a0) >= near && column_distance(a1 - 1) >= near) return;
        for (int i = 0; i < l.offsets(); ++i) {
            const bool forward = i >= half;
            Offset o = l.half[index(forward ? i - half : half - 1 - i)];
            if (!forward) o = {-o.dx, -o.dy};
            float* const row = m_border_distance.row(i);
            const float* const from = m_candidates[index(i)];
            std::memcpy(row + a0 - m_x0, from + a0 - m_x0, index(a1 - a0) * sizeof(float));
            for (int x = a0; x < a1; ++x) {
                if (!rows_touch && column_distance(x) >= near) continue;
                const int candidate = std::min(row_distance(y + o.dy), column_distance(x + o.dx));
                if (candidate < half_size(x, y) || candidate < 0) row[x - m_x0] = infinity;
            }
            m_candidates[index(i)] = row;
        }
    }

    void select_row(int y, bool share_them, ImageView matches)
    {
        const Layout& l = m_layout;
        const int slot = patch_slot(y), offsets = l.offsets();
        if (!has_row(y)) {
            std::fill_n(m_share_used.begin() + slot * (offsets + 1), offsets + 1, char{0});
            return;
        }
        gather_distances(y);
        SelectJob select;
        select.distance = m_candidates;
        select.begin = l.margin - l.w;
        select.end = m_part.x1 - m_x0 + l.w;
        select.kappa = m_settings.kappa;
        select.min_patches = m_settings.min_patches;
        select.threshold = m_selection.row(0);
        select.last_tie = m_selection.row(1);
        select.count = m_selection.row(2);
        select.nearest = m_nearest;
        histogram_fusion::select_row(select);
        if (!matches.empty() && y >= m_part.y0 && y < m_part.y1)
            std::copy_n(select.count + l.margin, m_part.width(), matches.ptr(0, m_part.x0, y));
        if (!share_them) return;

        bool full = true;
        for (int x = select.begin; x < select.end; ++x) {
            const int size = half_size(x + m_x0, y);
            full = full && size == l.w;
            for (int m = 0; m <= l.w; ++m)
                m_weights.row(m)[x] = size >= m ? 1.0f / select.count[x] : 0.0f;
        }
        // Lanes beyond the last reference pixel must not weigh in.
        for (int m = 0; m <= l.w; ++m) std::fill_n(m_weights.row(m) + select.end, block_size, 0.0f);

        const int classes = full ? 1 : l.w + 1;
        m_share_classes[index(slot)] = classes;
        std::vector<const float*> weight(index(l.w + 1));
        std::vector<float*> accepted(index(l.w + 1)), share(index(l.w + 1));
        for (int m = 0; m <= l.w; ++m) {
            weight[index(m)] = m_weights.row(m);
            accepted[index(m)] = m_accepted.row(m) + block_size;
        }
        ShareJob job;
        job.begin = select.begin;
        job.end = select.end;
        job.out_begin = l.margin / block_size * block_size;
        job.out_end = l.margin + m_part.width();
        job.threshold = select.threshold;
        job.last_tie = select.last_tie;
        job.weight = weight;
        job.radius = l.w;
        job.classes = classes;
        job.accepted = accepted;
        job.share = share;
        for (int i = 0; i <= offsets; ++i) {
            const int self = offsets / 2;
            const int candidate = i < self ? i : i - 1;
            job.distance = i == self ? nullptr : m_candidates[index(candidate)];
            job.index = static_cast<float>(candidate);
            for (int v = 0; v < classes; ++v) share[index(v)] = share_row(slot, v, i);
            m_share_used[index(slot * (offsets + 1) + i)] =
                histogram_fusion::share_row(job) ? 1 : 0;
        }
    }

    float* share_row(int slot, int vertical, int offset)
    {
        const Layout& l = m_layout;
        return m_shares.row((slot * (l.w + 1) + vertical) * (l.offsets() + 1) + offset);
    }

    void average_row(int z, ImageView out)
    {
        const Layout& l = m_layout;
        const int offsets = l.offsets() + 1, rows = 2 * l.w + 1;
        const int channels = static_cast<int>(m_colour.size());
        m_share_rows.assign(index(offsets * rows), nullptr);
        m_pixel_rows.assign(index(offsets * (channels + 1)), nullptr);
        for (int i = 0; i < offsets; ++i) {
            for (int v = -l.w; v <= l.w; ++v) {
                const int slot = patch_slot(z + v);
                if (!m_share_used[index(slot * offsets + i)]) continue;
                const int vertical = m_share_classes[index(slot)] == 1 ? 0 : (v < 0 ? -v : v);
                m_share_rows[index(i * rows + v + l.w)] = share_row(slot, vertical, i);
            }
            const int dy = i / (2 * l.b + 1) - l.b, dx = i % (2 * l.b + 1) - l.b;
            for (int c = 0; c <= channels; ++c)
                m_pixel_rows[index(i * (channels + 1) + c)] = pixel_row(z + dy, c) + dx;
        }
        std::vector<const float*> input(index(channels + 1));
        std::vector<float*> sums(index(channels + 2)), results(index(channels));
        // Where alpha is zero the premultiplied colour is kept as it came.
        for (int c = 0; c < channels; ++c) input[index(c)] = pixel_row(z, c);
        input[index(channels)] = pixel_row(z, channels);
        for (int c = 0; c < channels + 2; ++c) sums[index(c)] = m_sums.row(c);
        for (int c = 0; c < channels; ++c) results[index(c)] = m_out.row(c);
        AverageJob job;
        job.share = m_share_rows;
        job.rows = rows;
        job.pixels = m_pixel_rows;
        job.channels = channels;
        job.opacity = m_alpha >= 0;
        job.input = input;
        job.self = index(offsets / 2);
        job.begin = l.margin / block_size * block_size;
        job.end = l.margin + m_part.width();
        job.sums = sums;
        job.out = results;
        histogram_fusion::average_row(job);
        for (int c = 0; c < channels; ++c) {
            float* const to = out.ptr(m_colour[index(c)], m_part.x0, z);
            std::copy_n(results[index(c)] + l.margin, m_part.width(), to);
            if (m_alpha >= 0) {
                const float* const alpha = m_image.ptr(m_alpha, m_part.x0, z);
                const float* const from = m_image.ptr(m_colour[index(c)], m_part.x0, z);
                for (int x = 0; x < m_part.width(); ++x)
                    if (!(alpha[x] > 0.0f)) to[x] = from[x];
            }
        }
        if (m_alpha >= 0)
            std::copy_n(m_image.ptr(m_alpha, m_part.x0, z), m_part.width(),
                        out.ptr(m_alpha, m_part.x0, z));
    }

    const float* pixel_row(int y, int channel)
    {
        return m_pixels.row(pixel_slot(y) * (static_cast<int>(m_colour.size()) + 1) + channel) +
               m_layout.pad;
    }

    HistogramFusionSettings m_settings;
    Layout m_layout;
    Region m_data;
    ConstImageView m_histogram, m_image;
    int m_alpha = -1;
    std::vector<int> m_colour;

    Region m_part; ///< written pixels
    int m_x0 = 0;  ///< column of index 0 of the rings

    Rows m_bins, m_roots;
    std::vector<std::uint64_t> m_used;
    std::vector<float> m_counts;
    Rows m_chi, m_chi_bins, m_columns;
    Rows m_distance, m_border_distance, m_nothing;
    Rows m_selection, m_weights, m_accepted, m_shares;
    std::vector<char> m_share_used;
    std::vector<int> m_share_classes;
    Rows m_pixels, m_sums, m_out;
    std::vector<std::uint16_t> m_list;
    std::vector<float> m_nearest;
    std::vector<const float*> m_candidates, m_share_rows, m_pixel_rows;
};

} // namespace

int histogram_fusion_reach(const HistogramFusionSettings& settings)
{
    return settings.window_radius + 2 * settings.patch_radius;
}

std::size_t histogram_fusion_scratch(const HistogramFusionSettings& settings,
                                     int histogram_channels, int image_channels)
{
    const Layout l(settings, histogram_channels, image_channels);
    const auto row = [](int n) { return index(round_up(n)) * sizeof(float); };
    const int half = static_cast<int>(l.half.size()), patch_rows = 2 * l.w + 1;
    return index((l.b + 1) * (2 * l.pairs + 1)) * row(l.width + 2 * l.pad + block_size) +
           index(2 * patch_rows * half) * row(l.width) +
           index((l.b + 3) * half) * row(l.width + 2 * block_size) +
           index(patch_rows * (l.w + 1) * (l.offsets() + 1)) * row(l.width) +
           index((2 * l.b + 1) * (l.channels + 1)) * row(l.width + 2 * l.pad + block_size) +
           index(2 * l.channels + 3 * l.w + 16) * row(l.width + 6 * block_size);
}

void fuse_histogram(const HistogramFusionSettings& settings, const Region& data,
                    ConstImageView histogram, ConstImageView image, int alpha, ImageView out,
                    ImageView matches, const std::function<void()>& each_row)
{
    const Region& all = out.empty() ? matches.region() : out.region();
    const int strips = strip_count(all.width(), settings.window_radius + 2 * settings.patch_radius);
    const int columns = (all.width() + strips - 1) / strips;
    Sweep sweep(settings, data, histogram, image, alpha, columns);
    for (int i = 0; i < strips; ++i) {
        const int x0 = all.x0 + i * all.width() / strips,
                  x1 = all.x0 + (i + 1) * all.width() / strips;
        sweep.run({x0, all.y0, x1, all.y1}, out, matches, each_row);
    }
}

} // namespace rayloom
