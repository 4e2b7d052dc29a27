// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/picture.h"

#include "rayloom/graph/reader.h"
#include "tests/support/folders.h"
#include "tests/support/graph_nodes.h"

#include <gtest/gtest.h>

#include <regex>
#include <string>
#include <vector>

namespace rayloom
{
namespace
{

class Picture : public testing::Test
{
protected:
    static void SetUpTestSuite() { test::register_graph_nodes(); }
    static Graph everything()
    {
        return read_graph(test::source_folder().string() +
                          "/tests/data/graphs/good/everything.yaml");
    }
};

struct Rect {
    double x, y, width, height;
};

std::vector<Rect> boxes_of(const std::string& svg)
{
    std::vector<Rect> out;
    const std::regex box("<rect x=\"([-0-9.]+)\" y=\"([-0-9.]+)\" width=\"([0-9.]+)\" "
                         "height=\"([0-9.]+)\"");
    for (std::sregex_iterator it(svg.begin(), svg.end(), box), end; it != end; ++it)
        out.push_back(
            {std::stod((*it)[1]), std::stod((*it)[2]), std::stod((*it)[3]), std::stod((*it)[4])});
    return out;
}

TEST_F(Picture, DotShowsEveryBoxAndHowEdgesDiffer)
{
    const std::string dot = graph_dot(everything());
    for (const char* part :
         {"<b>color</b>", "<b>blended</b><br/>mock.blend", "factor: [1, $strength, 4]",
          "when has(samples)", "color=\"#555555:invis:#555555\"", "style=dashed", "style=dotted",
          "label=\"variance\"", "tooltip=\"What was lost.\""})
        EXPECT_NE(dot.find(part), std::string::npos) << part;
    EXPECT_TRUE(dot.ends_with("}\n"));
}

TEST_F(Picture, SvgBoxesStandApartInsideTheSheet)
{
    const Graph graph = everything();
    const std::string svg = graph_svg(graph);
    const std::vector<Rect> boxes = boxes_of(svg);
    ASSERT_EQ(boxes.size(), graph.inputs.size() + graph.nodes.size() + graph.outputs.size());
    std::smatch sheet;
    ASSERT_TRUE(std::regex_search(svg, sheet, std::regex("viewBox=\"0 0 ([0-9.]+) ([0-9.]+)\"")));
    for (std::size_t i = 0; i < boxes.size(); ++i) {
        const Rect& a = boxes[i];
        EXPECT_GE(a.x, 0.0);
        EXPECT_LE(a.x + a.width, std::stod(sheet[1]));
        EXPECT_LE(a.y + a.height, std::stod(sheet[2]));
        for (std::size_t k = i + 1; k < boxes.size(); ++k) {
            const Rect& b = boxes[k];
            const bool apart = a.x + a.width <= b.x || b.x + b.width <= a.x ||
                               a.y + a.height <= b.y || b.y + b.height <= a.y;
            EXPECT_TRUE(apart) << i << " and " << k;
        }
    }
}

TEST_F(Picture, SvgRunsDownwards)
{
    const Graph graph =
        parse_graph("rayloom: 1\ninputs: {color: x}\nnodes:\n"
                    "  b: {op: mock.gain, image: a}\n  a: {op: mock.gain, image: color}\n"
                    "outputs: {image: b}\n",
                    "g.yaml");
    const std::vector<Rect> boxes = boxes_of(graph_svg(graph)); // color, b, a, image
    ASSERT_EQ(boxes.size(), 4u);
    EXPECT_LT(boxes[0].y + boxes[0].height, boxes[2].y);
    EXPECT_LT(boxes[2].y + boxes[2].height, boxes[1].y);
    EXPECT_LT(boxes[1].y + boxes[1].height, boxes[3].y);
}

TEST_F(Picture, EscapesWhatMarkupWouldTakeForItsOwn)
{
    const Graph graph =
        parse_graph("rayloom: 1\nname: a<b & \"c\"\ninputs: {color: 'x > \"y\" \\'}\n"
                    "nodes: {a: {op: mock.gain, image: color}}\n"
                    "outputs: {image: a}\n",
                    "g.yaml");
    const std::string svg = graph_svg(graph);
    EXPECT_NE(svg.find("a&lt;b &amp; &quot;c&quot;"), std::string::npos);
    EXPECT_NE(svg.find("<title>x &gt; &quot;y&quot; \\</title>"), std::string::npos);
    const std::string dot = graph_dot(graph);
    EXPECT_NE(dot.find("digraph \"a<b & \\\"c\\\"\""), std::string::npos);
    EXPECT_NE(dot.find("tooltip=\"x > \\\"y\\\" \\\\\""), std::string::npos);
}

} // namespace
} // namespace rayloom
