// SPDX-License-Identifier: Apache-2.0
/// \file
/// Where the files that come with rayloom lie.
#pragma once

#include <filesystem>

namespace rayloom
{

/// The folder of rayloom's data files (share/rayloom), found from where the loaded library lies: an
/// installed copy can be moved, and a build folder answers with its own. Holds graphs/. Throws
/// Error when the system cannot say where the library is.
std::filesystem::path data_folder();

} // namespace rayloom
