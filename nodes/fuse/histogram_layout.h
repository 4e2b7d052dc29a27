// SPDX-License-Identifier: Apache-2.0
/// \file
/// Sizes and memory of the sweep of histogram_kernel.cpp.
#pragma once

#include "nodes/fuse/histogram_kernel.h"
#include "nodes/fuse/histogram_rows.h"

#include <algorithm>
#include <vector>

namespace rayloom::histogram_fusion
{

/// Most columns written in one strip. With the default window and 61 channels the rings then take
/// about a megabyte, and the columns read beyond the strip are one in eight.
constexpr int strip_width = 128;

inline int round_up(int n) { return (n + block_size - 1) / block_size * block_size; }
inline std::size_t index(int i) { return static_cast<std::size_t>(i); }

/// Equal strips a region is cut into: as many as work on the fewest columns in all, margins and the
/// lanes that fill their last block included.
inline int strip_count(int width, int margin)
{
    const int least = (width + strip_width - 1) / strip_width;
    const auto columns = [&](int n) { return n * round_up((width + n - 1) / n + 2 * margin); };
    int best = least;
    for (int n = least + 1; n <= least + 2; ++n)
        if (columns(n) < columns(best)) best = n;
    return best;
}

/// Rows of floats, each aligned to 64 bytes.
class Rows
{
public:
    Rows() = default;
    Rows(int rows, int width) : m_buffer(Region{0, 0, round_up(width), std::max(rows, 1)}, 1)
    {
        m_buffer.fill(0.0f);
    }
    float* row(int i) { return m_buffer.view().row(0, i); }
    const float* row(int i) const { return m_buffer.view().row(0, i); }
    std::ptrdiff_t stride() const { return m_buffer.view().row_stride(); }
    void clear(int first, int count)
    {
        std::fill_n(row(first), count * static_cast<int>(stride()), 0.0f);
    }

private:
    ImageBuffer m_buffer;
};

/// Sizes that depend on the settings, the channel counts and the columns written in a strip.
struct Layout {
    Layout(const HistogramFusionSettings& s, int histogram_channels, int image_channels,
           int strip_columns = strip_width)
        : b(s.window_radius), w(s.patch_radius), bins(histogram_channels - 1),
          pairs((bins + 1) / 2), words((pairs + 63) / 64), channels(image_channels),
          margin(2 * w + b), pad(round_up(std::max(b, 1))),
          width(round_up(strip_columns + 2 * margin)), blocks(width / block_size)
    {
        for (int dx = 1; dx <= b; ++dx) half.push_back({dx, 0});
        for (int dy = 1; dy <= b; ++dy)
            for (int dx = -b; dx <= b; ++dx) half.push_back({dx, dy});
    }
    /// Index of (dx, dy) in raster order without (0, 0).
    int offsets() const { return 2 * static_cast<int>(half.size()); }

    int b, w, bins, pairs, words, channels;
    int margin; ///< columns of histograms on either side of the written ones
    int pad;    ///< zeros on either side of a packed row
    int width;  ///< columns of a strip with its margins, in whole blocks
    int blocks;
    std::vector<Offset> half; ///< offsets after (0, 0) in raster order
};

} // namespace rayloom::histogram_fusion
