// SPDX-License-Identifier: Apache-2.0
/// \file
/// Reads the selected channels of selected rows of an image file.
#pragma once

#include "rayloom/image/deep.h"
#include "rayloom/image/image_file.h"
#include "rayloom/image/view.h"

#include <memory>
#include <span>
#include <utility>

namespace rayloom
{

/// Reads pixels of one selection. Calls from several threads are safe and take turns. The file is
/// opened by the first read and closed by release() or the destructor; it is read directly, not
/// through a cache.
class ImageReader
{
public:
    ImageReader(std::shared_ptr<const ImageFile> file, ChannelSelection selection);
    ~ImageReader();
    ImageReader(ImageReader&&) noexcept;
    ImageReader& operator=(ImageReader&&) noexcept;

    const ImageFile& file() const;
    const ChannelSelection& selection() const;
    const ImageDesc& desc() const;
    const PartInfo& part() const;

    /// Fills every pixel and channel of `out`; its region lies inside the data window and its
    /// channels are those of desc(). Integers of 8 and 16 bits come as 0..1; 32-bit integers of EXR
    /// (ids, counts) come as numbers, exact up to 2^24. Throws InputError that names the file and
    /// the rows, MemoryError.
    void read(ImageView out) const;

    /// One row of a deep part, over the width of the data window. Ids keep all bits
    /// (deep_rows.h).
    DeepRow read_deep_row(int y) const;
    /// Samples in the fullest row of a deep part, from the sizes of its blocks; where a block has
    /// several rows, their mean. Reads no sample. 0 when the sizes cannot be read.
    std::size_t deep_row_samples() const;

    /// Memory read() may hold beside the pixels it fills, for bands of whole blocks, as long as no
    /// rows are shared.
    std::size_t scratch_bytes() const;
    /// Memory these readers may hold together once they share rows.
    static std::size_t shared_bytes(std::span<const ImageReader* const> readers);

    /// Whether both read the same part of the same file, so that they may share_rows().
    bool may_share(const ImageReader& other) const;
    /// From now on these readers, and no others, decode rows together: what one of them has decoded
    /// the others find, as long as they read the same rows one after another. Pixels are the same
    /// either way. Precondition: each may_share() with the first; none of them is read meanwhile.
    static void share_rows(std::span<const ImageReader* const> readers);
    /// After share_rows(): these rows were read by all who want them.
    void rows_end() const;

    /// Rows that are decoded at a time: those who share rows should not read more before the others
    /// do.
    int rows_at_once() const;
    /// Rows this reader had unpacked so far, as nobody it shares them with had before. Over all
    /// readers of a file: twice the rows of the image where each was unpacked twice.
    std::size_t rows_decoded() const;

    /// Frees decoded rows once they were read to their end by all who share them, or rows_end();
    /// the file stays open.
    void trim() const;
    /// Closes the file until the next read and frees what was decoded, once all who share rows
    /// ask for it.
    void release() const;

private:
    /// First channel any of them reads, and the one after the last.
    static std::pair<int, int> channel_range(std::span<const ImageReader* const> readers);

    struct State;
    std::unique_ptr<State> m_state;
};

/// Threads OpenEXR may use to decode and encode; 0 is one per processor. A setting of the process,
/// since the library knows no other. OpenImageIO, which decodes some other formats on several
/// threads, may use as many as the largest number so far.
void set_image_threads(int threads);

} // namespace rayloom
