// SPDX-License-Identifier: Apache-2.0
/// \file
/// One image of a file, as a graph would read it.
#pragma once

#include "rayloom/engine/request.h"

#include <string>

namespace rayloom
{

/// Reads a file's layer (empty: the beauty, as a graph input with role `beauty` would find it).
/// `channels` as in a graph input: "any", "RGB" or a comma list. Throws InputError.
MemoryImage load_image(const std::string& path, const std::string& layer = "",
                       const std::string& channels = "any");

} // namespace rayloom
