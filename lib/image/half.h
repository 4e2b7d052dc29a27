// SPDX-License-Identifier: Apache-2.0
/// \file
/// 16-bit floats of image files, to and from float32. The same bits on every processor.
#pragma once

#include <cstddef>
#include <cstdint>

namespace rayloom
{

/// The largest finite half.
inline constexpr float half_max = 65504.0f;

/// Exact; infinities stay, signalling NaNs become quiet.
void half_to_float(const std::uint16_t* from, float* to, std::size_t count);

/// What float_to_half() met.
struct HalfCounts {
    std::size_t overflows = 0;  ///< finite values that round beyond ±65504, stored as ±65504
    std::size_t non_finite = 0; ///< NaN and infinities, stored as such
};

/// Rounds to the nearest half, ties to even. Finite values too large for a half become ±65504
/// rather than an infinity that spreads in later operations, and are counted.
HalfCounts float_to_half(const float* from, std::uint16_t* to, std::size_t count);

} // namespace rayloom
