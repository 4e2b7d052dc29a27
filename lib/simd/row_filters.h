// SPDX-License-Identifier: Apache-2.0
/// \file
/// Inner loops of filters with a few fixed taps, on rows of `n` floats. Pointers are to the first
/// pixel a tap reads; `out` may be none of the inputs. The same bits on every SIMD target.
#pragma once

#include <array>
#include <cstddef>

namespace rayloom
{

/// out = ((a + b) + (c + d))/4.
void mean_of_four_row(const float* a, const float* b, const float* c, const float* d, float* out,
                      std::size_t n);

/// out = gain·(plus − minus).
void difference_row(const float* plus, const float* minus, float gain, float* out, std::size_t n);

/// What [1 2 1]⊗[1 2 1]/16 takes away: reads pixels −1 to n of the three rows.
void binomial_rest_row(const float* above, const float* here, const float* below, float* out,
                       std::size_t n);

/// out = ((a + e)·1 + (b + d)·4 + c·6)/16.
void spline_row(const float* a, const float* b, const float* c, const float* d, const float* e,
                float* out, std::size_t n);

/// One level of the steerable frame put together: the mean of the low-pass's four corners, and the
/// differences of the upright and of the slanted bands (two taps each).
struct FrameRow {
    std::array<const float*, 4> low;
    std::array<const float*, 4> upright; ///< x −, x +, y −, y +
    std::array<const float*, 4> slanted; ///< likewise
    float upright_gain, slanted_gain;
};
void frame_row(const FrameRow& taps, float* out, std::size_t n);

/// out = high + mean of the 2 × 2 pixels of `above` and `here` that end at the pixel: reads −1 to n
/// − 1.
void add_low_row(const float* high, const float* above, const float* here, float* out,
                 std::size_t n);

} // namespace rayloom
