// SPDX-License-Identifier: Apache-2.0
/// \file
/// Sizes, parts and ids of rows of deep pixels.
///
/// A float holds integers to 2^24 only, an id may have 32 bits. So a row may carry, after the
/// channels of its description, one more for each channel of ids, in their order: what the id has
/// more than the float nearest to it. Value and remainder together are the id, exactly. Who does
/// not know of this sees the nearest float.
#pragma once

#include "rayloom/image/deep.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace rayloom
{

/// Bytes of a row.
std::size_t deep_row_bytes(int width, int channels, std::size_t samples);

/// Whether a row has this width, at least these channels, and sizes that agree with one another.
bool deep_row_fits(const DeepRow& row, int width, int channels);

/// Pixels [begin, end) of a row.
DeepRow deep_columns(const DeepRow& row, int begin, int end);

/// Adds a channel of ids: the nearest floats as the next channel of `row`, what they lack to
/// `remainders`, which the caller appends after the last channel.
void add_id_channel(DeepRow& row, std::span<const std::uint32_t> ids,
                    std::vector<std::vector<float>>& remainders);

/// The id of a value and its remainder; 0 for what is no id.
std::uint32_t id_of(float value, float remainder);

} // namespace rayloom
