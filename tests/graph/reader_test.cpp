// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/reader.h"

#include "tests/support/graph_nodes.h"

#include <gtest/gtest.h>

namespace rayloom
{
namespace
{

const std::string good_folder = std::string(RAYLOOM_SOURCE_DIR) + "/tests/data/graphs/good/";

class Reader : public testing::Test
{
protected:
    static void SetUpTestSuite() { test::register_graph_nodes(); }
};

TEST_F(Reader, ReadsEveryConstruct)
{
    const Graph graph = read_graph(good_folder + "everything.yaml");
    EXPECT_EQ(graph.name, "everything");
    EXPECT_TRUE(graph.warnings.empty());
    const GraphNode* blended = graph.node("blended");
    ASSERT_NE(blended, nullptr);
    EXPECT_EQ(blended->where.line, 27);
    ASSERT_TRUE(blended->otherwise);
    EXPECT_EQ(blended->otherwise->node, "first");
    EXPECT_TRUE(blended->when);
}

} // namespace
} // namespace rayloom
