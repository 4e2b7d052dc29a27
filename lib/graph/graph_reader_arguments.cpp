// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/graph_reader.h"

#include "rayloom/core/text.h"
#include "rayloom/graph/reader.h"

#include <algorithm>

namespace rayloom::reading
{

namespace
{

/// The input, parameter or word of the format a key is a slip of; empty when there is none.
std::string closest_argument(const NodeInfo& info, const std::string& key)
{
    std::vector<std::string> all{"op", "when", "otherwise"};
    for (const PortInfo& port : info.inputs) all.push_back(port.name);
    for (const ParamInfo& param : info.params) all.push_back(param.name);
    return closest_name(key, all);
}

std::string unknown_argument(const NodeInfo& info, const std::string& key)
{
    if (const std::string near = closest_argument(info, key); !near.empty()) {
        const char* what = info.input(near) ? "input" : info.param(near) ? "parameter" : "key";
        return std::string(what) + " '" + key + "' is not known; did you mean '" + near + "'?";
    }
    const auto name = [](const auto& item) { return item.name; };
    const std::vector<std::string> ports = names_of(info.inputs, name);
    const std::vector<std::string> params = names_of(info.params, name);
    const auto list = [](const std::vector<std::string>& names) {
        return names.empty() ? std::string("none") : join_names(names);
    };
    return "'" + key + "' is neither an input (" + list(ports) + ") nor a parameter (" +
           list(params) + ")";
}

bool fits(const ParamInfo& from, const ParamInfo& to)
{
    using enum ParamType;
    switch (to.type) {
    case boolean: return from.type == boolean;
    case integer: return from.type == integer;
    case real:
    case reals: return from.type == integer || from.type == real || from.type == reals;
    case text:
    case choice:
    case texts: return is_textual(from.type);
    case path:
    case paths: return is_path(from.type);
    }
    return false;
}

/// A list for a parameter of one value is one value per element of the list it is mapped over.
void check_list_or_value(const ParamInfo& info, const ParamValue& value)
{
    const bool list = is_list(info.type);
    if (const auto* numbers = std::get_if<std::vector<double>>(&value); numbers && !list)
        for (const double number : *numbers) check_param(info, number);
    else if (const auto* texts = std::get_if<std::vector<std::string>>(&value); texts && !list)
        for (const std::string& text : *texts) check_param(info, text);
    else
        check_param(info, value);
}

/// "(its description)" for messages.
std::string in_brackets(std::string doc)
{
    if (doc.ends_with('.')) doc.pop_back();
    return doc.empty() ? "" : " (" + doc + ")";
}

} // namespace

void GraphReader::read_argument(GraphNode& node, const NodeInfo& info, const Entry& entry)
{
    Argument argument;
    argument.key = entry.key;
    argument.where = entry.where;
    argument.value_where = entry.value->where;
    if (const PortInfo* port = info.input(entry.key)) {
        argument.is_port = true;
        read_streams(node, *port, argument, *entry.value);
    } else if (const ParamInfo* param = info.param(entry.key)) {
        read_items(node, *param, argument, *entry.value);
        pass_op(node, argument);
    } else {
        problem(entry.where, label(node) + unknown_argument(info, entry.key));
        return;
    }
    node.arguments.push_back(std::move(argument));
}

void GraphReader::pass_op(const GraphNode& node, Argument& argument)
{
    const GraphParam* param = node.graph ? node.graph->param(argument.key) : nullptr;
    if (!param || !param->names_op) return;
    for (auto& item : argument.items) {
        if (auto* value = std::get_if<ParamValue>(&item)) {
            if (auto* op = std::get_if<std::string>(value)) *op = op_from(m_graph.folder, *op);
            continue;
        }
        for (GraphParam& outer : m_graph.params)
            if (outer.info.name == std::get<ParamReference>(item).name) outer.names_op = true;
    }
}

void GraphReader::read_streams(const GraphNode& node, const PortInfo& port, Argument& argument,
                               const Value& value)
{
    const std::string what = label(node) + "input '" + port.name + "': ";
    if (value.is_null()) {
        problem(argument.where, what + "no value is given");
    } else if (value.is_sequence()) {
        argument.streams_are_list = true;
        if (value.items.empty()) problem(value.where, what + "the list is empty");
        for (const auto& item : value.items)
            if (const auto stream = checked_reference(*item, what))
                argument.streams.push_back(*stream);
    } else if (const auto stream = checked_reference(value, what)) {
        argument.streams.push_back(*stream);
    }
}

void GraphReader::read_items(const GraphNode& node, const ParamInfo& info, Argument& argument,
                             const Value& value)
{
    const std::string what = label(node);
    if (value.is_null()) {
        problem(argument.where, what + "parameter '" + info.name + "' is given no value");
    } else if (value.is_sequence()) {
        argument.items_are_list = true;
        if (value.items.empty() && !is_list(info.type))
            problem(value.where, what + "parameter '" + info.name + "' is given an empty list");
        for (const auto& item : value.items) read_item(info, argument, *item, what);
    } else {
        read_item(info, argument, value, what);
    }
}

void GraphReader::read_item(const ParamInfo& info, Argument& argument, const Value& value,
                            const std::string& what)
{
    if (value.is_scalar() && value.text.starts_with('$') && !value.text.starts_with("$$")) {
        const std::string name = value.text.substr(1);
        argument.items.emplace_back(ParamReference{name});
        check_param_reference(info, name, argument.items_are_list, value, what);
        return;
    }
    std::string reason;
    std::optional<ParamValue> item;
    if (value.is_scalar() && value.text.starts_with("$$")) {
        Value escaped = value;
        escaped.text.erase(0, 1);
        item = literal(info, escaped, reason);
    } else if (value.is_sequence()) {
        reason = "parameter '" + info.name + "' holds a list within a list";
    } else {
        item = literal(info, value, reason);
    }
    if (!item) {
        problem(value.where, what + reason);
        return;
    }
    // An element of a list parameter is one value; check_param() made a list of one of it.
    if (argument.items_are_list) {
        if (const auto* numbers = std::get_if<std::vector<double>>(&*item))
            item = ParamValue((*numbers)[0]);
        else if (const auto* texts = std::get_if<std::vector<std::string>>(&*item))
            item = ParamValue(std::string((*texts)[0]));
    }
    argument.items.emplace_back(std::move(*item));
}

void GraphReader::check_param_reference(const ParamInfo& info, const std::string& name,
                                        bool in_list, const Value& value, const std::string& what)
{
    const GraphParam* param = m_graph.param(name);
    if (!param) {
        const auto names =
            names_of(m_graph.params, [](const GraphParam& p) { return p.info.name; });
        problem(value.where, what + "parameter '$" + name + "' is not declared under params" +
                                 suggestion(name, names));
        return;
    }
    m_used_params.insert(name);
    if (m_broken_params.contains(name)) return;
    const ParamInfo& from = param->info;
    if (in_list && is_list(from.type)) {
        problem(value.where, what + "parameter '" + info.name + "' holds '$" + name +
                                 "', a list, within a list");
        return;
    }
    if (!fits(from, info)) {
        problem(value.where, what + "parameter '" + info.name + "' is of type " +
                                 param_type_name(info.type) + ", '$" + name + "' of type " +
                                 param_type_name(from.type) +
                                 (is_path(info.type) && is_textual(from.type)
                                      ? std::string("; declare '") + name +
                                            "' with 'type: " + param_type_name(info.type) + "'"
                                      : ""));
        return;
    }
    for (const std::string& choice : from.choices)
        if (info.type == ParamType::choice &&
            std::find(info.choices.begin(), info.choices.end(), choice) == info.choices.end())
            problem(value.where, what + "'$" + name + "' may be '" + choice +
                                     "', which parameter '" + info.name + "' cannot" +
                                     suggestion(choice, info.choices));
    if (from.required || from.type == ParamType::choice) return;
    try {
        check_list_or_value(info, from.default_value);
    } catch (const NodeError& error) {
        problem(value.where, what + std::string(error.what()) + ", the default of '$" + name + "'");
    }
}

void GraphReader::check_missing(const GraphNode& node, const NodeInfo& info, const Value& value)
{
    // A misspelt key is reported as such, not as a missing one too.
    std::set<std::string> meant;
    for (const Entry& entry : value.entries)
        if (!info.input(entry.key) && !info.param(entry.key))
            meant.insert(closest_argument(info, entry.key));
    const auto missing = [&](const std::string& name) {
        return !value.find(name) && !meant.contains(name);
    };
    for (const PortInfo& port : info.inputs)
        if (port.required && missing(port.name))
            problem(node.where,
                    label(node) + "input '" + port.name + "' is missing" + in_brackets(port.doc));
    for (const ParamInfo& param : info.params)
        if (param.required && missing(param.name))
            problem(node.where, label(node) + "parameter '" + param.name + "' is missing" +
                                    in_brackets(param.doc));
}

} // namespace rayloom::reading
