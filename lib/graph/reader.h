// SPDX-License-Identifier: Apache-2.0
/// \file
/// Reads graph files.
#pragma once

#include "rayloom/core/registry.h"
#include "rayloom/graph/model.h"

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rayloom
{

/// Reads and validates a graph file: every op, port, parameter and reference is checked against
/// the registry, graphs used as nodes are read too, and cycles are refused. Throws GraphError with
/// every problem found (file:line:column, with suggestions), InputError when the file cannot be
/// read.
Graph read_graph(const std::string& path);

/// Same for text; `name` stands for the file in messages, `folder` for relative paths.
Graph parse_graph(const std::string& text, const std::string& name,
                  const std::string& folder = ".");

/// What an op that is a graph begins with.
inline constexpr std::string_view graph_prefix = "graph:";

/// An op as a graph file in `folder` writes it, with the path of a graph made absolute.
std::string op_from(const std::string& folder, const std::string& op);

/// The graph with other ops in the nodes that take theirs from a parameter (`op: $name`; see
/// Graph::ops). Checked as read_graph() does, against the graph's own text.
Graph graph_with_ops(const Graph& graph,
                     const std::map<std::string, std::string, std::less<>>& ops);

/// A graph as a kind of node: its inputs, outputs and parameters as ports and parameters. It has no
/// create(); the planner puts the graph's nodes in its place. Outputs whose kind is not known
/// before planning are declared as images.
NodeInfo graph_signature(const Graph& graph);

/// Where a graph lies: at the path, relative ones from `folder`, or by name in the folders of
/// $RAYLOOM_GRAPH_PATH and among those that come with rayloom. Nothing when it is in none of them.
std::optional<std::string> locate_graph(const std::string& name_or_path,
                                        const std::string& folder = ".");

/// The same from where the process runs. Throws InputError that lists the places searched.
std::string find_graph(const std::string& name_or_path);

/// Names of the graphs find_graph() finds by name, sorted.
std::vector<std::string> graph_names();

} // namespace rayloom
