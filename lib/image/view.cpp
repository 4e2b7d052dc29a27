// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/view.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"

#include <cstdlib>
#include <cstring>

namespace rayloom
{

namespace
{
constexpr std::size_t alignment = 64;
}

void ImageBuffer::Free::operator()(float* p) const noexcept { std::free(p); }

std::ptrdiff_t ImageBuffer::padded_width(int width)
{
    constexpr std::ptrdiff_t lanes = alignment / sizeof(float);
    return (static_cast<std::ptrdiff_t>(width) + lanes - 1) / lanes * lanes;
}

std::size_t ImageBuffer::bytes_for(const Region& region, int channels)
{
    return static_cast<std::size_t>(padded_width(region.width())) *
           static_cast<std::size_t>(region.height()) * static_cast<std::size_t>(channels) *
           sizeof(float);
}

ImageBuffer::ImageBuffer(const Region& region, int channels) : m_bytes(bytes_for(region, channels))
{
    if (m_bytes == 0) {
        m_view = ImageView(nullptr, region, channels, 0, 0);
        return;
    }
    m_pixels.reset(static_cast<float*>(std::aligned_alloc(alignment, m_bytes)));
    if (!m_pixels)
        throw MemoryError("no memory for an image of " + region.text() + " with " +
                          std::to_string(channels) + " channels (" + format_bytes(m_bytes) + ")");
    const std::ptrdiff_t channel_stride = padded_width(region.width());
    m_view = ImageView(m_pixels.get(), region, channels, channel_stride * channels, channel_stride);
}

void ImageBuffer::reshape(const Region& region, int channels)
{
    if (bytes_for(region, channels) > m_bytes || !m_pixels) {
        *this = ImageBuffer(region, channels);
        return;
    }
    const std::ptrdiff_t channel_stride = padded_width(region.width());
    m_view = ImageView(m_pixels.get(), region, channels, channel_stride * channels, channel_stride);
}

void ImageBuffer::fill(float value) { std::fill_n(m_pixels.get(), m_bytes / sizeof(float), value); }

void copy_pixels(ConstImageView from, ImageView to)
{
    const Region& r = to.region();
    if (r.empty()) return;
    const auto bytes = static_cast<std::size_t>(r.width()) * sizeof(float);
    for (int y = r.y0; y < r.y1; ++y)
        for (int c = 0; c < to.channels(); ++c)
            std::memcpy(to.row(c, y), from.ptr(c, r.x0, y), bytes);
}

} // namespace rayloom
