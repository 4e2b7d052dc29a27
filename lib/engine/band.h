// SPDX-License-Identifier: Apache-2.0
/// \file
/// The rows of a stream that are in memory: a window that slides down the image.
#pragma once

#include "rayloom/image/deep.h"
#include "rayloom/image/view.h"

#include <memory>
#include <optional>
#include <vector>

namespace rayloom
{

/// Consecutive rows of an image, all its channels, columns [columns.x0, columns.x1).
class Band
{
public:
    Band() = default;
    Band(int channels, int x0, int x1) : m_channels(channels), m_x0(x0), m_x1(x1) {}
    /// All rows of an image that belongs to someone else; they are there for as long as it is.
    explicit Band(const ConstImageView& lent)
        : m_channels(lent.channels()), m_x0(lent.region().x0), m_x1(lent.region().x1),
          m_lo(lent.region().y0), m_hi(lent.region().y1), m_lent(lent)
    {
    }

    /// Rows held now; empty region when none.
    Region held() const { return {m_x0, m_lo, m_x1, m_hi}; }
    /// Makes room for rows [lo, hi) beside those held already; new rows are not initialised. Both
    /// together must be one interval. `reserve`: rows the band will come to hold; memory for them
    /// is set aside at once, so that a band that grows to the whole image is never copied.
    void extend(int lo, int hi, int reserve = 0);
    /// Forgets rows outside [lo, hi); frees the memory when none is left.
    void keep(int lo, int hi);

    ConstImageView view() const;
    /// Precondition: the band's own rows, not lent ones.
    ImageView view();
    std::size_t bytes() const { return m_buffer.bytes(); }
    /// Bytes extend() would leave allocated; for the planner.
    static std::size_t bytes_for(int channels, int width, int rows);

private:
    int m_channels = 0, m_x0 = 0, m_x1 = 0;
    int m_lo = 0, m_hi = 0;
    int m_base = 0; ///< image row of the buffer's first row
    ImageBuffer m_buffer;
    std::optional<ConstImageView> m_lent;
};

/// The same for deep rows.
class DeepBand
{
public:
    bool has(int y) const { return y >= m_lo && y < m_lo + static_cast<int>(m_rows.size()); }
    void set_window(const Region& window, int channels);
    void extend(int lo, int hi);
    void put(int y, DeepRow row);
    void keep(int lo, int hi);
    Region held() const;
    DeepView view() const;
    std::size_t bytes() const;

private:
    Region m_window;
    int m_channels = 0;
    int m_lo = 0;
    std::vector<std::shared_ptr<const DeepRow>> m_rows;
};

} // namespace rayloom
