// SPDX-License-Identifier: Apache-2.0
/// \file
/// The one parallel loop. Runs in the caller's TBB arena, so that --threads bounds it.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <cstddef>

#if defined(__SANITIZE_THREAD__)
#define RAYLOOM_THREAD_SANITIZER
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define RAYLOOM_THREAD_SANITIZER
#endif
#endif
#ifdef RAYLOOM_THREAD_SANITIZER
#include <sanitizer/tsan_interface.h>
#endif

namespace rayloom
{

#ifdef RAYLOOM_THREAD_SANITIZER
/// What the thread sanitizer does not see because it happens inside oneTBB, which is not built with
/// it: a loop's tasks begin after what came before the loop, and what follows comes after the
/// tasks. Two tasks of one loop stay unordered, so that a race between them is reported.
struct LoopOrder {
    LoopOrder() { __tsan_release(&begun); }
    ~LoopOrder() { __tsan_acquire(&ended); }
    LoopOrder(const LoopOrder&) = delete;
    LoopOrder& operator=(const LoopOrder&) = delete;
    struct Task {
        explicit Task(LoopOrder& order) : loop(order) { __tsan_acquire(&loop.begun); }
        ~Task() { __tsan_release(&loop.ended); }
        Task(const Task&) = delete;
        Task& operator=(const Task&) = delete;
        LoopOrder& loop;
    };
    char begun = 0, ended = 0;
};
/// For what a task does before it is ordered: it reads where its range and its body are.
#define RAYLOOM_BEFORE_ORDER __attribute__((no_sanitize("thread")))
#else
struct LoopOrder {
    struct Task {
        explicit Task(const LoopOrder&) {}
    };
};
#define RAYLOOM_BEFORE_ORDER
#endif

/// Calls body(i) for i in [begin, end), `grain` neighbouring indices to a task. Tasks wait in
/// isolation, so a thread that waits here does not pick up unrelated work. The order of calls is
/// not defined; results must not depend on it. The first exception a body throws comes out here
/// after the others were stopped.
template <class Index, class Body>
void parallel_for(Index begin, Index end, Index grain, const Body& body)
{
    if (begin >= end) return;
    const auto run = [&body](Index first, Index last) {
        for (Index i = first; i != last; ++i) body(i);
    };
    LoopOrder order;
    tbb::this_task_arena::isolate([&] {
        tbb::parallel_for(
            tbb::blocked_range<Index>(begin, end, grain),
            [&](const tbb::blocked_range<Index>& range) RAYLOOM_BEFORE_ORDER {
                const LoopOrder::Task task(order);
                run(range.begin(), range.end());
            },
            tbb::simple_partitioner());
    });
}

} // namespace rayloom
