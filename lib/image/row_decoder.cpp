// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/row_decoder.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"
#include "rayloom/image/image_input.h"

#include <algorithm>
#include <new>
#include <string_view>

namespace rayloom
{

namespace
{
// Decoded rows held at a time: enough for every decoding thread to have blocks of its own. Readers
// that share rows hold together what each would have held, up to a few.
constexpr std::size_t one_band_bytes = std::size_t{32} << 20;
constexpr std::size_t most_bands = 4;
} // namespace

bool same_layout(const OIIO::ImageSpec& a, const OIIO::ImageSpec& b)
{
    return a.x == b.x && a.y == b.y && a.width == b.width && a.height == b.height &&
           a.nchannels == b.nchannels && a.channelformats == b.channelformats &&
           a.format == b.format;
}

RowDecoder::RowDecoder(std::shared_ptr<const ImageFile> file, int part, int first, int end)
    : m_file(std::move(file)), m_part(m_file->parts()[static_cast<std::size_t>(part)]),
      m_first(first), m_end(end)
{
    const OIIO::ImageSpec& spec = *m_part.spec;
    const auto type = [&](int c) {
        return static_cast<OIIO::TypeDesc::BASETYPE>(spec.channelformat(c).basetype);
    };
    m_native = std::string_view(m_file->format()) == "openexr";
    for (int c = first; c < end; ++c)
        m_native =
            m_native && (type(c) == OIIO::TypeDesc::HALF || type(c) == OIIO::TypeDesc::FLOAT ||
                         type(c) == OIIO::TypeDesc::UINT32);
    for (int c = first; c < end; ++c) {
        m_channels.push_back({m_pixel_bytes, m_native ? type(c) : OIIO::TypeDesc::FLOAT});
        m_pixel_bytes += m_native ? spec.channelformat(c).size() : sizeof(float);
    }
}

void RowDecoder::join(const void* reader)
{
    const auto held = lock();
    m_readers.emplace(reader, Reader{});
}

void RowDecoder::leave(const void* reader)
{
    const auto held = lock();
    m_readers.erase(reader);
}

std::size_t RowDecoder::readers() const
{
    const auto held = lock();
    return m_readers.size();
}

void RowDecoder::expect_readers()
{
    const auto held = lock();
    for (auto& [reader, state] : m_readers) state.open = true;
}

OIIO::ImageInput& RowDecoder::input()
{
    if (m_input) return *m_input;
    m_input = open_input(m_file->path());
    // The file may have been replaced since its header was read.
    if (!m_input->seek_subimage(m_part.index, 0) ||
        !same_layout(m_input->spec_dimensions(m_part.index, 0), *m_part.spec)) {
        m_input.reset();
        fail_input(m_file->path(), "changed while it was being read");
    }
    return *m_input;
}

void RowDecoder::fail_rows(int y0, int y1, const std::string& layer, std::string why) const
{
    const std::string of = layer.empty() ? "" : " of '" + layer + "'";
    fail_input(m_file->path(), "rows " + std::to_string(y0) + " to " + std::to_string(y1 - 1) + of +
                                   " cannot be read (the file is truncated or corrupt): " +
                                   plain_message(std::move(why), m_file->path()));
}

const Region& RowDecoder::decode(const Region& want, int y, const std::string& layer)
{
    if (m_decoded.contains(Region{want.x0, y, want.x1, y + 1})) return m_decoded;
    const OIIO::ImageSpec& spec = *m_part.spec;
    const Region& data = m_part.data;
    const int chunk = m_part.chunk_rows, tile = spec.tile_width;
    Region blocks = data; // scanlines are always decoded whole
    // Tiles of EXR are decoded in place where whole ones are asked for, even beyond the image;
    // the library would otherwise go through a copy.
    const bool whole_tiles = m_native && tile > 0;
    if (tile > 0) {
        blocks.x0 = data.x0 + (want.x0 - data.x0) / tile * tile;
        blocks.x1 = data.x0 + (want.x1 - data.x0 + tile - 1) / tile * tile;
        if (!whole_tiles) blocks.x1 = std::min(blocks.x1, data.x1);
    }
    const std::int64_t at_once = blocks_at_once(blocks.width());
    blocks.y0 = data.y0 + (y - data.y0) / chunk * chunk;
    // Whole blocks up to the last row wanted, and at least the one this row is in.
    const std::int64_t wanted = (std::int64_t{want.y1} - blocks.y0 + chunk - 1) / chunk;
    const std::int64_t last = blocks.y0 + std::clamp<std::int64_t>(wanted, 1, at_once) * chunk;
    blocks.y1 = static_cast<int>(whole_tiles ? last : std::min<std::int64_t>(data.y1, last));
    decode_blocks(blocks, layer);
    return m_decoded;
}

std::int64_t RowDecoder::blocks_at_once(int width) const
{
    const std::size_t block = static_cast<std::size_t>(width) *
                              static_cast<std::size_t>(m_part.chunk_rows) * m_pixel_bytes;
    return static_cast<std::int64_t>(
        std::clamp<std::size_t>(band_bytes(m_readers.size()) / block, 2, std::size_t{1} << 16));
}

std::size_t RowDecoder::band_bytes(std::size_t readers)
{
    return one_band_bytes * std::clamp<std::size_t>(readers, 1, most_bands);
}

int RowDecoder::rows_at_once() const
{
    const auto held = lock();
    return static_cast<int>(std::min<std::int64_t>(
        blocks_at_once(m_part.data.width()) * m_part.chunk_rows, std::int64_t{1} << 30));
}

void RowDecoder::decode_blocks(const Region& blocks, const std::string& layer)
{
    OIIO::ImageInput& file = input();
    m_decoded = {};
    const std::size_t bytes = blocks.pixels() * m_pixel_bytes;
    if (bytes > m_capacity) {
        free_rows();
        m_pixels.reset(new (std::nothrow) std::byte[bytes]);
        if (!m_pixels)
            throw MemoryError(m_file->path() + ": no memory for " + format_bytes(bytes) +
                              " of decoded rows");
        m_capacity = bytes;
    }
    std::byte* const to = m_pixels.get();
    const int part = m_part.index;
    bool ok = false;
    std::string why;
    try {
        if (m_part.spec->tile_width > 0)
            ok = m_native ? file.read_native_tiles(part, 0, blocks.x0, blocks.x1, blocks.y0,
                                                   blocks.y1, 0, 1, m_first, m_end, to)
                          : file.read_tiles(part, 0, blocks.x0, blocks.x1, blocks.y0, blocks.y1, 0,
                                            1, m_first, m_end, OIIO::TypeFloat, to);
        else
            ok = m_native ? file.read_native_scanlines(part, 0, blocks.y0, blocks.y1, 0, m_first,
                                                       m_end, to)
                          : file.read_scanlines(part, 0, blocks.y0, blocks.y1, 0, m_first, m_end,
                                                OIIO::TypeFloat, to);
    } catch (const std::bad_alloc&) {
        throw MemoryError(m_file->path() + ": no memory to decode rows");
    } catch (const std::exception& e) {
        why = e.what();
    }
    // Some readers (TIFF, JPEG) fill in what a file that was cut short lacks and call it read.
    if (!ok || file.has_error()) {
        if (why.empty()) why = file.geterror();
        close(); // whatever state the decoder is in, the next try starts anew
        fail_rows(blocks.y0, std::min(blocks.y1, m_part.data.y1), layer, why);
    }
    m_decoded = blocks;
    m_rows_decoded += static_cast<std::size_t>(blocks.height());
    for (auto& [reader, state] : m_readers) state.read_up_to = blocks.y0;
}

void RowDecoder::free_rows()
{
    m_pixels.reset();
    m_capacity = 0;
    m_decoded = {};
    m_trim = false;
}

void RowDecoder::trim()
{
    const auto held = lock();
    const int end = std::min(m_decoded.y1, m_part.data.y1);
    m_trim = true;
    for (const auto& [reader, state] : m_readers)
        if (state.read_up_to < end) return;
    free_rows();
}

void RowDecoder::rows_end()
{
    const auto held = lock();
    if (m_trim) free_rows();
}

void RowDecoder::release(const void* reader)
{
    const auto held = lock();
    m_readers[reader].open = false;
    for (const auto& [other, state] : m_readers)
        if (state.open) return;
    close();
    free_rows();
}

std::size_t RowDecoder::most_bytes(const PartInfo& part, int first, int end, std::size_t readers)
{
    std::size_t pixel = 0;
    for (int c = first; c < end; ++c)
        pixel += std::max(sizeof(float), part.spec->channelformat(c).size());
    const std::size_t row = static_cast<std::size_t>(part.data.width()) * pixel;
    return std::min(
        row * static_cast<std::size_t>(part.data.height()),
        std::max(band_bytes(readers), 2 * row * static_cast<std::size_t>(part.chunk_rows)));
}

} // namespace rayloom
