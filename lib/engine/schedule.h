// SPDX-License-Identifier: Apache-2.0
/// \file
/// Which rows of which item are made when. A run is one or more sweeps down the image: one for each
/// layer of reductions, then one for the outputs. A sweep goes strip by strip; in each strip an
/// item computes only rows nobody computed before, and rows nobody will ask for again are dropped.
/// The same walk, without pixels, tells the memory a schedule takes.
#pragma once

#include "rayloom/engine/plan.h"

#include <cstddef>
#include <functional>
#include <vector>

namespace rayloom
{

/// An end of a sweep: a sink item, an op's reduction, or (without shortcuts) any item.
struct SweepRoot {
    int item = -1;         ///< sink or item to compute over its window
    int reduction_op = -1; ///< op whose reduction is wanted
    Region domain;
    int align = 1; ///< strips are cut at multiples of this below domain.y0
};

using Sweep = std::vector<SweepRoot>;

/// How a plan will be run.
struct Schedule {
    std::vector<Sweep> sweeps;
    int strips = 1;
    /// Keep rows that a later sweep reads again; false recomputes (or rereads) them.
    bool retain = true;
    std::size_t peak_bytes = 0; ///< estimate, pixels and scratch
    /// Most rows an item holds at a time: its bands get memory for them at once.
    std::vector<int> most_rows;
    int tile_width = 256, tile_height = 128;
    int threads = 1;
};

/// Chooses the fewest strips that fit the budget. Throws MemoryError, naming what is needed at
/// least, when none does.
Schedule make_schedule(const Plan& plan, const RunOptions& options);

/// Rows [lo, hi) of an item, full width of its band, to be computed now.
struct RowTask {
    int item = -1;
    int lo = 0, hi = 0;
};

/// What the walk asks of whoever does the work.
class SweepVisitor
{
public:
    virtual ~SweepVisitor() = default;
    /// Make room in the item's bands for rows [lo, hi), next to what they hold; they will come to
    /// hold `reserve` rows.
    virtual void extend(int item, int lo, int hi, int reserve) = 0;
    /// Compute these rows; the items do not depend on one another.
    virtual void compute(const std::vector<RowTask>& batch) = 0;
    /// Only rows [lo, hi) of the item will be read from now on (none when hi <= lo).
    virtual void keep(int item, int lo, int hi) = 0;
    /// The rows a root needs are there.
    virtual void finish_strip(const SweepRoot& root, const Region& rows) = 0;
    virtual void finish_sweep(const Sweep& sweep) = 0;
};

/// Region an item's outputs will be asked for over all sweeps (its bands' columns).
std::vector<Region> total_demand(const Plan& plan, const std::vector<Sweep>& sweeps);

void walk(const Plan& plan, const Schedule& schedule, SweepVisitor& visitor);

} // namespace rayloom
