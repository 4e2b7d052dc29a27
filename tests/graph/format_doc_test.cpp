// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/reader.h"
#include "tests/support/folders.h"

#include <gtest/gtest.h>

#include <fstream>
#include <string>

namespace rayloom
{
namespace
{

/// Every whole graph on the reference page is one the reader reads.
TEST(FormatDoc, ExamplesAreRead)
{
    const std::string page = "docs/graph-format.md";
    std::ifstream file(test::source_folder().string() + "/" + page);
    ASSERT_TRUE(file);
    std::string line;
    std::string block;
    bool inside = false;
    int number = 0;
    int examples = 0;
    while (std::getline(file, line)) {
        ++number;
        if (inside && line == "```") {
            inside = false;
            if (!block.starts_with("rayloom:")) continue;
            ++examples;
            const std::string name =
                page + " (example that ends on line " + std::to_string(number) + ")";
            try {
                const Graph graph = parse_graph(block, name);
                EXPECT_FALSE(graph.outputs.empty()) << name;
            } catch (const Error& error) {
                ADD_FAILURE() << error.what();
            }
        } else if (inside) {
            block += line + "\n";
        } else if (line == "```yaml") {
            inside = true;
            block.clear();
        }
    }
    EXPECT_GE(examples, 4);
}

} // namespace
} // namespace rayloom
