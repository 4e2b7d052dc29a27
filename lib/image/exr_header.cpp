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
#include <map>
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

/// A reader of the bytes of a header; what it returns is empty where they end.
class Bytes
{
public:
    explicit Bytes(std::istream& in) : m_in(in) {}

    /// Text up to a zero. Nothing, too, where no name is that long.
    std::optional<std::string> name()
    {
        constexpr std::size_t longest = 255;
        std::string text;
        for (int c = m_in.get(); c > 0; c = m_in.get()) {
            text += static_cast<char>(c);
            if (text.size() > longest) return std::nullopt;
        }
        if (!m_in) return std::nullopt;
        return text;
    }
    std::optional<std::uint32_t> number()
    {
        std::array<char, 4> bytes{};
        if (!m_in.read(bytes.data(), bytes.size())) return std::nullopt;
        std::uint32_t value = 0;
        for (std::size_t i = bytes.size(); i-- > 0;)
            value = value << 8 | static_cast<unsigned char>(bytes[i]);
        return value;
    }
    std::uint64_t at() { return static_cast<std::uint64_t>(m_in.tellg()); }
    void go_to(std::uint64_t at) { m_in.seekg(static_cast<std::streamoff>(at)); }

private:
    std::istream& m_in;
};

/// Bytes of a value, by its type, where all values have as many.
const std::map<std::string, std::uint32_t, std::less<>> fixed_sizes = {{"box2f", 16},
                                                                       {"box2i", 16},
                                                                       {"chromaticities", 32},
                                                                       {"compression", 1},
                                                                       {"deepImageState", 1},
                                                                       {"double", 8},
                                                                       {"envmap", 1},
                                                                       {"float", 4},
                                                                       {"int", 4},
                                                                       {"keycode", 28},
                                                                       {"lineOrder", 1},
                                                                       {"m33d", 72},
                                                                       {"m33f", 36},
                                                                       {"m44d", 128},
                                                                       {"m44f", 64},
                                                                       {"rational", 8},
                                                                       {"tiledesc", 9},
                                                                       {"timecode", 8},
                                                                       {"v2d", 16},
                                                                       {"v2f", 8},
                                                                       {"v2i", 8},
                                                                       {"v3d", 24},
                                                                       {"v3f", 12},
                                                                       {"v3i", 12}};

/// Whether a value of that type has as many bytes as its field says, so that whoever reads the type
/// ends where the next field begins.
bool fits(Bytes& bytes, const std::string& type, std::uint32_t size)
{
    if (const auto fixed = fixed_sizes.find(type); fixed != fixed_sizes.end())
        return size == fixed->second;
    const std::uint64_t end = bytes.at() + size;
    if (type == "floatvector") return size % 4 == 0;
    if (type == "chlist") { // names, each with 16 bytes; an empty one is the last
        std::optional<std::string> name = bytes.name();
        for (; name && !name->empty() && bytes.at() < end; name = bytes.name())
            bytes.go_to(bytes.at() + 16);
        return name && bytes.at() == end;
    }
    if (type == "stringvector") { // texts, each after its length
        while (bytes.at() < end) {
            const std::optional<std::uint32_t> length = bytes.number();
            if (!length || bytes.at() > end || *length > end - bytes.at()) return false;
            bytes.go_to(bytes.at() + *length);
        }
        return true;
    }
    if (type == "preview") { // width, height, four bytes a pixel
        const std::optional<std::uint32_t> width = bytes.number(), height = bytes.number();
        return width && height && *width < 1u << 15 && *height < 1u << 15 &&
               size == 8 + 4 * *width * *height;
    }
    return true;
}

// OpenEXR makes room for a text of the length its header gives, up to 2 GiB, and clears it, before
// it reads; and it reads a value by its type, whatever size the field has. Walks over the fields of
// all headers, each a name, a type, a size and a value.
std::string field_complaint(std::istream& in, bool several_parts, std::uint64_t file_bytes)
{
    Bytes bytes(in);
    for (bool first_field = true;;) {
        const std::optional<std::string> name = bytes.name();
        if (!name) return "";
        if (name->empty()) { // the end of a header; one without fields ends them all
            if (first_field || !several_parts) return "";
            first_field = true;
            continue;
        }
        first_field = false;
        const std::optional<std::string> type = bytes.name();
        const std::optional<std::uint32_t> size = type ? bytes.number() : std::nullopt;
        if (!size) return "";
        const bool printable =
            std::ranges::all_of(*name, [](char c) { return c >= ' ' && c <= '~'; });
        const std::string field = printable ? "'" + *name + "'" : "a field";
        const std::uint64_t begin = bytes.at();
        if (*size > file_bytes - std::min(begin, file_bytes))
            return "its header promises " + std::to_string(*size) + " bytes of " + field +
                   ", more than the file has; it is corrupt or was cut short";
        if (!fits(bytes, *type, *size))
            return "its header gives " + field + " " + std::to_string(*size) +
                   " bytes, which is not what is in it; the file is corrupt";
        bytes.go_to(begin + *size);
    }
}

// OpenEXR asks for memory for whole tiles, several a thread, as soon as a tiled part is opened,
// however little of them the picture fills. No writer makes tiles of more than four times the
// picture (a side rounded up to a power of two at most doubles), unless they are small.
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
