// SPDX-License-Identifier: Apache-2.0
/// \file
/// Everything that is held to the same rules by being there: the example of each registered node
/// and each shipped graph.
#pragma once

#include "rayloom/graph/model.h"

#include <string>
#include <vector>

namespace rayloom::test
{

/// Names of the nodes that come with rayloom, sorted.
std::vector<std::string> built_in_nodes();

/// The example of a node as a graph; paths in it lead to files of the tests.
Graph example_graph(const std::string& node);

/// Whether a graph reads or writes files by itself, so that it cannot run on images in memory
/// alone.
bool touches_files(const Graph& graph);

/// Paths of the graphs in graphs/, sorted.
std::vector<std::string> shipped_graphs();

/// A name a test may have: the file name (or node) with everything but letters and digits replaced.
std::string as_test_name(const std::string& subject);

} // namespace rayloom::test
