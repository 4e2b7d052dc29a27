// SPDX-License-Identifier: Apache-2.0
/// \file
/// Nodes that exist only in tests: one of every kind of port and parameter, so that tests of the
/// graph file do not lean on what the built-in nodes happen to declare.
#pragma once

namespace rayloom::test
{

/// Registers the nodes of stage `mock.` (once; further calls do nothing):
/// gain, blend, levels, join, flatten, measure, apply, save, files, types.
void register_graph_nodes();

} // namespace rayloom::test
