// SPDX-License-Identifier: Apache-2.0
/// \file
/// Where the tests find the tree they were built from. One object file knows the paths, so that the
/// others are the same in every checkout and a compiler cache serves them all.
#pragma once

#include <filesystem>

namespace rayloom::test
{

/// Top of the source tree.
const std::filesystem::path& source_folder();
/// Build folder; the command is bin/rayloom below it.
const std::filesystem::path& build_folder();

} // namespace rayloom::test
