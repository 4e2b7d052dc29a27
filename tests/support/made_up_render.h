// SPDX-License-Identifier: Apache-2.0
/// \file
/// A small multi-layer image with the passes of a render.
#pragma once

#include "rayloom/engine/request.h"

#include <memory>
#include <string>
#include <vector>

namespace rayloom::test
{

/// Layers as Cycles names them ("ViewLayer.DiffDir"), 24×18 pixels: Combined (the first four
/// channels), light passes and colours, Emit, Normal, Depth, IndexOB, IndexMA and a cryptomatte of
/// two ranks. Combined is the sum of the passes times `complete`. The layers in `black` are zero.
std::shared_ptr<MemoryImage> made_up_render(const std::vector<std::string>& black, unsigned seed,
                                            float complete = 1.0f);

} // namespace rayloom::test
