// SPDX-License-Identifier: Apache-2.0
/// \file
/// Real renders for tests: those in tests/data, and a larger set that may or may not be there.
#pragma once

#include "tests/support/run_node.h"

#include <filesystem>
#include <optional>
#include <string>

namespace rayloom::test
{

/// Folder of the large data set: $RAYLOOM_DATA, else shared/data near the source tree; nothing when
/// there is none. A test that needs it skips itself.
std::optional<std::filesystem::path> large_data();

/// Reads the first part of an image file. `layer` keeps the channels of one layer, under their
/// short names ("ViewLayer.Combined" → R, G, B, A); empty keeps all. Throws InputError.
TestImage read_render(const std::filesystem::path& file, const std::string& layer = "");

/// The first `count` images of `<folder>/stack`, one sample per pixel each.
std::vector<TestImage> read_stack(const std::filesystem::path& folder, int count);

} // namespace rayloom::test
