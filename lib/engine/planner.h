// SPDX-License-Identifier: Apache-2.0
/// \file
/// Inside of make_plan(): a graph is expanded node by node into ops, work items and streams. Split
/// over planner_*.cpp by what is done: values and parameters, ops, expansion, outputs.
#pragma once

#include "rayloom/engine/plan.h"
#include "rayloom/graph/expression.h"

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace rayloom::planning
{

/// What a name stands for while a graph is expanded.
struct Value {
    struct TableRef {
        int op = -1;
        std::string port;
    };
    PortKind kind = PortKind::image;
    bool list = false;
    bool absent = false; ///< an optional input nobody bound, or a node whose `when` is false
    bool broken = false; ///< its maker could not be planned; reported already
    std::vector<int> streams;
    std::vector<TableRef> tables;

    std::size_t count() const { return kind == PortKind::table ? tables.size() : streams.size(); }
};

/// Values of one graph while it is expanded: node or input name → port → value.
struct Scope {
    const Graph* graph = nullptr;
    std::string prefix; ///< "outer/" inside a graph used as a node
    ParamValues params;
    std::map<std::string, std::map<std::string, Value, std::less<>>, std::less<>> values;
    std::map<std::string, std::vector<std::string>, std::less<>> port_order; ///< as declared
};

/// SHA-1 of a text, in hexadecimal.
std::string digest(const std::string& text);

class Planner
{
public:
    Planner(const RunRequest& request, const RunOptions& options)
        : m_request(request), m_options(options)
    {
        m_plan.skip = options.skip;
    }

    Plan make(const Graph& written);

private:
    // Expansion
    void bind_inputs(const Graph& graph, Scope& scope);
    Value bind_input(const GraphInput& input, const InputBinding& binding);
    void bind_params(const Graph& graph, Scope& scope);
    /// The graph with the ops that the scope's parameters name; in the scope their paths become
    /// absolute.
    const Graph& bind_ops(const Graph& graph, Scope& scope);
    void expand(Scope& scope);
    void expand_node(Scope& scope, const GraphNode& node);
    void expand_graph_node(Scope& scope, const GraphNode& node);
    void plan_outputs(const Graph& graph, Scope& scope);
    void add_output(const GraphOutput& declared, const OutputBinding* binding, const Value& value);
    /// Nodes that write files (io.write) are ends of the run as the outputs are.
    void add_writing_nodes();
    /// Throws UsageError when two outputs or writing nodes name one file.
    void refuse_shared_files() const;

    // Lookup
    Value lookup(const Scope& scope, const StreamReference& ref);
    Value argument_value(const Scope& scope, const Argument& argument);
    ParamValue item_value(const Scope& scope,
                          const std::variant<ParamValue, ParamReference>& item) const;
    ParamValues node_params(const Scope& scope, const GraphNode& node,
                            const std::vector<ParamInfo>& infos,
                            std::optional<std::size_t> mapped_index);

    // Making ops
    struct NewOp {
        std::string id, name;
        OpRole role = OpRole::node;
        SourcePosition where;
        const NodeInfo* info = nullptr;
        ParamValues params;
        std::unique_ptr<Node> node;
        std::vector<PortInfo> inputs, outputs;
        std::map<std::string, Value, std::less<>>
            arguments;              ///< connected inputs, absent ones left out
        std::optional<Region> crop; ///< sinks: only these pixels
    };
    /// Plans one op and makes its items and streams; empty when it could not be planned.
    std::optional<std::map<std::string, Value, std::less<>>> add_op(NewOp request);
    int add_stream(Stream stream);
    std::map<std::string, Value, std::less<>>
    add_node_op(OpRole role, const std::string& id, const std::string& op, ParamValues params,
                std::map<std::string, Value, std::less<>> arguments, const SourcePosition& where,
                std::optional<Region> crop = {});

    void describe_files(const Graph& graph);
    void prune();
    void choose_inlined();
    void choose_in_place(WorkItem& item, const std::vector<int>& uses);
    void find_files();
    bool stream_black(int stream);
    bool channel_black(int stream, int channel);

    void problem(const SourcePosition& where, std::string message)
    {
        m_problems.push_back({where, std::move(message)});
    }

    friend class Facts;

    const RunRequest& m_request;
    const RunOptions& m_options;
    Plan m_plan;
    std::vector<Problem> m_problems;
    std::vector<std::string> m_input_errors;
    /// Graphs read again with other ops, by the graph as it was and the ops.
    std::map<std::pair<const Graph*, std::map<std::string, std::string, std::less<>>>,
             std::unique_ptr<const Graph>>
        m_bound;
    std::vector<NewOp> m_pending; ///< copies and constants to make once their op is in place
    std::map<int, std::map<std::string, std::vector<int>, std::less<>>>
        m_op_inputs; ///< op → port → streams
    std::map<int, std::map<std::string, std::vector<int>, std::less<>>> m_reduce_streams;
    std::map<std::pair<int, int>, bool> m_black; ///< (stream, channel) → zero everywhere
};

} // namespace rayloom::planning
