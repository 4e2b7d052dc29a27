// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/image_input.h"

#include "rayloom/core/error.h"
#include "rayloom/image/exr_header.h"

#include <OpenImageIO/strutil.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <system_error>

namespace rayloom
{

void fail_input(const std::string& path, const std::string& what)
{
    throw InputError(path + ": " + what);
}

std::string plain_message(std::string message, const std::string& path)
{
    for (const char* before : {"image file ", ""})
        message = OIIO::Strutil::replace(message, before + ("\"" + path) + "\"", "it", true);
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
    // A pipe would be waited for, without an end, and cannot be read twice.
    if (!S_ISREG(status.st_mode)) fail_input(path, "is a pipe or a device, not an image file");
    return status;
}

std::unique_ptr<OIIO::ImageInput> open_input(const std::string& path)
{
    file_status(path);
    std::ifstream file(path, std::ios::binary);
    if (!file) fail_input(path, "cannot be opened for reading");
    file.close();
    if (const std::string wrong = exr_header_complaint(path); !wrong.empty())
        fail_input(path, wrong);
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
    input->geterror(); // what did not keep it from being opened is no error of its pixels
    return input;
}

} // namespace rayloom
