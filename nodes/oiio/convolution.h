// SPDX-License-Identifier: Apache-2.0
/// \file
/// Convolution on planar pixels, with the operations of ImageBufAlgo::convolve in their order.
#pragma once

#include "rayloom/image/view.h"

#include <vector>

namespace rayloom::oiio
{

/// Weights around a pixel.
struct Kernel {
    Region window; ///< offsets from the pixel
    int channels = 1;
    std::vector<float> weights; ///< [channel][y][x]
    float scale = 1.0f;         ///< what the weighted sum is multiplied by
};

/// Fills `out` with scale · Σ weight · pixel, summed in float row by row. `data` and `display` are
/// the windows of the whole image: beyond the data window the nearest pixel of the display window
/// counts, or zero where that is no pixel either. `in` covers the data window's part of
/// with_clamped_border(out.region() grown by the kernel). A kernel of one channel serves all.
void convolve(const ConstImageView& in, const Region& data, const Region& display,
              const Kernel& kernel, const ImageView& out);

} // namespace rayloom::oiio
