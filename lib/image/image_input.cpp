// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/image_input.h"

#include "rayloom/core/error.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfVersion.h>
#include <OpenImageIO/strutil.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <system_error>

namespace rayloom
{

namespace
{

// Whether the file is an EXR of tiles, deep samples or several parts, as its first bytes have it.
bool is_more_than_scanlines(std::istream& in)
{
    std::array<char, 8> start{};
    in.read(start.data(), start.size());
    if (in.gcount() != static_cast<std::streamsize>(start.size()) || !Imf::isImfMagic(start.data()))
        return false;
    return (static_cast<unsigned char>(start[5]) &
            (Imf::TILED_FLAG | Imf::NON_IMAGE_FLAG | Imf::MULTI_PART_FILE_FLAG) >> 8) != 0;
}

// What is wrong with the tiles of a part. OpenEXR asks for memory for whole tiles, several a
// thread, as soon as a tiled part is opened, however little of them the picture fills. No writer
// makes tiles of more than four times the picture (a side rounded up to a power of two at most
// doubles), unless they are small. Empty where nothing is wrong.
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

// What is wrong with the header of an EXR that OpenEXR lets pass and whoever opens the file next
// does not survive: tiles without measure, and parts of a type that is not known, for OpenEXR then
// leaves all else in the header unchecked and OpenImageIO takes it for checked. Empty where nothing
// is, or the header cannot be read: whoever opens the file next says why.
std::string header_complaint(const std::string& path)
try {
    const Imf::MultiPartInputFile file(path.c_str(), 0);
    for (int p = 0; p < file.parts(); ++p) {
        const Imf::Header& header = file.header(p);
        if (header.hasType() && !Imf::isSupportedType(header.type()))
            return "its header says that part " + std::to_string(p) +
                   " is neither scanlines nor tiles, deep or not; the file is corrupt";
        if (std::string wrong = tile_complaint(header); !wrong.empty()) return wrong;
    }
    return "";
} catch (const std::exception&) {
    return "";
}

} // namespace

void fail_input(const std::string& path, const std::string& what)
{
    throw InputError(path + ": " + what);
}

std::string plain_message(std::string message, const std::string& path)
{
    message = OIIO::Strutil::replace(message, "\"" + path + "\"", "it", true);
    while (!message.empty() && (message.back() == '\n' || message.back() == ' '))
        message.pop_back();
    message = OIIO::Strutil::replace(message, "\n", "; ", true);
    return message.empty() ? "no reason was given" : message;
}

struct stat file_status(const std::string& path)
{
    struct stat status {
    };
    if (::stat(path.c_str(), &status) != 0) fail_input(path, std::strerror(errno));
    if (S_ISDIR(status.st_mode)) fail_input(path, "is a folder, not an image");
    return status;
}

std::unique_ptr<OIIO::ImageInput> open_input(const std::string& path)
{
    file_status(path);
    std::ifstream file(path, std::ios::binary);
    if (!file) fail_input(path, "cannot be opened for reading");
    if (is_more_than_scanlines(file))
        if (const std::string wrong = header_complaint(path); !wrong.empty())
            fail_input(path, wrong);
    file.close();
    std::unique_ptr<OIIO::ImageInput> input;
    try {
        input = OIIO::ImageInput::open(path);
    } catch (const std::system_error& e) {
        if (e.code() == std::errc::resource_unavailable_try_again)
            throw MemoryError(path + ": memory ran out: no thread could be started to read it");
        fail_input(path, "is not an image that can be read: " + plain_message(e.what(), path));
    } catch (const std::exception& e) {
        fail_input(path, "is not an image that can be read: " + plain_message(e.what(), path));
    }
    if (!input)
        fail_input(path,
                   "is not an image that can be read: " + plain_message(OIIO::geterror(), path));
    return input;
}

} // namespace rayloom
