// SPDX-License-Identifier: Apache-2.0
/// \file
/// Structural similarity: Wang, Bovik, Sheikh, Simoncelli, "Image Quality Assessment: From Error
/// Visibility to Structural Similarity", IEEE TIP 13(4), 2004.
#pragma once

#include "rayloom/stats/image_pair.h"

#include <array>
#include <cstddef>
#include <vector>

namespace rayloom
{

/// SSIM with the published constants: 11×11 Gaussian window of σ = 1.5 px, K1 = 0.01, K2 = 0.03,
/// L = 1, on a grey picture: Rec. 709 luminance of the radiance clamped to [0, 1], sRGB-encoded.
/// As in the publication only windows that lie wholly inside the picture count.
class Ssim
{
public:
    static constexpr int radius = 5;

    Ssim();
    /// Whether the windows centred on row y lie inside.
    static bool inside(const Region& window, int y)
    {
        return y >= window.y0 + radius && y < window.y1 - radius && window.width() > 2 * radius;
    }
    /// SSIM in [−1, 1] of the window centres (window.x0 + radius … window.x1 − radius − 1, y) for
    /// y in [y0, y1), rows of window.width() − 2·radius values one after another in `out`; `good`
    /// alike says which centres are pixels that count. Rows must be inside(); the views must hold
    /// them with `radius` rows above and below.
    void rows(const ImagePair& pair, int y0, int y1, double* out, unsigned char* good) const;

private:
    std::vector<double> m_taps;
};

/// sRGB transfer function of a linear value in [0, 1].
double srgb_encode(double linear);

} // namespace rayloom
