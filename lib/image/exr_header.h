// SPDX-License-Identifier: Apache-2.0
/// \file
/// What EXR headers may claim.
#pragma once

#include <string>

namespace rayloom
{

/// What is wrong with the header of an EXR file that OpenEXR lets pass and that costs whoever opens
/// the file next its memory or its life: fields longer than the file or than what is in them, parts
/// of a type that is not known, tiles without measure. Empty where nothing is, where the file is
/// none or no EXR, and where its header cannot be read at all: opening it says why.
std::string exr_header_complaint(const std::string& path);

} // namespace rayloom
