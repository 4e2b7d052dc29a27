// SPDX-License-Identifier: Apache-2.0
/// \file
/// Rows over any region, whether the image reaches that far or not.
#pragma once

#include "rayloom/image/view.h"

#include <vector>

namespace rayloom
{

/// Rows of an operand over the region being computed: of an image, with zeros where the region
/// leaves its data window, or of one constant per channel.
class Rows
{
public:
    Rows(const ConstImageView& image, const Region& region);
    Rows(const std::vector<float>& constants, const Region& region);

    /// region.width() floats, valid until the next call.
    const float* row(int channel, int y)
    {
        if (m_constant) return m_scratch.data() + static_cast<std::size_t>(channel) * m_width;
        if (y >= m_inside.y0 && y < m_inside.y1 && m_inside.x0 == m_region.x0 &&
            m_inside.x1 == m_region.x1)
            return m_image.ptr(channel, m_region.x0, y);
        return padded(channel, y);
    }

private:
    const float* padded(int channel, int y);

    ConstImageView m_image;
    Region m_region;
    Region m_inside; ///< where there are pixels
    std::size_t m_width = 0;
    bool m_constant = false;
    std::vector<float> m_scratch;
};

} // namespace rayloom
