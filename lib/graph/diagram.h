// SPDX-License-Identifier: Apache-2.0
/// \file
/// A graph as boxes and edges: what is drawn, whatever draws it.
#pragma once

#include "rayloom/graph/model.h"

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace rayloom::diagram
{

enum class Role { input, node, output };

struct Box {
    Role role = Role::node;
    std::string id;                   ///< name in the graph
    std::string op;                   ///< of a node
    std::vector<std::string> details; ///< parameters and condition, or the kind of an input
    std::string doc;
};

struct Edge {
    std::size_t from = 0, to = 0;
    std::string label; ///< the output it leaves by and the input it enters by, where not plain
    std::optional<PortKind> kind;
    bool otherwise = false;
};

/// A graph as boxes and edges, shared by both kinds of picture.
struct Diagram {
    std::vector<Box> boxes;
    std::vector<Edge> edges;
};

Diagram make_diagram(const Graph& graph);

/// Fill and outline of a box: quiet colours, one a stage, so that a glance tells reading from
/// fusing from measuring.
struct Paint {
    const char* fill;
    const char* line;
};

Paint paint_of(const Box& box);

/// Text inside markup: `&`, `<`, `>` and quotes as entities.
std::string escaped(const std::string& text);

} // namespace rayloom::diagram
