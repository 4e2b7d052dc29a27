// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/rows.h"

#include <algorithm>

namespace rayloom
{

Rows::Rows(const ConstImageView& image, const Region& region)
    : m_image(image), m_region(region),
      m_inside(image.empty() ? Region{} : region.intersect(image.region())),
      m_width(static_cast<std::size_t>(region.width()))
{
}

Rows::Rows(const std::vector<float>& constants, const Region& region)
    : m_region(region), m_width(static_cast<std::size_t>(region.width())), m_constant(true)
{
    m_scratch.resize(constants.size() * m_width);
    for (std::size_t c = 0; c < constants.size(); ++c)
        std::fill_n(m_scratch.data() + c * m_width, m_width, constants[c]);
}

const float* Rows::padded(int channel, int y)
{
    m_scratch.assign(m_width, 0.0f);
    if (y >= m_inside.y0 && y < m_inside.y1)
        std::copy_n(m_image.ptr(channel, m_inside.x0, y), m_inside.width(),
                    m_scratch.data() + (m_inside.x0 - m_region.x0));
    return m_scratch.data();
}

} // namespace rayloom
