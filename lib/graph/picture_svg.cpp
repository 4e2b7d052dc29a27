// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/diagram_layout.h"
#include "rayloom/graph/picture.h"

#include <algorithm>
#include <cstdio>

namespace rayloom
{

using namespace diagram;

namespace
{

std::string number(double value)
{
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.1f", value);
    return buffer;
}

struct Point {
    double x, y;
};

/// Where edge `e` touches a box: the edges on that side are spread over it, ordered by where they
/// go, so that they do not meet in one point.
double attachment(const Diagram& diagram, const Layout& layout, std::size_t e, bool bottom)
{
    const Edge& edge = diagram.edges[e];
    const std::size_t box = bottom ? edge.from : edge.to;
    const auto beyond = [&](std::size_t k) {
        const auto& course = layout.courses[k];
        return layout.places[bottom ? course[1] : course[course.size() - 2]].x;
    };
    std::size_t before = 0;
    std::size_t all = 0;
    double widest = 44.0;
    for (std::size_t k = 0; k < diagram.edges.size(); ++k) {
        if ((bottom ? diagram.edges[k].from : diagram.edges[k].to) != box) continue;
        ++all;
        if (!bottom) widest = std::max(widest, label_width(diagram.edges[k]));
        if (beyond(k) < beyond(e) || (beyond(k) == beyond(e) && k < e)) ++before;
    }
    const Place& place = layout.places[box];
    const double spread = std::min(place.width - 24.0, widest * static_cast<double>(all - 1));
    if (all == 1) return place.x;
    return place.x - 0.5 * spread +
           spread * static_cast<double>(before) / static_cast<double>(all - 1);
}

std::string curve(const std::vector<Point>& points)
{
    std::string out = "M" + number(points[0].x) + "," + number(points[0].y);
    for (std::size_t k = 1; k < points.size(); ++k) {
        const double half = 0.5 * (points[k].y - points[k - 1].y);
        out += " C" + number(points[k - 1].x) + "," + number(points[k - 1].y + half) + " " +
               number(points[k].x) + "," + number(points[k].y - half) + " " + number(points[k].x) +
               "," + number(points[k].y);
    }
    return out;
}

std::string draw_edge(const Diagram& diagram, const Layout& layout, std::size_t e)
{
    const Edge& edge = diagram.edges[e];
    const auto& course = layout.courses[e];
    const Place& from = layout.places[edge.from];
    const Place& to = layout.places[edge.to];
    std::vector<Point> points{{attachment(diagram, layout, e, true), from.y + from.height}};
    for (std::size_t k = 1; k + 1 < course.size(); ++k) {
        const Place& bend = layout.places[course[k]];
        points.push_back({bend.x, bend.y});
        points.push_back({bend.x, bend.y + bend.height});
    }
    points.push_back({attachment(diagram, layout, e, false), to.y - 7.0});
    const std::string path = curve(points);
    const bool list = edge.kind == PortKind::list;
    const bool deep = edge.kind == PortKind::deep;
    std::string style = edge.otherwise                 ? " stroke-dasharray=\"2 4\""
                        : edge.kind == PortKind::table ? " stroke-dasharray=\"7 4\""
                                                       : "";
    std::string out = "<path class=\"edge\" d=\"" + path + "\" stroke-width=\"" +
                      (list   ? "4.5"
                       : deep ? "3"
                              : "1.6") +
                      "\"" + style + "/>\n";
    // A pale line inside a wide one makes two.
    if (list) out += "<path class=\"inside\" d=\"" + path + "\"/>\n";
    const Point tip{points.back().x, to.y};
    out +=
        "<path class=\"tip\" d=\"M" + number(tip.x) + "," + number(tip.y) + " l-4.5,-9 h9 z\"/>\n";
    return out;
}

std::string draw_label(const Diagram& diagram, const Layout& layout, std::size_t e)
{
    const Edge& edge = diagram.edges[e];
    if (edge.label.empty()) return "";
    const double x = attachment(diagram, layout, e, false);
    const auto& course = layout.courses[e];
    const bool from_left = layout.places[course[course.size() - 2]].x <= layout.places[edge.to].x;
    // On the outer side of the arrow, where the curve is not.
    return "<text class=\"port\" x=\"" + number(x + (from_left ? -7.0 : 7.0)) + "\" y=\"" +
           number(layout.places[edge.to].y - 6.0) + "\" text-anchor=\"" +
           (from_left ? "end" : "start") + "\">" + escaped(edge.label) + "</text>\n";
}

std::string draw_box(const Box& box, const Place& place)
{
    const Paint paint = paint_of(box);
    const double radius = box.role == Role::node ? 6.0 : std::min(16.0, 0.5 * place.height);
    std::string out = "<g>";
    if (!box.doc.empty()) out += "<title>" + escaped(box.doc) + "</title>";
    out += "<rect x=\"" + number(place.x - 0.5 * place.width) + "\" y=\"" + number(place.y) +
           "\" width=\"" + number(place.width) + "\" height=\"" + number(place.height) +
           "\" rx=\"" + number(radius) + "\" fill=\"" + paint.fill + "\" stroke=\"" + paint.line +
           "\" stroke-width=\"1.3\"/>";
    double y = place.y + 8.0 + 0.75 * line_height;
    const auto text = [&](const std::string& line, const char* style) {
        out += "<text class=\"" + std::string(style) + "\" x=\"" + number(place.x) + "\" y=\"" +
               number(y) + "\">" + escaped(line) + "</text>";
        y += line_height;
    };
    text(box.id, "name");
    if (!box.op.empty()) text(box.op, "op");
    for (const std::string& detail : box.details) text(detail, "detail");
    return out + "</g>\n";
}

} // namespace

std::string graph_svg(const Graph& graph)
{
    const Diagram diagram = make_diagram(graph);
    Layout layout = make_layout(diagram, graph.name.empty() ? margin : margin + 32.0);
    layout.width =
        std::max(layout.width, 2.0 * margin + 10.0 * static_cast<double>(letters(graph.name)));
    const std::string size = number(layout.width) + "\" height=\"" + number(layout.height);
    std::string out =
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" + size + "\" viewBox=\"0 0 " +
        number(layout.width) + " " + number(layout.height) +
        "\" font-family=\"Helvetica, Arial, 'DejaVu Sans', sans-serif\">\n<style>\n"
        ".edge{fill:none;stroke:#6d7278;stroke-linecap:butt}\n"
        ".inside{fill:none;stroke:#ffffff;stroke-width:1.6}\n"
        ".tip{fill:#6d7278}\n"
        ".name{font-size:13px;font-weight:bold;fill:#1d2126;text-anchor:middle}\n"
        ".op{font-size:12px;fill:#3d434a;text-anchor:middle}\n"
        ".detail{font-size:11px;fill:#5d646c;text-anchor:middle}\n"
        ".port{font-size:10px;fill:#5d646c;paint-order:stroke;stroke:#ffffff;stroke-width:3px}\n"
        ".title{font-size:17px;font-weight:bold;fill:#1d2126}\n"
        "</style>\n<rect width=\"" +
        size + "\" fill=\"#ffffff\"/>\n";
    if (!graph.name.empty())
        out += "<text class=\"title\" x=\"" + number(margin) + "\" y=\"" + number(margin + 12.0) +
               "\">" + escaped(graph.name) + "</text>\n";
    for (std::size_t e = 0; e < diagram.edges.size(); ++e) out += draw_edge(diagram, layout, e);
    for (std::size_t i = 0; i < diagram.boxes.size(); ++i)
        out += draw_box(diagram.boxes[i], layout.places[i]);
    for (std::size_t e = 0; e < diagram.edges.size(); ++e) out += draw_label(diagram, layout, e);
    return out + "</svg>\n";
}

} // namespace rayloom
