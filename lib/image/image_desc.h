// SPDX-License-Identifier: Apache-2.0
/// \file
/// All that is known of an image before any of its pixels.
#pragma once

#include "rayloom/image/region.h"

#include <OpenImageIO/oiioversion.h>

#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

OIIO_NAMESPACE_BEGIN
class ImageSpec;
OIIO_NAMESPACE_END

namespace rayloom
{

/// Windows, channel names and metadata of an image. Pixels are always linear float32 in memory.
struct ImageDesc {
    Region data;    ///< data window: where there are pixels
    Region display; ///< display window: what a viewer frames
    std::vector<std::string>
        channels; ///< short names, without the layer ("R", "G", "B", "A", "Bin_0000")

    /// Header of the file the image came from: metadata, pixel types and compression for whoever
    /// writes a descendant of it. Null for images made from nothing.
    std::shared_ptr<const OIIO::ImageSpec> header;

    int channel_count() const { return static_cast<int>(channels.size()); }
    /// Index of a channel by exact name, −1 when there is none.
    int channel(std::string_view name) const;
    /// Index of the alpha channel ("A", "a", "alpha"), −1 when there is none.
    int alpha() const;
    /// Indices of R, G, B (upper or lower case) in that order when all three exist, else of every
    /// channel but alpha.
    std::vector<int> colour() const;

    /// Same windows and metadata with other channels.
    ImageDesc with_channels(std::vector<std::string> names) const;
    /// Bytes of all its pixels in memory.
    std::size_t bytes() const;
};

} // namespace rayloom
