// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/graph_reader.h"

#include "rayloom/core/text.h"
#include "rayloom/graph/expression.h"
#include "rayloom/graph/reader.h"

#include <algorithm>
#include <filesystem>

namespace rayloom::reading
{

namespace
{

namespace fs = std::filesystem;

constexpr std::size_t max_graph_depth = 16;

bool has_key(const NodeInfo& info, const std::string& key)
{
    return info.input(key) || info.param(key);
}

std::string op_suggestion(const std::string& op)
{
    const std::vector<std::string> names = Registry::instance().names();
    if (!closest_name(op, names).empty()) return suggestion(op, names);
    const std::size_t dot = op.find('.');
    const std::string stage = op.substr(0, dot);
    std::vector<std::string> same_what;
    std::vector<std::string> same_stage;
    for (const std::string& name : names) {
        const std::size_t split = name.find('.');
        if (dot == std::string::npos && name.substr(split + 1) == op) same_what.push_back(name);
        if (dot != std::string::npos && name.substr(0, split) == stage) same_stage.push_back(name);
    }
    if (same_what.size() == 1) return "; did you mean '" + same_what[0] + "'?";
    if (same_what.size() > 1) return "; there is: " + join_names(same_what);
    if (!same_stage.empty() && same_stage.size() <= 24)
        return "; under '" + stage + "' there is: " + join_names(same_stage);
    return "; 'rayloom nodes' lists them";
}

} // namespace

void GraphReader::read_node(const Entry& entry)
{
    if (!check_name(entry.key, entry.where, "node")) return;
    GraphNode node;
    node.id = entry.key;
    node.where = entry.where;
    const Value& value = *entry.value;
    const Entry* op = nullptr;
    if (!value.is_mapping()) {
        problem(value.where, label(node) + "wants a mapping such as {op: stage.what, …}, this is " +
                                 value.describe());
    } else if (op = value.find("op"); !op) {
        problem(entry.where, label(node) + "'op' is missing");
    } else if (!op->value->is_scalar()) {
        problem(op->value->where,
                label(node) + "'op' wants the name of a node, this is " + op->value->describe());
        op = nullptr;
    }
    NodeTree tree;
    if (op) {
        node.op = op->value->text;
        node.op_where = op->value->where;
    }
    tree.value = entry.value;
    m_node_index.emplace(node.id, m_graph.nodes.size());
    m_graph.nodes.push_back(std::move(node));
    m_trees.push_back(std::move(tree));
}

void GraphReader::resolve_ops()
{
    for (std::size_t i = 0; i < m_graph.nodes.size(); ++i) {
        GraphNode& node = m_graph.nodes[i];
        if (node.op.empty()) continue;
        if (!node.op.starts_with('$')) {
            m_trees[i].info = find_op(node);
            continue;
        }
        m_trees[i].default_info = bind_op(node);
        if (m_trees[i].default_info) m_trees[i].info = find_op(node);
    }
}

std::optional<NodeInfo> GraphReader::bind_op(GraphNode& node)
{
    const std::string name = node.op.substr(1);
    const auto refuse = [&](const std::string& why) {
        problem(node.op_where, "node '" + node.id + "': op '$" + name + "' " + why);
        return std::nullopt;
    };
    const auto param = std::find_if(m_graph.params.begin(), m_graph.params.end(),
                                    [&](const GraphParam& p) { return p.info.name == name; });
    if (param == m_graph.params.end())
        return refuse("is not declared under params" +
                      suggestion(name, names_of(m_graph.params,
                                                [](const GraphParam& p) { return p.info.name; })));
    m_used_params.insert(name);
    if (m_broken_params.contains(name)) return std::nullopt;
    if (param->info.type != ParamType::text)
        return refuse("wants a parameter of type string, not of type " +
                      std::string(param_type_name(param->info.type)));
    if (param->info.required)
        return refuse("wants a parameter with a default: it says which inputs and parameters "
                      "there are to give");
    param->names_op = true;
    node.op_param = name;
    node.op = std::get<std::string>(param->info.default_value);
    m_graph.ops[name] = op_from(m_graph.folder, node.op);
    std::optional<NodeInfo> info = find_op(node);
    if (const auto chosen = m_ops.find(name); chosen != m_ops.end()) {
        m_graph.ops[name] = chosen->second;
        node.op = chosen->second;
        node.graph = nullptr;
    }
    return info;
}

std::optional<NodeInfo> GraphReader::find_op(GraphNode& node)
{
    if (node.op.starts_with(graph_prefix)) {
        node.graph = find_graph_node(node);
        if (node.graph) return graph_signature(*node.graph);
        return std::nullopt;
    }
    if (const NodeInfo* info = Registry::instance().find(node.op)) return *info;
    problem(node.op_where,
            "node '" + node.id + "': op '" + node.op + "' is not known" + op_suggestion(node.op));
    return std::nullopt;
}

std::shared_ptr<const Graph> GraphReader::find_graph_node(const GraphNode& node)
{
    const std::string given = node.op.substr(graph_prefix.size());
    if (given.empty()) {
        problem(node.op_where, label(node) + "'graph:' wants a file: 'graph:other.yaml'");
        return nullptr;
    }
    const std::optional<std::string> found = locate_graph(given, m_graph.folder);
    const fs::path path = found.value_or(path_from(m_graph.folder, given));
    std::error_code error;
    if (!found && !fs::is_directory(path, error)) {
        const std::string near = closest_name(fs::path(given).stem().string(), graph_names());
        problem(node.op_where, label(node) + "there is no graph '" + given +
                                   "', neither beside this one nor by name" +
                                   (near.empty() ? "; 'rayloom graphs' lists the names"
                                                 : "; did you mean '" + near + "'?"));
        return nullptr;
    }
    const std::string shown = path.lexically_normal().string();
    fs::path canonical = fs::weakly_canonical(path, error);
    if (error) canonical = fs::absolute(path, error);
    const auto open = std::find_if(m_state.open.begin(), m_state.open.end(), [&](const auto& file) {
        return file.first == canonical.string();
    });
    if (open != m_state.open.end()) {
        std::string chain;
        for (auto it = open; it != m_state.open.end(); ++it) chain += it->second + " -> ";
        problem(node.op_where, label(node) + "the graph uses itself: " + chain + open->second);
        return nullptr;
    }
    if (m_state.open.size() >= max_graph_depth) {
        problem(node.op_where, label(node) + "graphs within graphs more than " +
                                   std::to_string(max_graph_depth) + " deep");
        return nullptr;
    }
    if (const auto it = m_state.done.find(canonical.string()); it != m_state.done.end())
        return it->second;
    std::shared_ptr<const Graph> inner;
    m_state.open.emplace_back(canonical.string(), shown);
    const std::size_t before = m_state.problems.size();
    try {
        Graph read =
            read_tree(read_text(path.string()), shown, path.parent_path().string(), m_state);
        if (m_state.problems.size() == before)
            inner = std::make_shared<const Graph>(std::move(read));
    } catch (const InputError& failure) {
        problem(node.op_where, label(node) + failure.what());
    }
    m_state.open.pop_back();
    m_state.done[canonical.string()] = inner;
    return inner;
}

void GraphReader::resolve_nodes()
{
    for (std::size_t i = 0; i < m_graph.nodes.size(); ++i) {
        GraphNode& node = m_graph.nodes[i];
        NodeTree& tree = m_trees[i];
        if (!tree.value->is_mapping()) continue;
        for (const Entry& entry : tree.value->entries) {
            if (entry.key == "op") continue;
            if (entry.key == "when")
                read_when(node, entry);
            else if (entry.key == "otherwise")
                node.otherwise = checked_reference(*entry.value, label(node) + "'otherwise': ");
            else if (tree.info && tree.default_info && !has_key(*tree.info, entry.key) &&
                     has_key(*tree.default_info, entry.key))
                node.left_out.push_back(entry.key);
            else if (tree.info)
                read_argument(node, *tree.info, entry);
        }
        if (node.otherwise && !tree.value->find("when"))
            problem(tree.value->find("otherwise")->where,
                    label(node) + "'otherwise' means nothing without 'when'");
        if (tree.info) check_missing(node, *tree.info, *tree.value);
    }
}

void GraphReader::read_when(GraphNode& node, const Entry& entry)
{
    const Value& value = *entry.value;
    if (!value.is_scalar()) {
        problem(value.where, label(node) +
                                 "'when' wants a condition such as has(albedo), "
                                 "this is " +
                                 value.describe());
        return;
    }
    SourcePosition where = value.where;
    const bool exact = stands_in_file(value, where);
    std::vector<Problem> found;
    node.when = parse_expression(value.text, where, exact, found);
    if (node.when) check_expression(*node.when, m_graph, found);
    for (Problem& p : found) problem(p.where, label(node) + "'when': " + p.message);
    if (!node.when) return;
    for (const std::string& name : parameters(*node.when)) m_used_params.insert(name);
    for (const StreamReference& stream : references(*node.when))
        check_reference(stream, label(node) + "'when': ");
}

bool GraphReader::stands_in_file(const Value& value, SourcePosition& where) const
{
    std::size_t at = 0;
    for (int line = 1; line < where.line; ++line) {
        at = m_graph.text.find('\n', at);
        if (at == std::string::npos) return false;
        ++at;
    }
    // Columns count characters; step over the bytes that continue one.
    for (int column = 1; column < where.column && at < m_graph.text.size(); ++column) do
            ++at;
        while (at < m_graph.text.size() &&
               (static_cast<unsigned char>(m_graph.text[at]) & 0xc0) == 0x80);
    if (m_graph.text.compare(at, value.text.size(), value.text) == 0) return true;
    if (at + 1 < m_graph.text.size() &&
        m_graph.text.compare(at + 1, value.text.size(), value.text) == 0) {
        ++where.column;
        return true;
    }
    return false;
}

} // namespace rayloom::reading
