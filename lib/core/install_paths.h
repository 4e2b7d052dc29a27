// SPDX-License-Identifier: Apache-2.0
/// \file
/// Where the files that come with rayloom lie.
#pragma once

#include <filesystem>
#include <vector>

namespace rayloom
{

/// The folder of rayloom's data files (share/rayloom), found from where the loaded library lies: an
/// installed copy can be moved, and a build folder answers with its own. Holds graphs/. Throws
/// Error when the system cannot say where the library is.
std::filesystem::path data_folder();

/// Where graphs are looked for by name, and renderer maps in the folder renderers/ below: the
/// folders of $RAYLOOM_GRAPH_PATH (separated by ':'), then graphs/ of the data folder. Throws
/// InputError when one of the former is not there.
std::vector<std::filesystem::path> graph_folders();

} // namespace rayloom
