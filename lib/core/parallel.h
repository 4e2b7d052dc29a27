// SPDX-License-Identifier: Apache-2.0
/// \file
/// The one parallel loop. Runs in the caller's TBB arena, so that --threads bounds it.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <cstddef>

namespace rayloom
{

/// Calls body(i) for i in [begin, end), `grain` neighbouring indices to a task. Tasks wait in
/// isolation, so a thread that waits here does not pick up unrelated work. The order of calls is
/// not defined; results must not depend on it. The first exception a body throws comes out here
/// after the others were stopped.
template <class Index, class Body>
void parallel_for(Index begin, Index end, Index grain, const Body& body)
{
    if (begin >= end) return;
    tbb::this_task_arena::isolate([&] {
        tbb::parallel_for(
            tbb::blocked_range<Index>(begin, end, grain),
            [&](const tbb::blocked_range<Index>& range) {
                for (Index i = range.begin(); i != range.end(); ++i) body(i);
            },
            tbb::simple_partitioner());
    });
}

} // namespace rayloom
