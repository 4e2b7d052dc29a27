// SPDX-License-Identifier: Apache-2.0
/// \file
/// Running graphs.
///
///     const Graph graph = read_graph("graphs/ray-histogram-fusion-stack.yaml");
///     RunRequest request;
///     request.inputs["stack"] = …;
///     RunReport report = run_graph(graph, request);
#pragma once

#include "rayloom/engine/plan.h"
#include "rayloom/engine/report.h"
#include "rayloom/engine/schedule.h"

namespace rayloom
{

/// Runs a plan. Outputs with a path are complete under their final name when this returns, and
/// untouched when it throws (InputError, OutputError, MemoryError, Cancelled, …).
RunReport run_plan(Plan& plan, const RunOptions& options = {});

/// make_plan() and run_plan().
RunReport run_graph(const Graph& graph, const RunRequest& request, const RunOptions& options = {});

} // namespace rayloom
