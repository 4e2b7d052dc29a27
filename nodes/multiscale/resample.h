// SPDX-License-Identifier: Apache-2.0
/// \file
/// The two separable operators between levels of a Gaussian pyramid: D_s, a Gaussian sampled at
/// the centres of blocks of 2^s pixels, and U, Keys' cubic. Both are a few weighted source pixels
/// for each pixel of an axis, half-sample mirrored at the border, so both are the same code.
#pragma once

#include "rayloom/image/view.h"

#include <vector>

namespace rayloom
{

/// What the pixels [begin, end) of one axis are made from. Source coordinates count from 0.
struct ResampleAxis {
    int begin = 0, end = 0;
    int taps = 0;
    int source_begin = 0, source_end = 0; ///< hull of `source`
    std::vector<int> source;              ///< [end − begin][taps], mirrored into the source
    std::vector<float> weight;            ///< [end − begin][taps], sums to 1
};

/// Pixels of a level: ⌈size / 2^s⌉.
int decimated_size(int size, int scale);

/// D_s along one axis of `size` pixels: σ = 0.55·√(4^s − 1) px, centred on 2^s(i + ½), taps to
/// ⌈σ·√(4 ln 10)⌉ pixels on either side of pixel ⌊2^s(i + ½)⌋ (where the Gaussian is 1 % of its
/// peak). (004_ae1655312894f2a2.txt, section 3.4)
ResampleAxis decimate_axis(int size, int scale, int begin, int end);

/// U along one axis: cubic convolution with a = −½ (Keys 1981) from `source_size` to `size`
/// pixels, centres aligned.
ResampleAxis interpolate_axis(int source_size, int size, int begin, int end);

/// Fills `to` (all channels) with `factor` times the resampled `from`. Pixel coordinates of `to`
/// count from `to_origin`, which the axes' [begin, end) are relative to, those of `from` from
/// `from_origin`.
struct PixelOrigin {
    int x = 0, y = 0;
};
void resample(ConstImageView from, const PixelOrigin& from_origin, const ResampleAxis& horizontal,
              const ResampleAxis& vertical, float factor, ImageView to,
              const PixelOrigin& to_origin);

} // namespace rayloom
