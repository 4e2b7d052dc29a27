// SPDX-License-Identifier: Apache-2.0
/// \file
/// Writes images row by row, atomically: alone, or in the place of a layer of an EXR whose other
/// layers and parts are carried over bit for bit. docs/images.md says what becomes of types,
/// windows and metadata.
#pragma once

#include "rayloom/image/image_desc.h"
#include "rayloom/image/view.h"

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace rayloom
{

struct WriteOptions {
    std::string path; ///< its extension says which format
    /// "half", "float", "uint8", "uint16"; empty: each channel as the image's source had it.
    std::string type;
    /// A compression OpenImageIO knows ("zip", "dwaa:45", "none"); empty: as the source had.
    std::string compression;
    /// Layer the channels are written under. With a template: the layer they replace, addressed as
    /// for reading; one it does not have is added.
    std::string layer;
    /// EXR whose other layers, parts and metadata are written too, bit for bit.
    std::string template_path;
};

/// What could not be written as it was.
struct WriteCounts {
    std::size_t non_finite = 0;     ///< NaN and infinities, written as such
    std::size_t half_overflows = 0; ///< too large for a half, written as ±65504
};

/// One file being written. Nothing touches the disk before the first write(), and nothing has the
/// file's name before commit().
class ImageWriter
{
public:
    /// Checks all that can be known before there are pixels. Throws OutputError (folder, file,
    /// format), InputError (template), NodeError (options that do not fit together).
    ImageWriter(const ImageDesc& desc, WriteOptions options);
    /// Discards what was not committed.
    ~ImageWriter();
    ImageWriter(ImageWriter&&) noexcept;
    ImageWriter& operator=(ImageWriter&&) noexcept;

    /// Bands that end on multiples of this below the data window's top are written without being
    /// gathered first.
    int row_alignment() const;
    /// A line per layer of what is written, for the report.
    const std::vector<std::string>& notes() const;

    /// The next rows: full width of the data window, every channel of the description, from top to
    /// bottom without a gap. Throws OutputError; InputError when the template cannot be read.
    void write(ConstImageView rows);
    /// Finishes the file and gives it its name. Throws OutputError.
    void commit();
    void abandon() noexcept;

    const WriteCounts& counts() const;

private:
    struct State;
    std::unique_ptr<State> m_state;
};

} // namespace rayloom
