// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/exr_header.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfVersion.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>

namespace rayloom
{

namespace
{

/// What stands before the first header.
struct Start {
    bool several_parts = false;
    bool more_than_scanlines = false; ///< tiles, deep samples or several parts
};

std::optional<Start> read_start(std::istream& in)
{
    std::array<char, 8> bytes{};
    if (!in.read(bytes.data(), bytes.size()) || !Imf::isImfMagic(bytes.data())) return std::nullopt;
    const int flags = static_cast<unsigned char>(bytes[5]) << 8;
    return Start{(flags & Imf::MULTI_PART_FILE_FLAG) != 0,
                 (flags & (Imf::TILED_FLAG | Imf::NON_IMAGE_FLAG | Imf::MULTI_PART_FILE_FLAG)) !=
                     0};
}

/// The next name of a header. Nothing where the file ends, or no name is that long.
std::optional<std::string> read_name(std::istream& in)
{
    constexpr std::size_t longest = 255;
    std::string name;
    for (int c = in.get(); c > 0; c = in.get()) {
        name += static_cast<char>(c);
        if (name.size() > longest) return std::nullopt;
    }
    if (!in) return std::nullopt;
    return name;
}

std::optional<std::uint32_t> read_size(std::istream& in)
{
    std::array<char, 4> bytes{};
    if (!in.read(bytes.data(), bytes.size())) return std::nullopt;
    std::uint32_t size = 0;
    for (std::size_t i = bytes.size(); i-- > 0;)
        size = size << 8 | static_cast<unsigned char>(bytes[i]);
    return size;
}

// OpenEXR makes room for a text of the length its header gives, up to 2 GiB, and clears it, before
// it reads. Walks over the fields of all headers, each a name, a type, a size and a value.
std::string field_complaint(std::istream& in, bool several_parts, std::uint64_t file_bytes)
{
    for (bool first_field = true;;) {
        const std::optional<std::string> name = read_name(in);
        if (!name) return "";
        if (name->empty()) { // the end of a header; one without fields ends them all
            if (first_field || !several_parts) return "";
            first_field = true;
            continue;
        }
        first_field = false;
        const std::optional<std::string> type = read_name(in);
        const std::optional<std::uint32_t> size = type ? read_size(in) : std::nullopt;
        if (!size) return "";
        const std::uint64_t left = file_bytes - static_cast<std::uint64_t>(in.tellg());
        if (*size > left) {
            const bool printable =
                std::ranges::all_of(*name, [](char c) { return c >= ' ' && c <= '~'; });
            return "its header promises " + std::to_string(*size) + " bytes of " +
                   (printable ? "'" + *name + "'" : "a field") +
                   ", more than the file has; it is corrupt or was cut short";
        }
        in.ignore(*size);
    }
}

// OpenEXR asks for memory for whole tiles, several a
// thread, as soon as a tiled part is opened, however little of them the picture fills. No writer
// makes tiles of more than four times the picture (a side rounded up to a power of two at most
// doubles), unless they are small.
std::string tile_complaint(const Imf::Header& header)
{
    constexpr double small = 64 << 20; // 2048x2048 pixels of four floats
    if (!header.hasTileDescription()) return "";
    double pixel_bytes = 0;
    for (auto c = header.channels().begin(); c != header.channels().end(); ++c)
        pixel_bytes += c.channel().type == Imf::HALF ? 2 : 4;
    const unsigned tile_width = header.tileDescription().xSize,
                   tile_height = header.tileDescription().ySize;
    const Imath::Box2i& data = header.dataWindow();
    const std::int64_t width = std::int64_t{data.max.x} - data.min.x + 1,
                       height = std::int64_t{data.max.y} - data.min.y + 1;
    const double tile_pixels = 1.0 * tile_width * tile_height;
    const double pixels = static_cast<double>(width) * static_cast<double>(height);
    if (tile_pixels * pixel_bytes <= small || tile_pixels <= 4 * pixels) return "";
    return "its header promises tiles of " + std::to_string(tile_width) + "x" +
           std::to_string(tile_height) + " pixels for an image of " + std::to_string(width) + "x" +
           std::to_string(height) + ", far more than it can fill; the file is corrupt";
}

// OpenEXR leaves all else in the header of a part unchecked where it does not know the part's type,
// and OpenImageIO takes it for checked.
std::string type_complaint(const Imf::Header& header, int part)
{
    if (!header.hasType() || Imf::isSupportedType(header.type())) return "";
    return "its header says that part " + std::to_string(part) +
           " is neither scanlines nor tiles, deep or not; the file is corrupt";
}

} // namespace

std::string exr_header_complaint(const std::string& path)
try {
    std::ifstream in(path, std::ios::binary);
    const std::optional<Start> start = read_start(in);
    if (!start) return "";
    if (std::string wrong =
            field_complaint(in, start->several_parts, std::filesystem::file_size(path));
        !wrong.empty())
        return wrong;
    if (!start->more_than_scanlines) return "";
    const Imf::MultiPartInputFile file(path.c_str(), 0);
    for (int p = 0; p < file.parts(); ++p) {
        if (std::string wrong = type_complaint(file.header(p), p); !wrong.empty()) return wrong;
        if (std::string wrong = tile_complaint(file.header(p)); !wrong.empty()) return wrong;
    }
    return "";
} catch (const std::exception&) {
    return "";
}

} // namespace rayloom
