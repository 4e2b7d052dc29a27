// SPDX-License-Identifier: Apache-2.0
/// \file
/// Colours for scalar images.
#pragma once

#include "rayloom/image/view.h"

#include <array>

namespace rayloom
{

/// The colour of a value in [0, 1] (clamped to it; NaN as 0), sRGB-encoded in [0, 1]. From near
/// black over blue, purple and orange to pale yellow along a curve in CIELAB, walked at constant
/// speed: equal steps of the value are equal steps of the eye, lightness only rises (so it reads
/// in grey print), and no two parts of it are told apart by red against green alone.
std::array<float, 3> map_colour(double value);

/// A scalar image in colour: channel 0 of `image`, `low` … `high` spread over the map. Three
/// sRGB-encoded channels in [0, 1], for an 8-bit picture. Precondition: high > low.
ImageBuffer map_colours(ConstImageView image, double low, double high);

} // namespace rayloom
