// SPDX-License-Identifier: Apache-2.0
/// \file
/// Pictures of graphs.
#pragma once

#include "rayloom/graph/model.h"

#include <string>

namespace rayloom
{

/// The graph in the DOT language: inputs, nodes with their op and the parameters they are given,
/// outputs. Lists are double edges, tables dashed, what stands in by `otherwise` dotted.
std::string graph_dot(const Graph& graph);

/// The same drawn as SVG, with a layout of our own: data flows downwards, a node below all it
/// depends on. Needs no other program.
std::string graph_svg(const Graph& graph);

} // namespace rayloom
