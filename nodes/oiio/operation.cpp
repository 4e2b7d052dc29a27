// SPDX-License-Identifier: Apache-2.0
#include "nodes/oiio/operation.h"

#include <algorithm>
#include <utility>

namespace rayloom::oiio
{
namespace
{

/// The node of every entry.
class OperationNode final : public Node
{
public:
    OperationNode(std::shared_ptr<const Operation> operation, const ParamValues& given)
        : m_operation(std::move(operation)), m_arguments(m_operation->params, given)
    {
    }
    void plan(PlanContext& context) override
    {
        m_compute = m_operation->plan(context, m_arguments);
    }
    void compute(const TileContext& context) const override { m_compute(context); }

private:
    std::shared_ptr<const Operation> m_operation;
    Arguments m_arguments;
    Compute m_compute;
};

std::string example_graph(const Operation& op)
{
    if (op.example.starts_with("rayloom:")) return op.example;
    std::string text = "rayloom: 1\nname: " + op.name + "\ninputs:\n";
    for (const PortInfo& port : op.inputs)
        if (port.required || op.example.find(port.name + ": " + port.name) != std::string::npos)
            text += "  " + port.name + ": {doc: \"" + port.doc + "\", channels: \"R,G,B,A\"}\n";
    text += "nodes:\n  result: {op: oiio." + op.name + ", " + op.example + "}\n";
    text += "outputs:\n  out: result\n";
    return text;
}

NodeInfo node_info_of(Operation op)
{
    NodeInfo info;
    info.name = "oiio." + op.name;
    info.summary = op.summary;
    info.doc = op.doc.empty() ? "" : op.doc + "\n\n";
    info.doc += "The same as `oiiotool " + op.command + "`.";
    info.accuracy = op.accuracy;
    info.inputs = op.inputs;
    info.outputs = {{"image", PortKind::image, true, "the result"}};
    info.params = op.params;
    info.example = example_graph(op);
    auto shared = std::make_shared<const Operation>(std::move(op));
    info.create = [shared](const ParamValues& values) -> std::unique_ptr<Node> {
        return std::make_unique<OperationNode>(shared, values);
    };
    return info;
}

ParamInfo param_of(std::string name, ParamType type, ParamValue value, std::string doc)
{
    ParamInfo info;
    info.name = std::move(name);
    info.type = type;
    info.default_value = std::move(value);
    info.doc = std::move(doc);
    return info;
}

[[maybe_unused]] const bool registered = [] {
    for (NodeInfo& info : operation_nodes()) Registry::instance().add(std::move(info));
    return true;
}();

} // namespace

Arguments::Arguments(const std::vector<ParamInfo>& declared, const ParamValues& given)
{
    for (const ParamInfo& info : declared) {
        const auto it = given.find(info.name);
        m_values[info.name] = it != given.end() ? it->second : info.default_value;
    }
}

std::vector<float> Arguments::reals(std::string_view name) const
{
    std::vector<float> out;
    for (const double v : get<std::vector<double>>(name)) out.push_back(static_cast<float>(v));
    return out;
}

std::vector<NodeInfo> operation_nodes()
{
    std::vector<NodeInfo> nodes;
    for (auto& group : {arithmetic_operations(), channel_operations(), placement_operations(),
                        filter_operations(), colour_operations()})
        for (const Operation& op : group) nodes.push_back(node_info_of(op));
    return nodes;
}

PortInfo image_port(std::string name, std::string doc)
{
    return {std::move(name), PortKind::image, true, std::move(doc)};
}
PortInfo optional_port(std::string name, std::string doc)
{
    return {std::move(name), PortKind::image, false, std::move(doc)};
}
ParamInfo flag_param(std::string name, bool value, std::string doc)
{
    return param_of(std::move(name), ParamType::boolean, value, std::move(doc));
}
ParamInfo integer_param(std::string name, int value, int lo, int hi, std::string unit,
                        std::string doc)
{
    ParamInfo info =
        param_of(std::move(name), ParamType::integer, std::int64_t{value}, std::move(doc));
    info.min = lo;
    info.max = hi;
    info.unit = std::move(unit);
    return info;
}
ParamInfo real_param(std::string name, double value, std::string unit, std::string doc)
{
    ParamInfo info = param_of(std::move(name), ParamType::real, value, std::move(doc));
    info.unit = std::move(unit);
    return info;
}
ParamInfo reals_param(std::string name, std::vector<double> value, std::string doc)
{
    return param_of(std::move(name), ParamType::reals, std::move(value), std::move(doc));
}
ParamInfo text_param(std::string name, std::string value, std::string doc)
{
    return param_of(std::move(name), ParamType::text, std::move(value), std::move(doc));
}
ParamInfo path_param(std::string name, std::string doc)
{
    return param_of(std::move(name), ParamType::path, std::string(), std::move(doc));
}
ParamInfo texts_param(std::string name, std::vector<std::string> value, std::string doc)
{
    return param_of(std::move(name), ParamType::texts, std::move(value), std::move(doc));
}
ParamInfo choice_param(std::string name, std::string value, std::vector<std::string> choices,
                       std::string doc)
{
    ParamInfo info = param_of(std::move(name), ParamType::choice, std::move(value), std::move(doc));
    info.choices = std::move(choices);
    return info;
}
ParamInfo required(ParamInfo param)
{
    param.required = true;
    return param;
}

std::vector<float> per_channel(const std::vector<float>& values, int channels,
                               std::string_view param)
{
    const auto n = static_cast<std::size_t>(channels);
    if (values.size() == n) return values;
    if (values.size() == 1) return std::vector<float>(n, values[0]);
    throw NodeError("'" + std::string(param) + "' has " + std::to_string(values.size()) +
                    " numbers and the image " + std::to_string(channels) +
                    " channels; give one number for all or one for each");
}

} // namespace rayloom::oiio
