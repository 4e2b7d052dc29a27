// SPDX-License-Identifier: Apache-2.0
/// \file
/// Rows of work of the sweep of histogram_kernel.cpp. Each is dispatched to the best SIMD target;
/// lanes run along x, and sums have the same order on all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

namespace rayloom::histogram_fusion
{

/// Columns handled together; a multiple of every vector length.
constexpr int block_size = 16;
constexpr float infinity = std::numeric_limits<float>::infinity();

struct Offset {
    int dx = 0, dy = 0;
};

/// One packed row of histograms: bins in pairs, an absent last one filled with zeros.
struct HistogramRow {
    const float* bins = nullptr;         ///< [bin][stride]
    const float* root = nullptr;         ///< √count, 0 where there are no samples
    const std::uint64_t* used = nullptr; ///< [block][word]: pairs of bins with a value above ½
    float count = 0.0f; ///< count of every pixel that has samples; −1 when they differ, 0: none has
};

/// χ² of a row of pixels with the row `dy` below, for neighbouring offsets.
struct ChiJob {
    HistogramRow here, there;
    std::ptrdiff_t stride = 0; ///< between bins
    int words = 1;             ///< 64-bit words of a block's `used`
    int first_block = 0, last_block = 0, reach_blocks = 0;
    std::span<const Offset> offsets; ///< of one dy
    float* chi = nullptr;            ///< [offset][result_stride]
    float* bins = nullptr;           ///< [offset][result_stride]
    std::ptrdiff_t result_stride = 0;
    std::uint16_t* list = nullptr; ///< room for every pair of bins
};

/// Pools rows of χ² over patches.
struct PoolJob {
    std::span<const float*const> chi, bins; ///< 2·radius + 1 rows
    int radius = 1;
    int width = 0;
    float* chi_column = nullptr; ///< scratch rows, `radius` zeros on both sides
    float* bins_column = nullptr;
    float* distance = nullptr;
};

/// Counts the matches of a row.
struct SelectJob {
    std::span<const float* const> distance; ///< per offset in raster order
    int begin = 0, end = 0;
    float kappa = 1.0f;
    int min_patches = 0;
    float* threshold = nullptr; ///< a candidate is accepted below it …
    float* last_tie = nullptr;  ///< … or at it up to this index
    float* count = nullptr;
    std::span<float> nearest; ///< scratch: 2 · min_patches blocks
};

/// Weights one offset's accepted candidates give to the pixels of the patch.
struct ShareJob {
    const float* distance = nullptr; ///< null for the pixel itself
    float index = 0.0f;
    int begin = 0, end = 0;         ///< reference pixels
    int out_begin = 0, out_end = 0; ///< pixels that are written
    const float* threshold = nullptr;
    const float* last_tie = nullptr;
    std::span<const float* const>
        weight; ///< [m]: 1/count where the half-size is at least m, else 0
    int radius = 1;
    int classes = 1;                  ///< 1: every pixel has the full half-size
    std::span<float* const> accepted; ///< scratch, one row per class, `radius` zeros either side
    std::span<float* const> share;    ///< result, one row per vertical distance class
};

/// Averages one output row.
struct AverageJob {
    /// [offset][2·radius + 1] rows of weights; null where all are zero.
    std::span<const float* const> share;
    int rows = 3;
    std::span<const float* const> pixels; ///< [offset][channels + 1]; opacity last
    int channels = 3;
    bool opacity = false;
    std::span<const float* const> input; ///< [channels + 1] at the written pixel
    std::size_t self = 0;                ///< index of offset (0, 0)
    int begin = 0, end = 0;
    std::span<float* const> sums; ///< [channels + 2] scratch rows
    std::span<float* const> out;  ///< [channels] rows
};

/// χ² of a row of pixels with their neighbours at each offset of the job.
void chi_row(const ChiJob& job);

/// Bit per pair of bins that has a value above ½ somewhere in the block: without one no sum of two
/// pixels' bins can exceed 1.
void mark_used(const float* bins, std::ptrdiff_t stride, int pairs, int blocks, int words,
               std::uint64_t* used);

/// Distances of patches from the χ² of their pixels.
void pool_row(const PoolJob& job);

/// Which candidates match.
void select_row(const SelectJob& job);

/// Returns whether any weight is not zero.
bool share_row(const ShareJob& job);

/// The fused pixels.
void average_row(const AverageJob& job);

} // namespace rayloom::histogram_fusion
