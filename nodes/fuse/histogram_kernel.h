// SPDX-License-Identifier: Apache-2.0
/// \file
/// The work of fuse.histogram on planar float views: χ² of the sample histograms of all pixel
/// pairs of a search window, pooled over patches, and the average of the patches that match
/// (004_ae1655312894f2a2.txt, equations 3 and 4, Algorithm 1).
///
/// A strip of columns is swept from top to bottom with everything in reach kept in rings of rows
/// that fit the second-level cache. A pair of pixels is compared once: the distance is symmetric.
/// All sums have an order that depends on nothing but the pixel, so neither the region asked for
/// nor the SIMD target changes a bit.
#pragma once

#include "rayloom/image/view.h"

#include <cstddef>
#include <functional>

namespace rayloom
{

struct HistogramFusionSettings {
    float kappa = 1.0f;    ///< a pair of patches matches when pooled χ² / pooled bins < kappa
    int window_radius = 6; ///< candidates lie within this many pixels, per axis
    int patch_radius = 1;  ///< half-size of a patch
    int min_patches = 0;   ///< nearest patches kept besides the patch itself, match or not
};

/// Pixels of `histogram` read beyond a pixel that is written.
int histogram_fusion_reach(const HistogramFusionSettings& settings);

/// Bytes fuse_histogram() allocates.
std::size_t histogram_fusion_scratch(const HistogramFusionSettings& settings,
                                     int histogram_channels, int image_channels);

/// Fills `out` with the fused `image`, and `matches` with the number of accepted patches of each
/// pixel, its own included. Either may be empty; both cover the same region, inside `data`.
/// \param data the whole image's data window: patches shrink and windows are clipped at its border.
/// \param histogram bins, then the sample count as last channel; covers the region grown by
///        histogram_fusion_reach(), clipped to `data`.
/// \param image covers the region grown by the window radius, clipped to `data`.
/// \param alpha index of the alpha channel of `image`, −1 when there is none. It is copied; the
///        other channels are premultiplied with it and averaged with alpha as weight.
/// \param each_row called once per row and strip; may throw to stop.
void fuse_histogram(const HistogramFusionSettings& settings, const Region& data,
                    ConstImageView histogram, ConstImageView image, int alpha, ImageView out,
                    ImageView matches, const std::function<void()>& each_row);

} // namespace rayloom
