// SPDX-License-Identifier: Apache-2.0
/// \file
/// What is in an image file: parts, layers, channels, windows. Made for multi-part, multi-layer
/// EXR; takes whatever OpenImageIO reads. docs/images.md says how layers are addressed.
#pragma once

#include "rayloom/image/image_desc.h"

#include <OpenImageIO/imageio.h>

#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace rayloom
{

/// One part of a file (subimage, in OpenImageIO's words).
struct PartInfo {
    int index = 0;
    std::string name; ///< empty when the file does not name its parts
    std::string view; ///< of a multi-view file, else empty
    Region data, display;
    std::shared_ptr<const OIIO::ImageSpec> spec; ///< header as read
    bool deep = false;
    /// Rows of a compressed block or tile; reading whole ones, from `data.y0` on, decodes each
    /// once.
    int chunk_rows = 1;
};

/// Channels of one part that share all of their name but the last word:
/// "ViewLayer.Denoising Albedo.R", ".G", ".B".
struct LayerInfo {
    int part = 0;
    std::string part_name;
    std::string name;          ///< "ViewLayer.Denoising Albedo"; empty for plain "R", "G", "B"
    std::string pass;          ///< its last word but the view: "Denoising Albedo"
    std::string view;          ///< of a multi-view file, else empty
    std::vector<int> channels; ///< indices into the part's spec
    std::vector<std::string> channel_names; ///< last words: "R", "G", "B"

    /// How a command or graph names this layer: part name and layer name, as far as there are any.
    std::string address() const;
    /// Full names of its channels, as the file has them.
    std::vector<std::string> full_names() const;
};

/// Channels of one part to be read together.
struct ChannelSelection {
    int part = 0;
    std::string layer;              ///< address, for messages and reports
    std::vector<int> channels;      ///< indices into the part's spec
    std::vector<std::string> names; ///< how the image in memory calls them
};

/// The headers of a file. Immutable and cheap to share; no pixel is read.
class ImageFile
{
public:
    /// Reads the headers of every part. Throws InputError that names the file when it is missing,
    /// unreadable, not an image, or promises more than it can hold.
    static std::shared_ptr<const ImageFile> open(const std::string& path);

    const std::string& path() const { return m_path; }
    const char* format() const { return m_format.c_str(); }
    const std::vector<PartInfo>& parts() const { return m_parts; }
    const std::vector<LayerInfo>& layers() const { return m_layers; }

    /// Finds what an address names: a layer ("ViewLayer.Combined"), a part ("beauty"), both
    /// ("beauty.Combined"), a layer's last word where it is the only one of that name
    /// ("Combined"), one channel ("ViewLayer.Depth.Z"), or the common beginning of several layers
    /// ("ViewLayer"). An empty address is the file's only layer, else every channel of the first
    /// part. `part` (name or number, may be empty) restricts the search. Throws InputError with
    /// what there is, or when two things answer to the name.
    ChannelSelection select(std::string_view address, std::string_view part = {}) const;

    /// Narrows a selection to channels: "any" (all), "RGB" (the three colour channels, or X, Y, Z,
    /// or the only channel, and the alpha when there is one), or a comma list of names in the order
    /// wanted. Throws InputError that lists the channels there are.
    ChannelSelection narrow(ChannelSelection selection, std::string_view channels) const;

    /// Windows, names and header of a selection. The header holds the selected channels only,
    /// under their names in memory, with the types they have in the file.
    ImageDesc desc(const ChannelSelection& selection) const;

private:
    std::string m_path, m_format;
    std::vector<PartInfo> m_parts;
    std::vector<LayerInfo> m_layers;
};

/// A hash of the file's bytes (thorough), or of its path, size and time of change. Throws
/// InputError.
std::string file_content_key(const std::string& path, bool thorough);

} // namespace rayloom
