// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/diagram.h"
#include "rayloom/graph/picture.h"

namespace rayloom
{

using namespace diagram;

namespace
{

std::string dot_quoted(const std::string& text)
{
    std::string out = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\') out += '\\';
        out += c == '\n' ? ' ' : c;
    }
    return out + "\"";
}

} // namespace

std::string graph_dot(const Graph& graph)
{
    const Diagram diagram = make_diagram(graph);
    std::string out = "digraph " + dot_quoted(graph.name.empty() ? "graph" : graph.name) +
                      " {\n  rankdir=TB;\n"
                      "  node [shape=box, style=\"rounded,filled\", fontname=\"sans-serif\", "
                      "fontsize=11];\n"
                      "  edge [fontname=\"sans-serif\", fontsize=9, color=\"#555555\"];\n";
    for (std::size_t i = 0; i < diagram.boxes.size(); ++i) {
        const Box& box = diagram.boxes[i];
        const Paint paint = paint_of(box);
        std::string label = "<<b>" + escaped(box.id) + "</b>";
        if (!box.op.empty()) label += "<br/>" + escaped(box.op);
        for (const std::string& detail : box.details)
            label += "<br/><font point-size=\"9\">" + escaped(detail) + "</font>";
        out += "  n" + std::to_string(i) + " [label=" + label + ">, fillcolor=\"" + paint.fill +
               "\", color=\"" + paint.line + "\"" +
               (box.doc.empty() ? "" : ", tooltip=" + dot_quoted(box.doc)) + "];\n";
    }
    for (const Edge& edge : diagram.edges) {
        std::string style;
        if (!edge.label.empty()) style += ", label=" + dot_quoted(edge.label);
        if (edge.kind == PortKind::list) style += ", color=\"#555555:invis:#555555\"";
        if (edge.kind == PortKind::deep) style += ", penwidth=2.5";
        if (edge.otherwise)
            style += ", style=dotted";
        else if (edge.kind == PortKind::table)
            style += ", style=dashed";
        out += "  n" + std::to_string(edge.from) + " -> n" + std::to_string(edge.to) +
               (style.empty() ? "" : " [" + style.substr(2) + "]") + ";\n";
    }
    return out + "}\n";
}

} // namespace rayloom
