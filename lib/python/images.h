// SPDX-License-Identifier: Apache-2.0
/// \file
/// rayloom.Image: pixels as a NumPy array, with channel names and windows.
#pragma once

#include "rayloom/engine/request.h"

#include <pybind11/pybind11.h>

#include <memory>

namespace rayloom::python
{

/// What rayloom.Image holds. The pixels are shared with runs that read them and with the arrays
/// that show them, never copied again.
struct Image {
    std::shared_ptr<MemoryImage> image;
};

/// An Image, or an array of height × width (× channels) numbers: one channel is Y, three are RGB,
/// four RGBA, others want an Image with names. Throws UsageError.
std::shared_ptr<MemoryImage> to_memory(pybind11::handle value, const std::string& what);

void add_images(pybind11::module_& module);

} // namespace rayloom::python
