// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/band.h"

#include <algorithm>
#include <cstring>

namespace rayloom
{

std::size_t Band::bytes_for(int channels, int width, int rows)
{
    return ImageBuffer::bytes_for({0, 0, width, rows}, channels);
}

void Band::extend(int lo, int hi, int reserve)
{
    if (hi <= lo) return;
    const bool fresh = m_hi <= m_lo;
    const int new_lo = fresh ? lo : std::min(lo, m_lo), new_hi = fresh ? hi : std::max(hi, m_hi);
    const int rows = new_hi - new_lo;
    const int capacity = m_buffer.region().height();
    if (rows > capacity) {
        ImageBuffer larger({m_x0, new_lo, m_x1, new_lo + std::max(rows, reserve)}, m_channels);
        if (!fresh) copy_pixels(view(), larger.view().crop(held()));
        m_buffer = std::move(larger);
        m_base = new_lo;
    } else if (new_lo < m_base || new_hi > m_base + capacity) {
        if (!fresh) {
            // Rows are one block each, so that the window slides by one move.
            const ImageView all = m_buffer.view();
            const auto row = static_cast<std::size_t>(all.row_stride());
            std::memmove(all.data() + static_cast<std::size_t>(m_lo - new_lo) * row,
                         all.data() + static_cast<std::size_t>(m_lo - m_base) * row,
                         static_cast<std::size_t>(m_hi - m_lo) * row * sizeof(float));
        }
        m_base = new_lo;
    }
    m_lo = new_lo;
    m_hi = new_hi;
}

void Band::keep(int lo, int hi)
{
    m_lo = std::max(m_lo, lo);
    m_hi = std::min(m_hi, hi);
    if (m_hi <= m_lo) {
        m_lo = m_hi = 0;
        m_buffer = ImageBuffer();
    }
}

ConstImageView Band::view() const { return m_lent ? *m_lent : const_cast<Band*>(this)->view(); }

ImageView Band::view()
{
    if (m_hi <= m_lo) return ImageView(nullptr, {m_x0, 0, m_x1, 0}, m_channels, 0, 0);
    const ImageView all = m_buffer.view();
    return ImageView(all.data() + (m_lo - m_base) * all.row_stride(), held(), m_channels,
                     all.row_stride(), all.channel_stride());
}

void DeepBand::set_window(const Region& window, int channels)
{
    m_window = window;
    m_channels = channels;
}

Region DeepBand::held() const
{
    return {m_window.x0, m_lo, m_window.x1, m_lo + static_cast<int>(m_rows.size())};
}

void DeepBand::extend(int lo, int hi)
{
    if (hi <= lo) return;
    if (m_rows.empty()) {
        m_lo = lo;
        m_rows.resize(static_cast<std::size_t>(hi - lo));
        return;
    }
    const int end = m_lo + static_cast<int>(m_rows.size());
    if (lo < m_lo) m_rows.insert(m_rows.begin(), static_cast<std::size_t>(m_lo - lo), nullptr);
    m_lo = std::min(m_lo, lo);
    if (hi > end) m_rows.resize(static_cast<std::size_t>(hi - m_lo));
}

void DeepBand::put(int y, DeepRow row)
{
    m_rows[static_cast<std::size_t>(y - m_lo)] = std::make_shared<const DeepRow>(std::move(row));
}

void DeepBand::keep(int lo, int hi)
{
    const int end = m_lo + static_cast<int>(m_rows.size());
    const int a = std::max(m_lo, lo), b = std::min(end, hi);
    if (b <= a) {
        m_rows.clear();
        m_rows.shrink_to_fit();
        return;
    }
    m_rows.resize(static_cast<std::size_t>(b - m_lo));
    m_rows.erase(m_rows.begin(), m_rows.begin() + (a - m_lo));
    m_lo = a;
}

DeepView DeepBand::view() const { return {held(), m_channels, m_rows}; }

std::size_t DeepBand::bytes() const
{
    std::size_t n = 0;
    for (const auto& row : m_rows)
        if (row) n += row->bytes();
    return n;
}

} // namespace rayloom
