// SPDX-License-Identifier: Apache-2.0
/// \file
/// Decoded rows of one part of an image file, behind ImageReader. An EXR unpacks a block with all
/// its channels, whoever wants how many: readers of several layers may share one decoder.
#pragma once

#include "rayloom/image/image_file.h"

#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

namespace rayloom
{

/// Channels [first, end) of one part. Members with the precondition lock() take none themselves,
/// all others may be called at any time.
class RowDecoder
{
public:
    /// Where a channel is in a decoded pixel.
    struct Channel {
        std::size_t offset = 0;
        OIIO::TypeDesc::BASETYPE type = OIIO::TypeDesc::FLOAT;
    };

    RowDecoder(std::shared_ptr<const ImageFile> file, int part, int first, int end);

    Channel channel(int c) const { return m_channels[static_cast<std::size_t>(c - m_first)]; }
    std::size_t pixel_bytes() const { return m_pixel_bytes; }
    int first() const { return m_first; }
    int end() const { return m_end; }

    /// Those who read; decoded rows are kept until all of them have read them.
    void join(const void* reader);
    void leave(const void* reader);
    std::size_t readers() const;
    /// All of them are about to read.
    void expect_readers();

    /// Held from decode() to the last use of what it returned.
    std::unique_lock<std::mutex> lock() const { return std::unique_lock(m_mutex); }
    /// The open file; opens it. Precondition: lock(). Throws InputError, also when the file is not
    /// the one whose header was read.
    OIIO::ImageInput& input();
    /// After a failure: the next input() starts anew. Precondition: lock().
    void close() { m_input.reset(); }
    /// Has row `y` decoded, over the columns of `want`, and as many of the rows of `want` after it
    /// as go at a time. Returns what is decoded. Precondition: lock(). `layer` is for messages.
    /// Throws InputError, MemoryError.
    const Region& decode(const Region& want, int y, const std::string& layer);
    /// A decoded pixel. Precondition: lock().
    const std::byte* pixel(int x, int y) const
    {
        return m_pixels.get() + (static_cast<std::size_t>(y - m_decoded.y0) *
                                     static_cast<std::size_t>(m_decoded.width()) +
                                 static_cast<std::size_t>(x - m_decoded.x0)) *
                                    m_pixel_bytes;
    }
    /// The reader is done with rows above `y`. Precondition: lock().
    void read_up_to(const void* reader, int y) { m_readers[reader] = {y, true}; }
    /// Throws InputError: rows [y0, y1) cannot be read, and why.
    [[noreturn]] void fail_rows(int y0, int y1, const std::string& layer, std::string why) const;

    /// Frees decoded rows that every reader has read to their end, others when rows_end() is said;
    /// the file stays open.
    void trim();
    /// Nobody will read these rows soon: frees what a trim() had to leave.
    void rows_end();
    /// The reader is done with the file: the last one closes it and frees what was decoded.
    void release(const void* reader);

    /// Rows of whole blocks that decode() holds at a time.
    int rows_at_once() const;
    /// Rows unpacked so far. Precondition: lock().
    std::size_t rows_decoded() const { return m_rows_decoded; }
    /// Bytes the rows of channels [first, end) of a part may take for so many readers.
    static std::size_t most_bytes(const PartInfo& part, int first, int end, std::size_t readers);

private:
    struct Reader {
        int read_up_to = 0;
        bool open = true; ///< will read, or has read, and has not released the file since
    };

    std::int64_t blocks_at_once(int width) const;
    static std::size_t band_bytes(std::size_t readers);
    void decode_blocks(const Region& blocks, const std::string& layer);
    void free_rows();

    std::shared_ptr<const ImageFile> m_file;
    const PartInfo& m_part;
    int m_first, m_end;
    std::vector<Channel> m_channels;
    bool m_native = false; ///< decoded rows hold the file's own types
    std::size_t m_pixel_bytes = 0;

    mutable std::mutex m_mutex;
    std::map<const void*, Reader> m_readers;
    std::unique_ptr<OIIO::ImageInput> m_input;
    Region m_decoded; ///< what m_pixels holds
    std::unique_ptr<std::byte[]> m_pixels;
    std::size_t m_capacity = 0;
    std::size_t m_rows_decoded = 0;
    bool m_trim = false; ///< someone asked for it
};

/// Whether both parts have the same windows, channels and types.
bool same_layout(const OIIO::ImageSpec& a, const OIIO::ImageSpec& b);

} // namespace rayloom
