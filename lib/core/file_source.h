// SPDX-License-Identifier: Apache-2.0
/// \file
/// Nodes that read the rows of image files.
#pragma once

#include "rayloom/core/node.h"

#include <cstddef>

namespace rayloom
{

class ImageReader;

/// A node without inputs whose output elements are rows of files (Access::rows). The engine sees
/// which of them read the same file, and has its blocks unpacked once for all.
class FileSource : public Node
{
public:
    /// What compute() reads output element `element` with. Precondition: planned.
    virtual const ImageReader& reader(std::size_t element) const = 0;
};

} // namespace rayloom
