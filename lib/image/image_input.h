// SPDX-License-Identifier: Apache-2.0
/// \file
/// Opens image files, and says in one way why one cannot be read.
#pragma once

#include <OpenImageIO/imageio.h>

#include <memory>
#include <string>
#include <sys/stat.h>

namespace rayloom
{

/// Throws InputError: path and what is wrong.
[[noreturn]] void fail_input(const std::string& path, const std::string& what);
/// OpenImageIO's message without line ends and without the path, which is said already.
std::string plain_message(std::string message, const std::string& path);
/// Throws InputError when there is no such file, or it is a folder, a pipe or a device.
struct stat file_status(const std::string& path);
/// Throws InputError when the file is no image that can be read, MemoryError.
std::unique_ptr<OIIO::ImageInput> open_input(const std::string& path);

} // namespace rayloom
