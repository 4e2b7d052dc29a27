// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/graph_reader.h"

#include "rayloom/core/text.h"
#include "rayloom/graph/expression.h"
#include "rayloom/graph/names.h"

#include <algorithm>

namespace rayloom::reading
{

namespace
{

/// Every stream a node depends on.
std::vector<StreamReference> dependencies(const GraphNode& node)
{
    std::vector<StreamReference> out;
    for (const Argument& argument : node.arguments)
        out.insert(out.end(), argument.streams.begin(), argument.streams.end());
    if (node.otherwise) out.push_back(*node.otherwise);
    if (node.when)
        for (const StreamReference& stream : references(*node.when)) out.push_back(stream);
    return out;
}

} // namespace

std::optional<StreamReference> GraphReader::reference(const Value& value, const std::string& what)
{
    if (!value.is_scalar()) {
        problem(value.where, what + "wants a reference, this is " + value.describe());
        return std::nullopt;
    }
    if (value.text.starts_with('$')) {
        problem(value.where, what + "wants a reference; '" + value.text +
                                 "' is a parameter, which only parameters take");
        return std::nullopt;
    }
    std::string reason;
    auto out = parse_stream_reference(value.text, value.where, reason);
    if (!out) problem(value.where, what + "'" + value.text + "': " + reason);
    return out;
}

std::optional<StreamReference> GraphReader::checked_reference(const Value& value,
                                                              const std::string& what)
{
    const auto stream = reference(value, what);
    if (stream) check_reference(*stream, what);
    return stream;
}

void GraphReader::check_reference(const StreamReference& stream, const std::string& what)
{
    if (m_graph.input(stream.node)) {
        m_used_inputs.insert(stream.node);
        if (!stream.port.empty())
            problem(stream.where, what + "'" + stream_text(stream) + "': '" + stream.node +
                                      "' is an input of the graph and has no outputs");
        return;
    }
    const std::size_t i = node_index(stream.node);
    if (i == m_graph.nodes.size()) {
        auto names = names_of(m_graph.nodes, [](const GraphNode& n) { return n.id; });
        for (const GraphInput& input : m_graph.inputs) names.push_back(input.name);
        problem(stream.where, what + "'" + stream.node + "' is neither a node nor an input" +
                                  suggestion(stream.node, names));
        return;
    }
    if (!m_trees[i].info) return;
    const NodeInfo& info = *m_trees[i].info;
    if (info.outputs.empty())
        problem(stream.where,
                what + "node '" + stream.node + "' (" + m_graph.nodes[i].op + ") has no output");
    else if (!stream.port.empty() && !info.output(stream.port))
        problem(stream.where,
                what + "node '" + stream.node + "' (" + m_graph.nodes[i].op + ") has no output '" +
                    stream.port + "'" +
                    suggestion(stream.port,
                               names_of(info.outputs, [](const PortInfo& p) { return p.name; })));
}

std::size_t GraphReader::node_index(const std::string& id) const
{
    const auto it = m_node_index.find(id);
    return it == m_node_index.end() ? m_graph.nodes.size() : it->second;
}

void GraphReader::find_cycles()
{
    enum class Mark { fresh, open, done };
    std::vector<Mark> marks(m_graph.nodes.size(), Mark::fresh);
    struct Step {
        std::size_t node;
        std::vector<StreamReference> streams;
        std::size_t next = 0;
    };
    std::vector<Step> path;
    for (std::size_t start = 0; start < m_graph.nodes.size(); ++start) {
        if (marks[start] != Mark::fresh) continue;
        marks[start] = Mark::open;
        path.push_back({start, dependencies(m_graph.nodes[start])});
        while (!path.empty()) {
            Step& step = path.back();
            if (step.next == step.streams.size()) {
                marks[step.node] = Mark::done;
                m_order.push_back(step.node);
                path.pop_back();
                continue;
            }
            const StreamReference stream = step.streams[step.next++];
            const auto it = m_node_index.find(stream.node);
            if (it == m_node_index.end() || m_graph.input(stream.node)) continue;
            if (marks[it->second] == Mark::open) {
                report_cycle(
                    stream,
                    [&] {
                        std::vector<std::size_t> nodes;
                        for (const Step& s : path) nodes.push_back(s.node);
                        return nodes;
                    }(),
                    it->second);
            } else if (marks[it->second] == Mark::fresh) {
                marks[it->second] = Mark::open;
                path.push_back({it->second, dependencies(m_graph.nodes[it->second])});
            }
        }
    }
}

void GraphReader::report_cycle(const StreamReference& stream, const std::vector<std::size_t>& path,
                               std::size_t to)
{
    // The path runs from a node to what it reads; data flows the other way.
    std::string chain = m_graph.nodes[to].id;
    for (auto it = path.rbegin(); it != path.rend(); ++it) {
        chain += " -> " + m_graph.nodes[*it].id;
        if (*it == to) break;
    }
    problem(stream.where, label(m_graph.nodes[path.back()]) + "depends on itself: " + chain);
}

} // namespace rayloom::reading
