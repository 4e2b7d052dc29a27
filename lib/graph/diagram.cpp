// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/diagram.h"

#include "rayloom/graph/expression.h"

#include <algorithm>
#include <array>
#include <map>

namespace rayloom::diagram
{

namespace
{

std::string shortened(const std::string& text, std::size_t length = 46)
{
    if (text.size() <= length) return text;
    // Not in the middle of a character.
    while (length > 0 && (static_cast<unsigned char>(text[length]) & 0xc0) == 0x80) --length;
    return text.substr(0, length) + "…";
}

std::string value_text(const Argument& argument)
{
    std::string out;
    for (const auto& item : argument.items) {
        if (!out.empty()) out += ", ";
        if (const auto* reference = std::get_if<ParamReference>(&item))
            out += "$" + reference->name;
        else
            out += format_param(std::get<ParamValue>(item));
    }
    return argument.items_are_list ? "[" + out + "]" : out;
}

} // namespace

Diagram make_diagram(const Graph& graph)
{
    Diagram out;
    std::map<std::string, std::size_t> index;
    for (const GraphInput& input : graph.inputs) {
        Box box{Role::input, input.name, "", {}, input.doc};
        std::string detail = input.kind == PortKind::list   ? "list"
                             : input.kind == PortKind::deep ? "deep"
                                                            : "";
        if (!input.required) detail += detail.empty() ? "optional" : ", optional";
        if (!detail.empty()) box.details.push_back(detail);
        index[input.name] = out.boxes.size();
        out.boxes.push_back(std::move(box));
    }
    for (const GraphNode& node : graph.nodes) {
        Box box{Role::node, node.id, node.op, {}, ""};
        for (const Argument& argument : node.arguments)
            if (!argument.is_port)
                box.details.push_back(shortened(argument.key + ": " + value_text(argument)));
        if (node.when) box.details.push_back(shortened("when " + expression_text(*node.when)));
        index[node.id] = out.boxes.size();
        out.boxes.push_back(std::move(box));
    }
    const auto connect = [&](const StreamReference& stream, std::size_t to, std::string label,
                             bool otherwise) {
        const auto from = index.find(stream.node);
        if (from == index.end()) return;
        Edge edge{from->second, to, std::move(label), std::nullopt, otherwise};
        if (const GraphInput* input = graph.input(stream.node)) {
            edge.kind = input->kind;
        } else if (const GraphNode* node = graph.node(stream.node)) {
            const auto kind = node->carries.find(stream.port);
            if (kind != node->carries.end()) edge.kind = kind->second;
        }
        std::string tail = stream.port;
        if (stream.index) {
            tail += "[" + std::to_string(*stream.index) + "]";
            edge.kind = PortKind::image;
        }
        if (!tail.empty()) edge.label = tail + (edge.label.empty() ? "" : " → " + edge.label);
        out.edges.push_back(std::move(edge));
    };
    for (const GraphNode& node : graph.nodes) {
        const std::size_t to = index.at(node.id);
        const auto ports = std::count_if(node.arguments.begin(), node.arguments.end(),
                                         [](const Argument& a) { return a.is_port; });
        for (const Argument& argument : node.arguments)
            for (std::size_t i = 0; i < argument.streams.size(); ++i) {
                std::string label = ports > 1 ? argument.key : "";
                if (argument.streams_are_list && argument.streams.size() > 1)
                    label += "[" + std::to_string(i) + "]";
                connect(argument.streams[i], to, std::move(label), false);
            }
        if (node.otherwise) connect(*node.otherwise, to, "otherwise", true);
    }
    for (const GraphOutput& output : graph.outputs) {
        out.boxes.push_back({Role::output, output.name, "", {}, output.doc});
        connect(output.stream, out.boxes.size() - 1, "", false);
    }
    return out;
}

Paint paint_of(const Box& box)
{
    if (box.role == Role::input) return {"#e8f1fb", "#4a7fb5"};
    if (box.role == Role::output) return {"#e6f4ea", "#3f8f5b"};
    const std::string stage = box.op.substr(0, box.op.find_first_of(".:"));
    static constexpr std::array<std::pair<const char*, Paint>, 9> stages{{
        {"io", {"#eef2f5", "#6b7c8c"}},
        {"transform", {"#fdf3e1", "#c08a2e"}},
        {"threshold", {"#fbe9e7", "#c0604d"}},
        {"fit", {"#f3eafa", "#8a5fb0"}},
        {"fuse", {"#fde8ef", "#b9507a"}},
        {"multiscale", {"#e5f4f5", "#3a8f98"}},
        {"measure", {"#f4f4e0", "#8c8a35"}},
        {"oiio", {"#f2f2f2", "#808080"}},
        {"graph", {"#ececfa", "#6468b8"}},
    }};
    for (const auto& [name, paint] : stages)
        if (stage == name) return paint;
    return {"#f7f5f2", "#8a8076"};
}

std::string escaped(const std::string& text)
{
    std::string out;
    for (const char c : text) switch (c) {
        case '&': out += "&amp;"; break;
        case '<': out += "&lt;"; break;
        case '>': out += "&gt;"; break;
        case '"': out += "&quot;"; break;
        default: out += c;
        }
    return out;
}

} // namespace rayloom::diagram
