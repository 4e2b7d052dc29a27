// SPDX-License-Identifier: Apache-2.0
/// \file
/// Views over planar float32 pixels and the buffer that owns them.
///
/// Layout: row by row, in each row one contiguous run of pixels per channel
/// (`[y][channel][x]`), every run starting on a 64-byte boundary. A row of all channels is one
/// block of memory, so that a buffer can slide over an image row by row, and a kernel sees plain
/// `float*` runs it can vectorise.
#pragma once

#include "rayloom/image/region.h"

#include <cassert>
#include <cstddef>
#include <memory>
#include <span>
#include <type_traits>

namespace rayloom
{

/// A rectangle of pixels somebody else owns. Cheap to copy.
template <class T>
class BasicImageView
{
public:
    BasicImageView() = default;
    /// `data` points at channel 0 of pixel (region.x0, region.y0). Strides count elements.
    BasicImageView(T* data, const Region& region, int channels, std::ptrdiff_t row_stride,
                   std::ptrdiff_t channel_stride)
        : m_data(data), m_region(region), m_channels(channels), m_row_stride(row_stride),
          m_channel_stride(channel_stride)
    {
    }
    /// A view to write through serves wherever one to read is asked for.
    template <class U>
    requires std::is_same_v<T, const U> BasicImageView(const BasicImageView<U>& o)
        : m_data(o.data()), m_region(o.region()), m_channels(o.channels()),
          m_row_stride(o.row_stride()), m_channel_stride(o.channel_stride())
    {
    }

    const Region& region() const { return m_region; }
    int channels() const { return m_channels; }
    T* data() const { return m_data; }
    std::ptrdiff_t row_stride() const { return m_row_stride; }
    std::ptrdiff_t channel_stride() const { return m_channel_stride; }
    bool empty() const { return m_data == nullptr || m_region.empty(); }

    /// Pointer to pixel (x, y) of a channel; pixels to its right follow it in memory.
    T* ptr(int channel, int x, int y) const
    {
        assert(channel >= 0 && channel < m_channels);
        assert(x >= m_region.x0 && x <= m_region.x1 && y >= m_region.y0 && y < m_region.y1);
        return m_data + (y - m_region.y0) * m_row_stride + channel * m_channel_stride +
               (x - m_region.x0);
    }
    /// Pointer to the first pixel (x = region().x0) of a row.
    T* row(int channel, int y) const { return ptr(channel, m_region.x0, y); }
    std::span<T> row_span(int channel, int y) const
    {
        return {row(channel, y), static_cast<std::size_t>(m_region.width())};
    }
    T& at(int channel, int x, int y) const { return *ptr(channel, x, y); }

    /// The part of this view inside `part`, which must lie inside region().
    BasicImageView crop(const Region& part) const
    {
        assert(m_region.contains(part));
        if (part.empty()) return {};
        return {ptr(0, part.x0, part.y0), part, m_channels, m_row_stride, m_channel_stride};
    }
    /// `count` channels from `first` on.
    BasicImageView channel_range(int first, int count) const
    {
        assert(first >= 0 && count >= 0 && first + count <= m_channels);
        return {m_data + first * m_channel_stride, m_region, count, m_row_stride, m_channel_stride};
    }

private:
    T* m_data = nullptr;
    Region m_region;
    int m_channels = 0;
    std::ptrdiff_t m_row_stride = 0;
    std::ptrdiff_t m_channel_stride = 0;
};

using ImageView = BasicImageView<float>;
using ConstImageView = BasicImageView<const float>;

/// Owns the pixels of a view. Movable, not copyable (copies of images should be seen in the code).
class ImageBuffer
{
public:
    ImageBuffer() = default;
    /// Uninitialised pixels. Throws MemoryError when there is no memory for them.
    ImageBuffer(const Region& region, int channels);

    ImageView view() { return m_view; }
    ConstImageView view() const { return m_view; }
    const Region& region() const { return m_view.region(); }
    int channels() const { return m_view.channels(); }
    std::size_t bytes() const { return m_bytes; }
    bool empty() const { return m_view.empty(); }

    void fill(float value);
    /// Another shape, pixels undefined; memory is taken anew only when there is too little.
    void reshape(const Region& region, int channels);
    /// Bytes an ImageBuffer of this shape takes.
    static std::size_t bytes_for(const Region& region, int channels);
    /// Elements between two channel runs of a row `width` pixels wide (padded to 64 bytes).
    static std::ptrdiff_t padded_width(int width);

private:
    struct Free {
        void operator()(float* p) const noexcept;
    };
    std::unique_ptr<float[], Free> m_pixels;
    ImageView m_view;
    std::size_t m_bytes = 0;
};

/// Copies the pixels of `to.region()`; `from` must cover it and have as many channels.
void copy_pixels(ConstImageView from, ImageView to);

} // namespace rayloom
