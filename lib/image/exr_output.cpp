// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/exr_output.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"

#include <OpenImageIO/strutil.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace rayloom
{

namespace
{
// Colour is written as half where nothing else is known; data (depth, positions, histograms) keeps
// its digits.
OIIO::TypeDesc default_exr_type(const std::string& channel)
{
    static const std::array<const char*, 10> colour = {"R", "G", "B", "A", "Y",
                                                       "r", "g", "b", "a", "alpha"};
    const bool is_colour =
        std::any_of(colour.begin(), colour.end(), [&](const char* c) { return channel == c; });
    return is_colour ? OIIO::TypeHalf : OIIO::TypeFloat;
}

constexpr float most_dwa_level = 1e5f;

// Header attributes that speak of the file they came from rather than of the picture.
void drop_file_attributes(OIIO::ImageSpec& spec)
{
    for (const char* name :
         {"oiio:subimages", "oiio:subimagename", "name", "view", "multiView", "oiio:BitsPerSample",
          "openexr:chunkCount", "openexr:levelmode", "openexr:roundingmode", "openexr:lineOrder",
          "openexr:version", "type", "chunkCount", "tiles", "oiio:SHA-1", "textureformat"})
        spec.erase_attribute(name);
}
} // namespace

bool is_exr(const std::string& path)
{
    return OIIO::Strutil::iends_with(path, ".exr") || OIIO::Strutil::iends_with(path, ".sxr") ||
           OIIO::Strutil::iends_with(path, ".mxr");
}

OIIO::TypeDesc parse_type(const std::string& path, const std::string& type)
{
    static const std::vector<std::string> known = {"half", "float", "uint8", "uint16"};
    if (std::find(known.begin(), known.end(), type) == known.end())
        throw NodeError(path + ": there is no pixel type '" + type + "'" + suggestion(type, known));
    return OIIO::TypeDesc(type);
}

std::optional<OIIO::TypeDesc> source_type(const ImageDesc& desc, const std::string& channel)
{
    if (!desc.header) return std::nullopt;
    const auto& names = desc.header->channelnames;
    const auto it = std::find(names.begin(), names.end(), channel);
    if (it == names.end()) return std::nullopt;
    return desc.header->channelformat(static_cast<int>(it - names.begin()));
}

ExrCompression compression_named(const std::string& path, const std::string& compression)
{
    static const std::vector<std::string> names = {"none",  "rle", "zips", "zip",  "piz",
                                                   "pxr24", "b44", "b44a", "dwaa", "dwab"};
    const std::size_t colon = compression.find(':');
    const std::string name = compression.substr(0, colon);
    const auto it = std::find(names.begin(), names.end(), name);
    if (it == names.end())
        throw NodeError(path + ": there is no compression '" + name + "'" +
                        suggestion(name, names));
    ExrCompression found{static_cast<Imf::Compression>(it - names.begin()), {}};
    if (colon == std::string::npos) return found;
    const std::string level = compression.substr(colon + 1);
    const bool zip = name == "zip" || name == "zips", dwa = name == "dwaa" || name == "dwab";
    const float value =
        OIIO::Strutil::string_is_float(level) ? OIIO::Strutil::stof(level) : std::nanf("");
    if (!zip && !dwa) throw NodeError(path + ": compression '" + name + "' has no levels");
    if (zip ? !(value >= 1 && value <= 9 && value == std::floor(value))
            : !(value >= 0 && value <= most_dwa_level))
        throw NodeError(path + ": '" + level + "' is no level of compression '" + name +
                        "': it has " + (zip ? "1 to 9" : "0 to 100000; 45 is usual"));
    found.level = value;
    return found;
}

std::vector<std::string> full_names(const std::string& path, const std::string& layer,
                                    const std::vector<std::string>& channels)
{
    constexpr std::size_t longest = 255;
    std::vector<std::string> names;
    for (const std::string& channel : channels) {
        names.push_back(layer.empty() ? channel : layer + "." + channel);
        const std::string& name = names.back();
        if (name.size() > longest)
            throw NodeError(path + ": channel name '" + name.substr(0, 20) + "…' has " +
                            std::to_string(name.size()) + " bytes; an EXR holds " +
                            std::to_string(longest));
        if (std::find(names.begin(), names.end() - 1, name) != names.end() - 1)
            throw NodeError(path + ": there are two channels named '" + name + "'");
    }
    return names;
}

OIIO::TypeDesc exr_type(const ImageDesc& desc, const std::string& channel, const std::string& path,
                        const std::string& type)
{
    if (!type.empty()) return parse_type(path, type);
    const auto source = source_type(desc, channel);
    // Pixels are floats by now: 32-bit integers survive as floats, small ones as halves.
    if (!source) return default_exr_type(channel);
    if (*source == OIIO::TypeHalf || source->size() == 1) return OIIO::TypeHalf;
    return OIIO::TypeFloat;
}

OIIO::ImageSpec header_without_channels(const ImageDesc& desc)
{
    OIIO::ImageSpec spec;
    if (desc.header) spec = *desc.header;
    drop_file_attributes(spec);
    spec.x = desc.data.x0;
    spec.y = desc.data.y0;
    spec.z = 0;
    spec.width = desc.data.width();
    spec.height = desc.data.height();
    spec.depth = spec.full_depth = 1;
    spec.full_x = desc.display.x0;
    spec.full_y = desc.display.y0;
    spec.full_width = desc.display.width();
    spec.full_height = desc.display.height();
    spec.tile_width = spec.tile_height = spec.tile_depth = 0;
    spec.deep = false;
    spec.nchannels = 0;
    spec.channelnames.clear();
    spec.channelformats.clear();
    spec.alpha_channel = spec.z_channel = -1;
    return spec;
}

void drop_orphaned_manifests(OIIO::ImageSpec& spec)
{
    const bool keeps_ids = std::ranges::any_of(spec.channelnames, [](const std::string& name) {
        return OIIO::Strutil::icontains(name, "crypto");
    });
    if (keeps_ids) return;
    std::vector<std::string> names;
    for (const auto& p : spec.extra_attribs)
        if (OIIO::Strutil::starts_with(p.name().string(), "cryptomatte/"))
            names.push_back(p.name().string());
    for (const std::string& name : names) spec.erase_attribute(name);
}

} // namespace rayloom
