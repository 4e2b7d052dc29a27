// SPDX-License-Identifier: Apache-2.0
/// \file
/// What the nodes that write files tell the report about the values they wrote.
#pragma once

#include "rayloom/core/node.h"
#include "rayloom/image/exr_writer.h"

namespace rayloom
{

/// Counts what a writer's rows of this tile had that a reader of the file should know of: the
/// difference of its counts `after` and `before` them.
inline void count_written(const TileContext& context, const WriteCounts& before,
                          const WriteCounts& after)
{
    if (const auto n = after.non_finite - before.non_finite; n > 0)
        context.count("NaN or infinite values written", n);
    if (const auto n = after.half_overflows - before.half_overflows; n > 0)
        context.count("values too large for half, written as 65504", n);
}

} // namespace rayloom
