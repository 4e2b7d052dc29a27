// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/planner.h"

#include "rayloom/core/text.h"

#include <algorithm>

namespace rayloom::planning
{

Value Planner::lookup(const Scope& scope, const StreamReference& ref)
{
    Value none;
    none.broken = true;
    const auto ports = scope.values.find(ref.node);
    if (ports == scope.values.end()) {
        problem(ref.where, "'" + ref.node + "' is not known here");
        return none;
    }
    std::string port = ref.port;
    if (port.empty()) {
        const auto order = scope.port_order.find(ref.node);
        if (order == scope.port_order.end() || order->second.empty()) return none;
        port = order->second.front();
    }
    const auto found = ports->second.find(port);
    if (found == ports->second.end()) return none;
    Value value = found->second;
    if (!ref.index || value.absent || value.broken) return value;
    const auto index = static_cast<std::size_t>(*ref.index);
    if (!value.list || index >= value.count()) {
        problem(ref.where, "'" + ref.node + "' has " + std::to_string(value.count()) +
                               " elements; number " + std::to_string(*ref.index) +
                               " is not among them (they count from 0)");
        return none;
    }
    if (value.kind == PortKind::table)
        value.tables = {value.tables[index]};
    else
        value.streams = {value.streams[index]};
    value.list = false;
    return value;
}

Value Planner::argument_value(const Scope& scope, const Argument& argument)
{
    if (!argument.streams_are_list) return lookup(scope, argument.streams.front());
    Value list;
    list.list = true;
    bool first = true;
    for (const StreamReference& ref : argument.streams) {
        const Value v = lookup(scope, ref);
        if (v.absent) continue;
        if (v.broken) {
            list.broken = true;
            return list;
        }
        if (!first && v.kind != list.kind)
            problem(ref.where, "a list cannot mix images and figures");
        list.kind = v.kind;
        first = false;
        list.streams.insert(list.streams.end(), v.streams.begin(), v.streams.end());
        list.tables.insert(list.tables.end(), v.tables.begin(), v.tables.end());
    }
    list.absent = first;
    return list;
}

ParamValue Planner::item_value(const Scope& scope,
                               const std::variant<ParamValue, ParamReference>& item) const
{
    if (const auto* literal = std::get_if<ParamValue>(&item)) return *literal;
    const auto it = scope.params.find(std::get<ParamReference>(item).name);
    return it == scope.params.end() ? ParamValue(false) : it->second;
}

namespace
{

/// A sequence of literals and references as one list value.
ParamValue gather(const std::vector<ParamValue>& items)
{
    std::vector<double> numbers;
    std::vector<std::string> texts;
    for (const ParamValue& item : items) {
        if (const auto* i = std::get_if<std::int64_t>(&item))
            numbers.push_back(static_cast<double>(*i));
        else if (const auto* d = std::get_if<double>(&item))
            numbers.push_back(*d);
        else if (const auto* list = std::get_if<std::vector<double>>(&item))
            numbers.insert(numbers.end(), list->begin(), list->end());
        else if (const auto* s = std::get_if<std::string>(&item))
            texts.push_back(*s);
        else if (const auto* names = std::get_if<std::vector<std::string>>(&item))
            texts.insert(texts.end(), names->begin(), names->end());
        else
            texts.push_back(format_param(item));
    }
    if (texts.empty()) return numbers;
    if (numbers.empty()) return texts;
    throw NodeError("a list cannot mix numbers and text");
}

/// One element of a list for element `index` of a mapped node; the last repeats.
std::optional<ParamValue> element_of(const ParamValue& value, std::size_t index)
{
    const auto pick = [&](const auto& list) -> std::optional<ParamValue> {
        if (list.empty()) return std::nullopt;
        return ParamValue(list[std::min(index, list.size() - 1)]);
    };
    if (const auto* numbers = std::get_if<std::vector<double>>(&value)) return pick(*numbers);
    if (const auto* texts = std::get_if<std::vector<std::string>>(&value)) return pick(*texts);
    return std::nullopt;
}

} // namespace

ParamValues Planner::node_params(const Scope& scope, const GraphNode& node,
                                 const std::vector<ParamInfo>& infos,
                                 std::optional<std::size_t> mapped_index)
{
    ParamValues values;
    for (const ParamInfo& info : infos) values[info.name] = info.default_value;
    for (const Argument& argument : node.arguments) {
        if (argument.is_port) continue;
        const auto info =
            std::ranges::find_if(infos, [&](const ParamInfo& p) { return p.name == argument.key; });
        if (info == infos.end()) continue;
        try {
            ParamValue value;
            if (argument.items_are_list) {
                std::vector<ParamValue> items;
                for (const auto& item : argument.items) items.push_back(item_value(scope, item));
                value = gather(items);
            } else {
                value = item_value(scope, argument.items.front());
            }
            if (!is_list(info->type)) {
                const std::optional<ParamValue> element =
                    element_of(value, mapped_index.value_or(0));
                if (element && !mapped_index && argument.items.size() > 1)
                    throw NodeError(
                        "parameter '" + info->name +
                        "' takes one value here: a list goes element by element over a node "
                        "that is mapped over a list, and this one is not");
                if (element) value = *element;
                // A whole number that came through a list of numbers is an integer again.
                if (const auto* d = std::get_if<double>(&value);
                    d && info->type == ParamType::integer &&
                    *d == static_cast<double>(static_cast<std::int64_t>(*d)))
                    value = static_cast<std::int64_t>(*d);
            }
            values[info->name] = check_param(*info, value);
        } catch (const NodeError& e) {
            problem(argument.value_where, "node '" + node.id + "' (" + node.op + "): " + e.what());
        }
    }
    return values;
}

} // namespace rayloom::planning
