// SPDX-License-Identifier: Apache-2.0
/// \file
/// What a run did: times, skips, counters, memory.
#pragma once

#include "rayloom/core/table.h"
#include "rayloom/engine/request.h"

#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace rayloom
{

/// One node's share of a run; the elements of a mapped node are counted together.
struct NodeReport {
    std::string id, op;
    double seconds = 0.0;   ///< of computing threads, without the nodes it reads from
    std::size_t pixels = 0; ///< computed
    std::size_t calls = 0;
    std::map<std::string, std::size_t> skipped; ///< reason → pixels
    std::map<std::string, std::size_t> counts;  ///< what the node counted ("NaN pixels repaired")
    bool cached = false;
};

/// Something that was not done, and the time that saved as far as it is known.
struct SkipReport {
    std::string node, reason;
    std::size_t pixels = 0;    ///< 0 when it was the whole node
    double saved_seconds = -1; ///< −1: not known
};

struct RunReport {
    std::string graph;
    double seconds = 0.0;                                 ///< wall clock, planning not included
    double reading = 0.0, writing = 0.0, computing = 0.0; ///< seconds summed over threads
    int threads = 1, strips = 1, sweeps = 1;
    int tile_width = 0, tile_height = 0;
    std::size_t planned_peak_bytes = 0; ///< the schedule's estimate for pixels
    std::size_t peak_bytes = 0;         ///< most that bands really held
    std::vector<NodeReport> nodes;
    std::vector<SkipReport> skips;
    std::vector<std::string> notes;
    std::vector<std::string> written; ///< files made
    /// Table outputs by name; images and deep images of outputs without a path (several for a
    /// list).
    std::map<std::string, std::vector<Table>, std::less<>> tables;
    std::map<std::string, std::vector<MemoryImage>, std::less<>> images;
    std::map<std::string, std::vector<MemoryDeep>, std::less<>> deep;

    /// The table `--stats` prints.
    std::string text() const;
    /// The same as one JSON object.
    std::string json() const;
};

} // namespace rayloom
