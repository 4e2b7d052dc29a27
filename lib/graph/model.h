// SPDX-License-Identifier: Apache-2.0
/// \file
/// A graph file in memory, as written: names are not resolved and nothing is planned yet.
/// docs/graph-format.md is the reference of the format.
#pragma once

#include "rayloom/core/error.h"
#include "rayloom/core/node.h"
#include "rayloom/core/param.h"

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace rayloom
{

/// `$name`: the value of a graph parameter.
struct ParamReference {
    std::string name;
};

/// `color`, `stats.mean`, `levels[1]`, `lobes.radiance[0]`: a graph input or a node's output.
struct StreamReference {
    std::string node;         ///< node or graph-input name
    std::string port;         ///< empty: the only (or first declared) output
    std::optional<int> index; ///< element of a list
    SourcePosition where;
};

/// What stands right of `key:` in a node: references when the key is an input port (several for a
/// list written as `[a, b]`), a literal or `$name` (also inside a list) when it is a parameter.
struct Argument {
    std::string key;
    SourcePosition where;       ///< of the key
    SourcePosition value_where; ///< of the value
    bool is_port = false;
    std::vector<StreamReference> streams; ///< when is_port
    bool streams_are_list = false;        ///< `[a, b]` rather than `a`
    /// When a parameter. A sequence of scalars is a sequence of items (each may be a `$name`); the
    /// planner hands it over as a list parameter, or element by element when the node is mapped.
    std::vector<std::variant<ParamValue, ParamReference>> items;
    bool items_are_list = false;
};

/// A `when:` condition: an expression over `has(input)`, `count(input)`, `channels(input)`,
/// `black(input)`, `$param`, literals, `== != < <= > >=`, `and`, `or`, `not`, parentheses.
struct Expression {
    enum class Kind { literal, param, call, unary_not, binary };
    Kind kind = Kind::literal;
    ParamValue literal = false;
    std::string name;         ///< parameter, function or operator
    StreamReference argument; ///< of a call
    std::vector<Expression> operands;
    SourcePosition where;
};

struct GraphNode {
    std::string id;
    SourcePosition where;
    std::string op; ///< "fuse.histogram", or "graph:other.yaml"
    SourcePosition op_where;
    std::string op_param; ///< the parameter `op: $name` takes it from; empty: written as it is
    /// Inputs and parameters that are written here, that the default of `op_param` has and `op`
    /// does not.
    std::vector<std::string> left_out;
    std::vector<Argument> arguments;
    std::optional<Expression> when;
    /// Stands in for the node's outputs when `when` is false; without it they are absent.
    std::optional<StreamReference> otherwise;
    /// The graph an `op: graph:…` names, read and validated.
    std::shared_ptr<const struct Graph> graph;
    /// What each output carries (the first also under ""), as GraphOutput::kind; outputs whose kind
    /// is known only once the graph is planned are left out.
    std::map<std::string, PortKind, std::less<>> carries;

    const Argument* argument(std::string_view key) const;
};

struct GraphParam {
    ParamInfo info;
    SourcePosition where;
    /// Some node takes its op from it (`op: $name`), here or in a graph inside.
    bool names_op = false;
};

/// `neighbours: frame@-5..-1`: the files of another input's pattern at frames counted from the
/// current one.
struct NeighbourFrames {
    std::string input;
    int first = 0, last = 0;
    SourcePosition where;
};

/// Declared under `inputs:`.
struct GraphInput {
    std::string name;
    SourcePosition where;
    std::string doc;
    PortKind kind = PortKind::image; ///< image, list or deep
    bool required = true;
    /// Channels the graph wants: "RGB" (colour, alpha too when there is one), "any", or a comma
    /// list of names.
    std::string channels = "any";
    /// Role the renderer map translates into a layer name ("beauty", "albedo", "variance", …) when
    /// the caller names none. Empty: the whole file's channels (its default layer when channels is
    /// "RGB").
    std::string role;
    /// What the command reads when the caller names no files.
    std::optional<NeighbourFrames> neighbours;
};

/// Declared under `outputs:`.
struct GraphOutput {
    std::string name;
    SourcePosition where;
    StreamReference stream;
    std::string doc;
    /// What the output carries when every input carries what it declares; nothing when that is
    /// known only once the graph is planned.
    std::optional<PortKind> kind;
};

struct Graph {
    std::string file;   ///< as given, for messages; empty for text
    std::string folder; ///< paths in the graph are relative to it
    std::string name;
    std::string doc;
    std::vector<GraphParam> params;
    std::vector<GraphInput> inputs;
    std::vector<GraphNode> nodes; ///< in file order
    std::vector<GraphOutput> outputs;
    std::string text; ///< the file's text, part of cache keys and error excerpts
    /// What the parameters that name ops stand for in `nodes`, as op_from() writes it.
    std::map<std::string, std::string, std::less<>> ops;
    /// What is allowed and yet looks like a slip: a parameter or an input nobody uses.
    std::vector<Problem> warnings;
    /// Nodes once every graph used as a node is put in its place.
    std::size_t expanded_nodes = 0;

    const GraphNode* node(std::string_view id) const;
    const GraphInput* input(std::string_view input_name) const;
    const GraphParam* param(std::string_view param_name) const;
    const GraphOutput* output(std::string_view output_name) const;
};

} // namespace rayloom
