// SPDX-License-Identifier: Apache-2.0
/// \file
/// Bands of multiscale.steerable at one pixel, from the definition in
/// docs/methods/bayesian-wavelet.md, in double.
#pragma once

#include <functional>

namespace rayloom::oracle
{

/// The image at any integer position (mirrored beyond its edges).
using PixelFunction = std::function<double(int x, int y)>;

/// x − A₁*A₁ x.
double steerable_high(const PixelFunction& image, int x, int y);
/// Mean of squares, `level` times after the first.
double steerable_low(const PixelFunction& image, int level, int x, int y);
/// Orientation 0: along x, 1: falling diagonal, 2: along y, 3: rising diagonal.
double steerable_oriented(const PixelFunction& image, int level, int orientation, int x, int y);

} // namespace rayloom::oracle
