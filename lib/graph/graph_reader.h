// SPDX-License-Identifier: Apache-2.0
/// \file
/// Inside of read_graph(): turns the tree of one graph file into a Graph and collects every mistake
/// in it. Split over graph_reader*.cpp by what is read.
#pragma once

#include "rayloom/core/registry.h"
#include "rayloom/graph/model.h"
#include "rayloom/graph/yaml.h"

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

namespace rayloom::reading
{

using yaml::Entry;
using yaml::Value;

/// Keys of a node that are words of the format.
inline const std::vector<std::string> node_keys{"op", "when", "otherwise"};

template <class T, class Name>
std::vector<std::string> names_of(const T& items, Name name)
{
    std::vector<std::string> out;
    for (const auto& item : items) out.push_back(name(item));
    return out;
}

/// What a stream carries as far as the file alone says.
enum class Shape { unknown, image, list, deep, table };
Shape shape_of(PortKind kind);
std::optional<PortKind> kind_of(Shape shape);

/// Shared by a graph and the graphs it uses as nodes.
struct ReadState {
    std::vector<Problem> problems;
    /// Graphs already read, by canonical path; null for one with problems.
    std::map<std::string, std::shared_ptr<const Graph>> done;
    /// Files being read, outermost first: canonical path and path as shown.
    std::vector<std::pair<std::string, std::string>> open;
};

/// The text of a graph file. Throws InputError when it cannot be read.
std::string read_text(const std::string& path);

/// Values of parameters that name ops, in place of their defaults; paths are absolute.
using Ops = std::map<std::string, std::string, std::less<>>;

/// Reads text into a Graph; what is wrong is added to `state.problems`.
Graph read_tree(const std::string& text, const std::string& name, const std::string& folder,
                ReadState& state, const Ops& ops = {});

/// A path as a graph file in `folder` writes it (relative to itself) as the process takes it.
std::string path_from(const std::string& folder, const std::string& written);

/// Turns one file's tree into a Graph.
class GraphReader
{
public:
    GraphReader(Graph& graph, ReadState& state, const Ops& ops)
        : m_graph(graph), m_state(state), m_ops(ops)
    {
    }

    void read(const Value& root);

private:
    void problem(const SourcePosition& where, std::string message)
    {
        m_state.problems.push_back({where, std::move(message)});
    }

    /// "node 'fused' (fuse.histogram): "
    static std::string label(const GraphNode& node)
    {
        return "node '" + node.id + "'" + (node.op.empty() ? "" : " (" + node.op + ")") + ": ";
    }

    // graph_reader.cpp: sections, inputs, outputs, the whole
    bool unknown_key(const Entry& entry, const std::vector<std::string>& known,
                     const std::string& what);
    /// Text of a scalar; a problem and nothing for anything else.
    std::optional<std::string> text_of(const Entry& entry, const std::string& what);
    std::optional<bool> truth_of(const Entry& entry, const std::string& what);
    std::optional<double> number_of(const Entry& entry, const std::string& what);
    bool check_name(const std::string& name, const SourcePosition& where, const std::string& what);
    bool reserved(const std::string& name, const SourcePosition& where, const std::string& what);
    /// Checks that a section is a mapping and hands its entries over.
    void each_entry(const Entry& section, const std::function<void(const Entry&)>& read_entry);
    void check_version(const Value& root);
    void read_section(const Entry& entry);
    void read_input(const Entry& entry);
    void read_input_key(GraphInput& input, const Entry& entry, const std::string& what);
    void read_neighbours(GraphInput& input, const Entry& entry, const std::string& what);
    void read_channels(GraphInput& input, const Entry& entry, const std::string& what);
    void check_name_clashes();
    void check_neighbours();
    void resolve_outputs(const Value& root);
    std::string example_node() const;
    void read_output(const Entry& entry);
    void warn_unused();
    void count_expanded();

    // graph_reader_params.cpp: declared parameters, and values of parameters
    void read_param(const Entry& entry);
    bool read_param_mapping(ParamInfo& info, const Value& value, const std::string& what);
    bool read_choices(ParamInfo& info, const Entry& entry, const std::string& what);
    bool read_range(ParamInfo& info, const Value& value, const std::string& what);
    /// The type of a parameter that only has a default.
    bool infer_type(ParamInfo& info, const Value& value, const std::string& what);
    bool read_default(ParamInfo& info, const Value& value, bool typed, const std::string& what);
    /// A scalar or a list of scalars, checked against the declaration.
    std::optional<ParamValue> literal(const ParamInfo& info, const Value& value,
                                      std::string& reason) const;

    // graph_reader_nodes.cpp: nodes, what their op names, conditions
    void read_node(const Entry& entry);
    void resolve_ops();
    /// Declaration behind a node's op; empty when there is none.
    std::optional<NodeInfo> find_op(GraphNode& node);
    /// Puts what `op: $name` stands for in its place.
    /// \return the declaration behind the parameter's default, which says what keys there can be.
    std::optional<NodeInfo> bind_op(GraphNode& node);
    std::shared_ptr<const Graph> find_graph_node(const GraphNode& node);
    void resolve_nodes();
    void read_when(GraphNode& node, const Entry& entry);
    /// Whether a scalar stands in the file character for character, so that positions within it
    /// can be told; moves `where` behind an opening quote.
    bool stands_in_file(const Value& value, SourcePosition& where) const;

    // graph_reader_arguments.cpp: what a node is given
    void read_argument(GraphNode& node, const NodeInfo& info, const Entry& entry);
    /// A parameter of a graph that names an op there: the graph parameters it is given from name
    /// ops too, and paths are relative to this file.
    void pass_op(const GraphNode& node, Argument& argument);
    void read_streams(const GraphNode& node, const PortInfo& port, Argument& argument,
                      const Value& value);
    void read_items(const GraphNode& node, const ParamInfo& info, Argument& argument,
                    const Value& value);
    void read_item(const ParamInfo& info, Argument& argument, const Value& value,
                   const std::string& what);
    /// A graph parameter must be of a type the node's parameter takes, and its default and its
    /// choices must be allowed there.
    void check_param_reference(const ParamInfo& info, const std::string& name, bool in_list,
                               const Value& value, const std::string& what);
    void check_missing(const GraphNode& node, const NodeInfo& info, const Value& value);

    // graph_reader_references.cpp: names of streams, order, cycles
    std::optional<StreamReference> reference(const Value& value, const std::string& what);
    std::optional<StreamReference> checked_reference(const Value& value, const std::string& what);
    /// The name and the port exist; what the stream carries is looked at later.
    void check_reference(const StreamReference& stream, const std::string& what);
    std::size_t node_index(const std::string& id) const;
    /// Orders the nodes so that each follows what it depends on; reports each cycle once. The walk
    /// keeps its own stack: a chain of nodes may be as long as the file allows.
    void find_cycles();
    void report_cycle(const StreamReference& stream, const std::vector<std::size_t>& path,
                      std::size_t to);

    // graph_reader_shapes.cpp: what streams carry
    /// Follows images and lists through the graph in the order of dependence and reports what can
    /// never fit. Needs every name to be right, so it says nothing about what is already wrong.
    void infer_shapes();
    void infer_node(GraphNode& node, const NodeInfo& info);
    /// A list given to a parameter of one value needs a list of images to go along with.
    void check_lone_items(const GraphNode& node, const NodeInfo& info);
    Shape stream_shape(const StreamReference& stream, const std::string& what);
    void check_shape(const GraphNode& node, const PortInfo& port, const StreamReference& stream,
                     Shape shape, bool in_list);

    struct NodeTree {
        std::optional<NodeInfo> info;
        std::optional<NodeInfo> default_info; ///< of the default, when the op is a parameter
        yaml::ValuePtr value;
    };

    Graph& m_graph;
    ReadState& m_state;
    const Ops& m_ops;
    std::vector<NodeTree> m_trees; ///< beside m_graph.nodes
    std::unordered_map<std::string, std::size_t> m_node_index;
    std::vector<std::size_t> m_order; ///< each after what it depends on
    std::set<std::string> m_broken_params, m_used_params, m_used_inputs;
    std::map<std::pair<std::string, std::string>, Shape> m_shapes;
    bool m_outputs_seen = false;
};

} // namespace rayloom::reading
