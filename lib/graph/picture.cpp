// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/picture.h"

#include "rayloom/graph/expression.h"
#include "rayloom/graph/names.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numeric>

namespace rayloom
{

namespace
{

enum class Role { input, node, output };

struct Box {
    Role role = Role::node;
    std::string id;                   ///< name in the graph
    std::string op;                   ///< of a node
    std::vector<std::string> details; ///< parameters and condition, or the kind of an input
    std::string doc;
};

struct Edge {
    std::size_t from = 0, to = 0;
    std::string label; ///< the output it leaves by and the input it enters by, where not plain
    std::optional<PortKind> kind;
    bool otherwise = false;
};

/// A graph as boxes and edges, shared by both kinds of picture.
struct Diagram {
    std::vector<Box> boxes;
    std::vector<Edge> edges;
};

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

/// Fill and outline of a box: quiet colours, one a stage, so that a glance tells reading from
/// fusing from measuring.
struct Paint {
    const char* fill;
    const char* line;
};

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

std::string dot_quoted(const std::string& text)
{
    std::string out = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\') out += '\\';
        out += c == '\n' ? ' ' : c;
    }
    return out + "\"";
}

// --- layout ----------------------------------------------------------------------------------

constexpr double line_height = 16.0;
constexpr double box_gap = 28.0;
constexpr double rank_gap = 58.0;
constexpr double margin = 24.0;

std::size_t letters(const std::string& text)
{
    return static_cast<std::size_t>(std::count_if(text.begin(), text.end(), [](char c) {
        return (static_cast<unsigned char>(c) & 0xc0) != 0x80;
    }));
}

/// A box, or a bend of an edge that passes a rank.
struct Place {
    double width = 0.0, height = 0.0;
    double x = 0.0; ///< middle
    double y = 0.0; ///< top
    int rank = 0;
    std::vector<std::size_t> above, below; ///< neighbours on the ranks beside
};

struct Layout {
    std::vector<Place> places;                     ///< boxes first, then bends
    std::vector<std::vector<std::size_t>> ranks;   ///< places from left to right
    std::vector<std::vector<std::size_t>> courses; ///< of each edge: the places it passes
    double width = 0.0, height = 0.0;
};

double label_width(const Edge& edge)
{
    return 5.8 * static_cast<double>(letters(edge.label)) + 22.0;
}

Place measure(const Box& box)
{
    // Widths of a common sans-serif face, on the generous side.
    double width = 8.0 * static_cast<double>(letters(box.id));
    width = std::max(width, 6.6 * static_cast<double>(letters(box.op)));
    for (const std::string& detail : box.details)
        width = std::max(width, 6.2 * static_cast<double>(letters(detail)));
    Place out;
    out.width = std::max(72.0, width + 28.0);
    out.height = line_height * (1.0 + (box.op.empty() ? 0.0 : 1.0) +
                                static_cast<double>(box.details.size())) +
                 16.0;
    return out;
}

/// Longest path from a source; sources stand right above what reads them first.
void assign_ranks(const Diagram& diagram, std::vector<Place>& places)
{
    // The reader refuses cycles, so as many rounds as boxes are enough; far fewer are needed.
    for (std::size_t round = 0; round < diagram.boxes.size(); ++round) {
        bool changed = false;
        for (const Edge& edge : diagram.edges) {
            const int below = places[edge.from].rank + 1;
            if (places[edge.to].rank >= below) continue;
            places[edge.to].rank = below;
            changed = true;
        }
        if (!changed) break;
    }
    std::vector<bool> source(diagram.boxes.size(), true);
    for (const Edge& edge : diagram.edges) source[edge.to] = false;
    for (std::size_t i = 0; i < diagram.boxes.size(); ++i) {
        if (!source[i]) continue;
        int nearest = -1;
        for (const Edge& edge : diagram.edges)
            if (edge.from == i)
                nearest =
                    nearest < 0 ? places[edge.to].rank : std::min(nearest, places[edge.to].rank);
        if (nearest > 0) places[i].rank = nearest - 1;
    }
}

/// Edges across several ranks get a bend on each rank between.
void route(const Diagram& diagram, Layout& layout)
{
    for (const Edge& edge : diagram.edges) {
        std::vector<std::size_t> course{edge.from};
        const int last = layout.places[edge.to].rank;
        for (int rank = layout.places[edge.from].rank + 1; rank < last; ++rank) {
            Place bend;
            bend.width = 10.0;
            bend.rank = rank;
            course.push_back(layout.places.size());
            layout.places.push_back(bend);
        }
        course.push_back(edge.to);
        for (std::size_t k = 0; k + 1 < course.size(); ++k) {
            layout.places[course[k]].below.push_back(course[k + 1]);
            layout.places[course[k + 1]].above.push_back(course[k]);
        }
        layout.courses.push_back(std::move(course));
    }
    for (std::size_t i = 0; i < layout.places.size(); ++i) {
        const auto rank = static_cast<std::size_t>(layout.places[i].rank);
        if (layout.ranks.size() <= rank) layout.ranks.resize(rank + 1);
        layout.ranks[rank].push_back(i);
    }
}

std::vector<double> orders(const Layout& layout)
{
    std::vector<double> out(layout.places.size());
    for (const auto& rank : layout.ranks)
        for (std::size_t k = 0; k < rank.size(); ++k) out[rank[k]] = static_cast<double>(k);
    return out;
}

std::size_t crossings(const Layout& layout)
{
    const std::vector<double> order = orders(layout);
    std::size_t out = 0;
    for (const auto& rank : layout.ranks) {
        std::vector<std::pair<double, double>> lines;
        for (const std::size_t i : rank)
            for (const std::size_t j : layout.places[i].below)
                lines.emplace_back(order[i], order[j]);
        for (std::size_t a = 0; a < lines.size(); ++a)
            for (std::size_t b = a + 1; b < lines.size(); ++b)
                if ((lines[a].first - lines[b].first) * (lines[a].second - lines[b].second) < 0)
                    ++out;
    }
    return out;
}

/// Orders each rank by the mean place of its neighbours, down and up in turn, and keeps the order
/// with the fewest crossings.
void order_ranks(Layout& layout)
{
    auto best = layout.ranks;
    std::size_t fewest = crossings(layout);
    for (int sweep = 0; sweep < 12 && fewest > 0; ++sweep) {
        const bool down = sweep % 2 == 0;
        for (std::size_t k = 0; k < layout.ranks.size(); ++k) {
            auto& rank = layout.ranks[down ? k : layout.ranks.size() - 1 - k];
            const std::vector<double> order = orders(layout);
            std::map<std::size_t, double> mean;
            for (const std::size_t i : rank) {
                const auto& beside = down ? layout.places[i].above : layout.places[i].below;
                double sum = 0.0;
                for (const std::size_t j : beside) sum += order[j];
                mean[i] = beside.empty() ? order[i] : sum / static_cast<double>(beside.size());
            }
            std::stable_sort(rank.begin(), rank.end(),
                             [&](std::size_t a, std::size_t b) { return mean[a] < mean[b]; });
        }
        if (const std::size_t now = crossings(layout); now < fewest) {
            fewest = now;
            best = layout.ranks;
        }
    }
    layout.ranks = best;
}

/// Places one rank as near to `wanted` as order and gaps allow (least squares: neighbours that
/// would overlap are pooled and share their mean).
void place_rank(Layout& layout, const std::vector<std::size_t>& rank,
                const std::vector<double>& wanted)
{
    struct Pool {
        double sum;
        std::size_t count;
        double mean() const { return sum / static_cast<double>(count); }
    };
    std::vector<double> offset(rank.size(), 0.0);
    for (std::size_t k = 1; k < rank.size(); ++k)
        offset[k] = offset[k - 1] + box_gap +
                    0.5 * (layout.places[rank[k - 1]].width + layout.places[rank[k]].width);
    std::vector<Pool> pools;
    for (std::size_t k = 0; k < rank.size(); ++k) {
        pools.push_back({wanted[k] - offset[k], 1});
        while (pools.size() > 1 && pools[pools.size() - 2].mean() > pools.back().mean()) {
            const Pool last = pools.back();
            pools.pop_back();
            pools.back().sum += last.sum;
            pools.back().count += last.count;
        }
    }
    std::size_t k = 0;
    for (const Pool& pool : pools)
        for (std::size_t n = 0; n < pool.count; ++n, ++k)
            layout.places[rank[k]].x = pool.mean() + offset[k];
}

void place_columns(Layout& layout)
{
    for (const auto& rank : layout.ranks)
        place_rank(layout, rank, std::vector<double>(rank.size(), 0.0));
    constexpr int sweeps = 24;
    for (int sweep = 0; sweep < sweeps; ++sweep)
        for (std::size_t r = 0; r < layout.ranks.size(); ++r) {
            const auto& rank = layout.ranks[sweep % 2 == 0 ? r : layout.ranks.size() - 1 - r];
            std::vector<double> wanted;
            for (const std::size_t i : rank) {
                const Place& place = layout.places[i];
                double sum = 0.0;
                for (const std::size_t j : place.above) sum += layout.places[j].x;
                for (const std::size_t j : place.below) sum += layout.places[j].x;
                const std::size_t n = place.above.size() + place.below.size();
                wanted.push_back(n == 0 ? place.x : sum / static_cast<double>(n));
            }
            place_rank(layout, rank, wanted);
        }
    double left = 0.0;
    double right = 0.0;
    for (const Place& place : layout.places) {
        left = std::min(left, place.x - 0.5 * place.width);
        right = std::max(right, place.x + 0.5 * place.width);
    }
    for (Place& place : layout.places) place.x += margin - left;
    layout.width = right - left + 2.0 * margin;
}

void place_rows(Layout& layout, double top)
{
    double y = top;
    for (const auto& rank : layout.ranks) {
        double height = 0.0;
        for (const std::size_t i : rank) height = std::max(height, layout.places[i].height);
        for (const std::size_t i : rank) {
            Place& place = layout.places[i];
            if (place.height == 0.0) place.height = height;
            place.y = y + 0.5 * (height - place.height);
        }
        y += height + rank_gap;
    }
    layout.height = y - (layout.ranks.empty() ? 0.0 : rank_gap) + margin;
}

Layout make_layout(const Diagram& diagram, double top)
{
    Layout layout;
    for (const Box& box : diagram.boxes) layout.places.push_back(measure(box));
    // Labels stand side by side above a box; it is as wide as they are.
    std::vector<double> labels(diagram.boxes.size(), 0.0);
    for (const Edge& edge : diagram.edges)
        labels[edge.to] += edge.label.empty() ? 12.0 : label_width(edge);
    for (std::size_t i = 0; i < labels.size(); ++i)
        layout.places[i].width = std::max(layout.places[i].width, labels[i]);
    assign_ranks(diagram, layout.places);
    route(diagram, layout);
    order_ranks(layout);
    place_columns(layout);
    place_rows(layout, top);
    return layout;
}

// --- drawing ---------------------------------------------------------------------------------

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
