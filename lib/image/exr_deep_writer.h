// SPDX-License-Identifier: Apache-2.0
/// \file
/// Writes deep images row by row, atomically. docs/images.md says what becomes of types, windows
/// and metadata.
#pragma once

#include "rayloom/image/deep.h"
#include "rayloom/image/exr_writer.h"

#include <memory>
#include <string>
#include <vector>

namespace rayloom
{

/// One deep scanline EXR being written. Nothing touches the disk before the first write(), and
/// nothing has the file's name before commit().
class DeepWriter
{
public:
    /// Checks all that can be known before there are samples; a template is not looked at. Throws
    /// OutputError (folder, file, format), NodeError (options no deep file can have).
    DeepWriter(const ImageDesc& desc, WriteOptions options);
    /// Discards what was not committed.
    ~DeepWriter();
    DeepWriter(DeepWriter&&) noexcept;
    DeepWriter& operator=(DeepWriter&&) noexcept;

    /// Rows are packed until they take this much, and one more: what write() holds beside the rows
    /// it is given.
    static constexpr std::size_t packed_bytes = std::size_t{1} << 20;

    const std::vector<std::string>& notes() const;

    /// The next rows, [region.y0, region.y1) of `rows`, over the width of the data window; from top
    /// to bottom without a gap. Throws OutputError.
    void write(const DeepView& rows, const Region& region);
    /// Finishes the file and gives it its name. Throws OutputError.
    void commit();
    void abandon() noexcept;

    const WriteCounts& counts() const;

private:
    struct State;
    std::unique_ptr<State> m_state;
};

} // namespace rayloom
