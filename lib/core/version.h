// SPDX-License-Identifier: Apache-2.0
/// \file
/// Versions, for `--version` and reports.
#pragma once

#include <string>

namespace rayloom
{

/// "0.1.0"
std::string version();
/// Of the OpenImageIO that is loaded.
std::string openimageio_version();

} // namespace rayloom
