// SPDX-License-Identifier: Apache-2.0
/// \file
/// Rows of deep pixels: any number of samples per pixel.
#pragma once

#include "rayloom/image/region.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace rayloom
{

/// One row of deep pixels, sample values channel by channel.
struct DeepRow {
    std::vector<std::uint32_t>
        first; ///< width + 1 offsets: samples of pixel i are [first[i], first[i+1])
    std::vector<std::vector<float>> samples; ///< [channel][first.back()]

    std::size_t bytes() const;
    /// Samples of one channel of the i-th pixel of the row.
    std::span<const float> pixel(int channel, int i) const
    {
        const auto a = first[static_cast<std::size_t>(i)],
                   b = first[static_cast<std::size_t>(i) + 1];
        return {samples[static_cast<std::size_t>(channel)].data() + a, b - a};
    }
};

/// Deep rows [region.y0, region.y1), each `region.width()` pixels wide.
struct DeepView {
    Region region;
    int channels = 0;
    std::span<const std::shared_ptr<const DeepRow>> rows;

    const DeepRow& row(int y) const { return *rows[static_cast<std::size_t>(y - region.y0)]; }
};

} // namespace rayloom
