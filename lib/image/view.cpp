// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/view.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <sys/mman.h>

namespace rayloom
{

namespace
{
constexpr std::size_t alignment = 64;
constexpr std::size_t huge_page = std::size_t{2} << 20;

/// Large buffers are asked for in huge pages: the first touch of a 4 KiB page costs more than
/// reading what is then written to it. The kernel takes it as a wish.
float* allocate(std::size_t bytes)
{
    const bool large = bytes >= 2 * huge_page;
    const std::size_t unit = large ? huge_page : alignment;
    void* memory = std::aligned_alloc(unit, (bytes + unit - 1) / unit * unit);
#ifdef MADV_HUGEPAGE
    if (memory && large) madvise(memory, bytes, MADV_HUGEPAGE);
#endif
    return static_cast<float*>(memory);
}
} // namespace

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
    m_pixels.reset(allocate(m_bytes));
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
