// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/graph_reader.h"

#include "rayloom/graph/expression.h"
#include "rayloom/graph/names.h"

namespace rayloom::reading
{

Shape shape_of(PortKind kind)
{
    switch (kind) {
    case PortKind::image: return Shape::image;
    case PortKind::list: return Shape::list;
    case PortKind::deep: return Shape::deep;
    case PortKind::table: return Shape::table;
    }
    return Shape::unknown;
}

std::optional<PortKind> kind_of(Shape shape)
{
    switch (shape) {
    case Shape::image: return PortKind::image;
    case Shape::list: return PortKind::list;
    case Shape::deep: return PortKind::deep;
    case Shape::table: return PortKind::table;
    case Shape::unknown: break;
    }
    return std::nullopt;
}

namespace
{

const char* shape_text(Shape shape)
{
    switch (shape) {
    case Shape::image: return "an image";
    case Shape::list: return "a list of images";
    case Shape::deep: return "a deep image";
    case Shape::table: return "a table";
    case Shape::unknown: break;
    }
    return "unknown";
}

} // namespace

void GraphReader::infer_shapes()
{
    for (const GraphInput& input : m_graph.inputs)
        m_shapes[{input.name, ""}] = shape_of(input.kind);
    for (const std::size_t i : m_order) {
        GraphNode& node = m_graph.nodes[i];
        if (node.when)
            for (const StreamReference& stream : references(*node.when))
                stream_shape(stream, label(node) + "'when': ");
        if (!m_trees[i].info) continue;
        infer_node(node, *m_trees[i].info);
    }
}

void GraphReader::infer_node(GraphNode& node, const NodeInfo& info)
{
    bool mapped = false;
    bool sure = true;
    for (const Argument& argument : node.arguments) {
        if (!argument.is_port) continue;
        const PortInfo& port = *info.input(argument.key);
        for (const StreamReference& stream : argument.streams) {
            const Shape shape = stream_shape(stream, label(node) + "input '" + port.name + "': ");
            check_shape(node, port, stream, shape, argument.streams_are_list);
            if (port.kind == PortKind::list) continue;
            mapped = mapped || shape == Shape::list;
            sure = sure && shape != Shape::unknown;
        }
        if (port.kind != PortKind::list && argument.streams_are_list) mapped = true;
    }
    if (sure && !mapped) check_lone_items(node, info);
    std::optional<Shape> otherwise;
    if (node.otherwise) otherwise = stream_shape(*node.otherwise, label(node) + "'otherwise': ");
    for (std::size_t k = 0; k < info.outputs.size(); ++k) {
        const PortInfo& output = info.outputs[k];
        Shape shape = shape_of(output.kind);
        if (node.graph) {
            const auto kind = node.graph->outputs[k].kind;
            // A graph mapped over a list gives lists only where the list is followed.
            shape = kind && !mapped && sure ? shape_of(*kind) : Shape::unknown;
        } else if (mapped) {
            shape = shape == Shape::image ? Shape::list : Shape::unknown;
        } else if (!sure) {
            shape = shape == Shape::list ? Shape::list : Shape::unknown;
        }
        if (otherwise && *otherwise != shape) shape = Shape::unknown;
        if (k == 0) m_shapes[{node.id, ""}] = shape;
        m_shapes[{node.id, output.name}] = shape;
        if (const auto kind = kind_of(shape)) {
            if (k == 0) node.carries.emplace("", *kind);
            node.carries.emplace(output.name, *kind);
        }
    }
}

void GraphReader::check_lone_items(const GraphNode& node, const NodeInfo& info)
{
    for (const Argument& argument : node.arguments) {
        if (argument.is_port) continue;
        const ParamInfo& param = *info.param(argument.key);
        if (is_list(param.type)) continue;
        bool list = argument.items_are_list;
        for (const auto& item : argument.items)
            if (const auto* reference = std::get_if<ParamReference>(&item))
                if (const GraphParam* from = m_graph.param(reference->name))
                    list = list || is_list(from->info.type);
        if (list && !argument.items.empty())
            problem(argument.value_where,
                    label(node) + "parameter '" + param.name +
                        "' takes one value; a list of values goes along a list of images, "
                        "and no input here is one");
    }
}

Shape GraphReader::stream_shape(const StreamReference& stream, const std::string& what)
{
    const auto it = m_shapes.find({stream.node, stream.port});
    const Shape shape = it == m_shapes.end() ? Shape::unknown : it->second;
    if (!stream.index) return shape;
    if (shape == Shape::list) return Shape::image;
    if (shape != Shape::unknown)
        problem(stream.where, what + "'" + stream_text(stream) + "': an index is for lists, '" +
                                  stream.node + (stream.port.empty() ? "" : "." + stream.port) +
                                  "' is " + shape_text(shape));
    return Shape::unknown;
}

void GraphReader::check_shape(const GraphNode& node, const PortInfo& port,
                              const StreamReference& stream, Shape shape, bool in_list)
{
    const Shape wanted = shape_of(port.kind);
    // One image is a list of one, a list maps the node; list elements are images.
    const bool pixels = shape == Shape::image || shape == Shape::list;
    const bool wants_pixels = wanted == Shape::image || wanted == Shape::list;
    if (shape == Shape::unknown || shape == wanted) {
        if (!(in_list && shape == Shape::list)) return;
        problem(stream.where, label(node) + "input '" + port.name + "' is a list, and '" +
                                  stream_text(stream) +
                                  "' in it is a list itself; lists hold images");
        return;
    }
    if (pixels && wants_pixels) {
        if (!(in_list && shape == Shape::list)) return;
        problem(stream.where, label(node) + "input '" + port.name + "' is given a list, and '" +
                                  stream_text(stream) +
                                  "' in it is a list itself; lists hold images");
        return;
    }
    // A list may hold deep images or tables when what made it was mapped.
    if (shape == Shape::list) return;
    problem(stream.where, label(node) + "input '" + port.name + "' wants " + shape_text(wanted) +
                              "; '" + stream_text(stream) + "' is " + shape_text(shape));
}

} // namespace rayloom::reading
