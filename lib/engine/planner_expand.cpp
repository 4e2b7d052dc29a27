// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/planner.h"

#include "rayloom/core/text.h"
#include "rayloom/engine/engine_nodes.h"
#include "rayloom/graph/reader.h"

#include <algorithm>
#include <functional>
#include <set>

namespace rayloom::planning
{

/// Answers for `when:` conditions.
class Facts final : public ExpressionScope
{
public:
    Facts(Planner& planner, const Scope& scope) : m_planner(planner), m_scope(scope) {}

    ParamValue param(const std::string& name) const override
    {
        const auto it = m_scope.params.find(name);
        return it == m_scope.params.end() ? ParamValue(false) : it->second;
    }
    bool has(const StreamReference& ref) const override { return !value(ref).absent; }
    std::size_t count(const StreamReference& ref) const override { return value(ref).count(); }
    std::size_t channels(const StreamReference& ref) const override
    {
        const Value v = value(ref);
        return v.streams.empty() ? 0
                                 : m_planner.m_plan.streams[static_cast<std::size_t>(v.streams[0])]
                                       .desc.channels.size();
    }
    bool black(const StreamReference& ref) const override
    {
        const Value v = value(ref);
        return !v.streams.empty() &&
               std::ranges::all_of(v.streams, [&](int s) { return m_planner.stream_black(s); });
    }

private:
    Value value(const StreamReference& ref) const { return m_planner.lookup(m_scope, ref); }

    Planner& m_planner;
    const Scope& m_scope;
};

void Planner::bind_params(const Graph& graph, Scope& scope)
{
    std::vector<std::string> names;
    for (const GraphParam& p : graph.params) {
        names.push_back(p.info.name);
        ParamValue value = p.info.default_value;
        bool given = false;
        try {
            if (const auto it = m_request.params.find(p.info.name); it != m_request.params.end()) {
                value = check_param(p.info, it->second);
                given = true;
            }
            if (const auto it = m_request.param_texts.find(p.info.name);
                it != m_request.param_texts.end()) {
                value = parse_param(p.info, it->second);
                given = true;
            }
        } catch (const NodeError& e) {
            problem(p.where, e.what());
        }
        if (p.info.required && !given)
            problem(p.where, "parameter '" + p.info.name + "' has no default; give it with -p " +
                                 p.info.name + "=…");
        scope.params[p.info.name] = std::move(value);
    }
    for (const GraphParam& p : graph.params) {
        if (!p.names_op) continue;
        // A path from the caller is relative to where the caller is, and may be a graph's name.
        auto* const op = std::get_if<std::string>(&scope.params[p.info.name]);
        if (op && ParamValue(*op) != p.info.default_value && op->starts_with(graph_prefix))
            *op = op_from("",
                          std::string(graph_prefix) + find_graph(op->substr(graph_prefix.size())));
    }
    const auto check_known = [&](const auto& given) {
        for (const auto& [name, value] : given)
            if (!graph.param(name))
                throw UsageError("graph '" + graph.name + "' has no parameter '" + name + "'" +
                                 suggestion(name, names));
    };
    check_known(m_request.params);
    check_known(m_request.param_texts);
}

const Graph& Planner::bind_ops(const Graph& graph, Scope& scope)
{
    std::map<std::string, std::string, std::less<>> ops;
    for (const GraphParam& p : graph.params) {
        auto* const op = std::get_if<std::string>(&scope.params[p.info.name]);
        if (!p.names_op || !op) continue;
        *op = op_from(graph.folder, *op);
        if (const auto read = graph.ops.find(p.info.name);
            read != graph.ops.end() && read->second != *op)
            ops[p.info.name] = *op;
    }
    if (ops.empty()) return graph;
    std::unique_ptr<const Graph>& bound = m_bound[{&graph, ops}];
    if (!bound) bound = std::make_unique<const Graph>(graph_with_ops(graph, ops));
    return *bound;
}

Value Planner::bind_input(const GraphInput& input, const InputBinding& binding)
{
    Value value;
    value.kind = input.kind == PortKind::list ? PortKind::image : input.kind;
    value.list = input.kind == PortKind::list;
    if (!binding.images.empty()) {
        if (input.kind == PortKind::deep)
            throw UsageError("input '" + input.name + "' takes a deep image, not flat pixels");
        if (!value.list && binding.images.size() > 1)
            throw UsageError("input '" + input.name + "' takes one image, not " +
                             std::to_string(binding.images.size()));
        for (const auto& image : binding.images) {
            NewOp source;
            source.id = input.name;
            source.name = "memory";
            source.role = OpRole::input;
            source.where = input.where;
            source.node = std::make_unique<MemorySource>(image);
            source.outputs = {{"image", PortKind::image, true, ""}};
            if (auto out = add_op(std::move(source)))
                value.streams.push_back(out->at("image").streams.front());
            else
                value.broken = true;
        }
        return value;
    }
    if (binding.deep) {
        if (input.kind != PortKind::deep)
            throw UsageError("input '" + input.name + "' takes flat pixels, not a deep image");
        NewOp source;
        source.id = input.name;
        source.name = "memory";
        source.role = OpRole::input;
        source.where = input.where;
        source.node = std::make_unique<MemoryDeepSource>(binding.deep);
        source.outputs = {{"deep", PortKind::deep, true, ""}};
        if (auto out = add_op(std::move(source)))
            value.streams = out->at("deep").streams;
        else
            value.broken = true;
        return value;
    }
    if (binding.files.empty()) {
        value.absent = true;
        return value;
    }
    if (!value.list && binding.files.size() > 1)
        throw UsageError("input '" + input.name + "' takes one file, not " +
                         std::to_string(binding.files.size()) +
                         " (is a pattern or glob too wide?)");

    ParamValues params;
    const std::string& layer = binding.files.front().layer;
    params["layer"] = layer;
    if (layer.empty() && !input.role.empty()) params["role"] = input.role;
    params["channels"] = input.channels;
    std::string op = "io.read";
    if (value.list) {
        op = "io.stack";
        std::vector<std::string> paths;
        for (const InputFile& file : binding.files) paths.push_back(file.path);
        params["paths"] = paths;
    } else {
        if (input.kind == PortKind::deep) op = "io.read_deep";
        params["path"] = binding.files.front().path;
    }
    const auto out = add_node_op(OpRole::input, input.name, op, std::move(params), {}, input.where);
    const auto found = out.find(Registry::instance().find(op)->outputs.front().name);
    if (found == out.end())
        value.broken = true;
    else
        value.streams = found->second.streams;
    return value;
}

void Planner::bind_inputs(const Graph& graph, Scope& scope)
{
    std::vector<std::string> names;
    for (const GraphInput& input : graph.inputs) names.push_back(input.name);
    for (const auto& [name, binding] : m_request.inputs)
        if (!graph.input(name))
            throw UsageError("graph '" + graph.name + "' has no input '" + name + "'" +
                             suggestion(name, names));
    std::vector<std::string> missing;
    for (const GraphInput& input : graph.inputs) {
        const auto given = m_request.inputs.find(input.name);
        Value value;
        if (given == m_request.inputs.end() ||
            (given->second.files.empty() && given->second.images.empty() && !given->second.deep)) {
            value.absent = true;
            value.list = input.kind == PortKind::list;
            if (input.required) missing.push_back(input.name);
        } else {
            value = bind_input(input, given->second);
        }
        scope.values[input.name][""] = value;
        scope.port_order[input.name] = {""};
    }
    if (!missing.empty())
        throw UsageError("graph '" + graph.name + "' needs input" +
                         (missing.size() > 1 ? "s " : " ") + join_names(missing, true) + "; give " +
                         (missing.size() > 1 ? "them" : "it") + " with -i " + missing.front() +
                         "=FILE");
}

void Planner::expand(Scope& scope)
{
    // References first: a node is expanded after the nodes it names.
    std::set<std::string> done;
    std::function<void(const GraphNode&)> visit = [&](const GraphNode& node) {
        if (!done.insert(node.id).second) return;
        const auto visit_ref = [&](const StreamReference& ref) {
            if (const GraphNode* before = scope.graph->node(ref.node)) visit(*before);
        };
        for (const Argument& argument : node.arguments)
            for (const StreamReference& ref : argument.streams) visit_ref(ref);
        if (node.otherwise) visit_ref(*node.otherwise);
        if (node.when) {
            std::function<void(const Expression&)> visit_expression = [&](const Expression& e) {
                if (e.kind == Expression::Kind::call) visit_ref(e.argument);
                for (const Expression& operand : e.operands) visit_expression(operand);
            };
            visit_expression(*node.when);
        }
        expand_node(scope, node);
    };
    for (const GraphNode& node : scope.graph->nodes) visit(node);
}

void Planner::expand_node(Scope& scope, const GraphNode& node)
{
    const NodeInfo* info = node.graph ? nullptr : Registry::instance().find(node.op);
    std::vector<std::string> ports;
    if (node.graph)
        for (const GraphOutput& out : node.graph->outputs) ports.push_back(out.name);
    else if (info)
        for (const PortInfo& out : info->outputs) ports.push_back(out.name);
    scope.port_order[node.id] = ports;
    auto& values = scope.values[node.id];

    if (node.when && !evaluate(*node.when, Facts(*this, scope))) {
        Value absent;
        absent.absent = true;
        if (node.otherwise) absent = lookup(scope, *node.otherwise);
        for (const std::string& port : ports) values[port] = absent;
        m_plan.pruned.push_back({scope.prefix + node.id, "its condition (when:) does not hold"});
        return;
    }
    if (!node.left_out.empty())
        m_plan.notes.push_back("node '" + scope.prefix + node.id + "' (" + node.op +
                               ") does without " + join_names(node.left_out, true));
    if (node.graph) {
        expand_graph_node(scope, node);
        return;
    }
    if (!info) {
        problem(node.op_where, "op '" + node.op + "' is not known");
        return;
    }

    const auto mark_broken = [&] {
        Value broken;
        broken.broken = true;
        for (const std::string& port : ports) values[port] = broken;
    };

    // Connected inputs, and the length of the list the node is mapped over, if any.
    std::map<std::string, Value, std::less<>> arguments;
    std::optional<std::size_t> mapped;
    std::string mapped_by;
    for (const Argument& argument : node.arguments) {
        if (!argument.is_port) continue;
        const PortInfo* port = info->input(argument.key);
        Value value = argument_value(scope, argument);
        if (value.broken || !port) return mark_broken();
        if (value.absent) {
            if (port->required) {
                // What the input should come from is not there: neither is this node.
                Value absent;
                absent.absent = true;
                for (const std::string& p : ports) values[p] = absent;
                m_plan.pruned.push_back(
                    {scope.prefix + node.id, "its input '" + argument.key + "' is not there"});
                return;
            }
            continue;
        }
        const bool wants_table = port->kind == PortKind::table,
                   is_table = value.kind == PortKind::table;
        const bool wants_deep = port->kind == PortKind::deep,
                   is_deep = value.kind == PortKind::deep;
        if (wants_table != is_table || wants_deep != is_deep) {
            const auto name = [](PortKind kind) {
                return kind == PortKind::table  ? "figures"
                       : kind == PortKind::deep ? "a deep image"
                                                : "an image";
            };
            problem(argument.value_where, "node '" + node.id + "' (" + node.op + "): input '" +
                                              argument.key + "' wants " + name(port->kind) +
                                              ", not " + name(value.kind));
            return mark_broken();
        }
        if (value.list && port->kind != PortKind::list) {
            if (mapped && *mapped != value.count()) {
                problem(argument.value_where, "node '" + node.id + "' (" + node.op + "): input '" +
                                                  argument.key + "' is a list of " +
                                                  std::to_string(value.count()) + " where '" +
                                                  mapped_by + "' has " + std::to_string(*mapped));
                return mark_broken();
            }
            mapped = value.count();
            mapped_by = argument.key;
        }
        arguments[argument.key] = std::move(value);
    }

    const std::string id = scope.prefix + node.id;
    const auto make_one = [&](std::optional<std::size_t> index)
        -> std::optional<std::map<std::string, Value, std::less<>>> {
        NewOp request;
        request.id = index ? id + "[" + std::to_string(*index) + "]" : id;
        request.name = node.op;
        request.where = node.where;
        request.info = info;
        const std::size_t before = m_problems.size();
        request.params = node_params(scope, node, info->params, index);
        if (m_problems.size() != before) return std::nullopt;
        request.inputs = info->inputs;
        request.outputs = info->outputs;
        if (info->outputs.empty()) request.crop = m_request.roi; // it writes, as an output does
        for (const auto& [key, value] : arguments) {
            Value v = value;
            if (index && value.list && info->input(key)->kind != PortKind::list) {
                if (value.kind == PortKind::table)
                    v.tables = {value.tables[*index]};
                else
                    v.streams = {value.streams[*index]};
                v.list = false;
            }
            request.arguments[key] = std::move(v);
        }
        return add_op(std::move(request));
    };

    if (!mapped) {
        auto out = make_one(std::nullopt);
        if (!out) return mark_broken();
        values = std::move(*out);
        for (const std::string& port : ports)
            if (!values.contains(port)) values[port].absent = true;
        return;
    }
    for (const std::string& port : ports) values[port].list = true;
    for (std::size_t i = 0; i < *mapped; ++i) {
        const auto out = make_one(i);
        if (!out) return mark_broken();
        for (const auto& [port, value] : *out) {
            if (value.list) {
                problem(
                    node.where,
                    "node '" + node.id + "' (" + node.op +
                        ") makes a list and is mapped over one; lists of lists are not supported");
                return mark_broken();
            }
            Value& whole = values[port];
            whole.kind = value.kind;
            whole.streams.insert(whole.streams.end(), value.streams.begin(), value.streams.end());
            whole.tables.insert(whole.tables.end(), value.tables.begin(), value.tables.end());
        }
    }
    for (const std::string& port : ports)
        if (values[port].count() == 0) values[port].absent = true;
}

void Planner::expand_graph_node(Scope& scope, const GraphNode& node)
{
    const Graph& inner = *node.graph;
    auto& values = scope.values[node.id];

    std::map<std::string, Value, std::less<>> arguments;
    std::optional<std::size_t> mapped;
    for (const Argument& argument : node.arguments) {
        if (!argument.is_port) continue;
        Value value = argument_value(scope, argument);
        const GraphInput* input = inner.input(argument.key);
        if (!input) continue;
        if (value.list && input->kind != PortKind::list && !value.absent && !value.broken) {
            if (mapped && *mapped != value.count()) {
                problem(argument.value_where, "node '" + node.id + "' (" + node.op + "): input '" +
                                                  argument.key + "' is a list of " +
                                                  std::to_string(value.count()) +
                                                  " where another has " + std::to_string(*mapped));
                return;
            }
            mapped = value.count();
        }
        arguments[argument.key] = std::move(value);
    }

    std::vector<ParamInfo> infos;
    for (const GraphParam& p : inner.params) infos.push_back(p.info);
    for (std::size_t i = 0; i < mapped.value_or(1); ++i) {
        Scope sub;
        sub.prefix = scope.prefix + node.id + (mapped ? "[" + std::to_string(i) + "]/" : "/");
        sub.params = node_params(scope, node, infos, mapped ? std::optional(i) : std::nullopt);
        sub.graph = &bind_ops(inner, sub);
        for (const GraphInput& input : inner.inputs) {
            Value value;
            value.absent = true;
            value.list = input.kind == PortKind::list;
            if (const auto it = arguments.find(input.name); it != arguments.end()) {
                value = it->second;
                if (mapped && value.list && input.kind != PortKind::list) {
                    value.streams = {value.streams[i]};
                    value.list = false;
                }
            }
            sub.values[input.name][""] = std::move(value);
            sub.port_order[input.name] = {""};
        }
        expand(sub);
        for (const GraphOutput& output : inner.outputs) {
            Value value = lookup(sub, output.stream);
            if (!mapped) {
                values[output.name] = std::move(value);
                continue;
            }
            Value& whole = values[output.name];
            whole.list = true;
            whole.kind = value.kind;
            whole.absent = value.absent;
            whole.broken |= value.broken || value.list;
            whole.streams.insert(whole.streams.end(), value.streams.begin(), value.streams.end());
            whole.tables.insert(whole.tables.end(), value.tables.begin(), value.tables.end());
        }
    }
}

} // namespace rayloom::planning
