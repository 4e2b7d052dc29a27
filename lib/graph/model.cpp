// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/model.h"

#include <algorithm>

namespace rayloom
{

namespace
{
template <class T, class Name>
const T* find_first(const std::vector<T>& items, Name name_of, std::string_view name)
{
    const auto it =
        std::find_if(items.begin(), items.end(), [&](const T& t) { return name_of(t) == name; });
    return it == items.end() ? nullptr : &*it;
}
} // namespace

const Argument* GraphNode::argument(std::string_view key) const
{
    return find_first(
        arguments, [](const Argument& a) -> const auto& { return a.key; }, key);
}

const GraphNode* Graph::node(std::string_view id) const
{
    return find_first(
        nodes, [](const GraphNode& n) -> const auto& { return n.id; }, id);
}

const GraphInput* Graph::input(std::string_view input_name) const
{
    return find_first(
        inputs, [](const GraphInput& i) -> const auto& { return i.name; }, input_name);
}

const GraphParam* Graph::param(std::string_view param_name) const
{
    return find_first(
        params, [](const GraphParam& p) -> const auto& { return p.info.name; }, param_name);
}

const GraphOutput* Graph::output(std::string_view output_name) const
{
    return find_first(
        outputs, [](const GraphOutput& o) -> const auto& { return o.name; }, output_name);
}

} // namespace rayloom
