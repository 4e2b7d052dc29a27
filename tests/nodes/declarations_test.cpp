// SPDX-License-Identifier: Apache-2.0
/// What every registered node owes to whoever reads its help: checked here for all, so that a new
/// node is held to it without a test of its own.
#include "rayloom/core/registry.h"
#include "tests/support/folders.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>

namespace rayloom
{
namespace
{

namespace fs = std::filesystem;

/// Calls check(info) for each node, naming it in failures.
template <class Check>
void for_each_node(const Check& check)
{
    const auto nodes = Registry::instance().all();
    ASSERT_FALSE(nodes.empty());
    for (const NodeInfo* info : nodes) {
        SCOPED_TRACE(info->name);
        check(*info);
    }
}

TEST(Declarations, NamesAreStageAndWhat)
{
    const std::regex node_name("[a-z]+\\.[a-z][a-z0-9_]*"), member_name("[a-z][a-z0-9_]*");
    for_each_node([&](const NodeInfo& info) {
        EXPECT_TRUE(std::regex_match(info.name, node_name));
        EXPECT_GE(info.version, 1);
        std::set<std::string> keys; // inputs and parameters share the keys of a graph file
        for (const auto& port : info.inputs) {
            EXPECT_TRUE(std::regex_match(port.name, member_name)) << port.name;
            EXPECT_TRUE(keys.insert(port.name).second) << port.name;
        }
        for (const auto& param : info.params) {
            EXPECT_TRUE(std::regex_match(param.name, member_name)) << param.name;
            EXPECT_TRUE(keys.insert(param.name).second) << param.name;
        }
        for (const char* reserved : {"op", "when", "otherwise"})
            EXPECT_FALSE(keys.contains(reserved)) << reserved;
    });
}

TEST(Declarations, EverythingHasASentence)
{
    for_each_node([](const NodeInfo& info) {
        ASSERT_FALSE(info.summary.empty());
        EXPECT_EQ(info.summary.back(), '.') << info.summary;
        for (const auto& port : info.inputs) EXPECT_FALSE(port.doc.empty()) << port.name;
        for (const auto& port : info.outputs) EXPECT_FALSE(port.doc.empty()) << port.name;
        for (const auto& param : info.params) EXPECT_FALSE(param.doc.empty()) << param.name;
    });
}

TEST(Declarations, DefaultsAreWithinTheirRange)
{
    for_each_node([](const NodeInfo& info) {
        for (const auto& param : info.params)
            if (!param.required) {
                EXPECT_NO_THROW(check_param(param, param.default_value)) << param.name;
            }
    });
}

TEST(Declarations, NodesAreMadeFromTheirDefaults)
{
    for_each_node([](const NodeInfo& info) {
        ParamValues values;
        for (const auto& param : info.params)
            if (!param.required) values[param.name] = param.default_value;
        EXPECT_NE(info.create(values), nullptr);
    });
}

/// Whether a source file registers a node.
bool registers_a_node(const fs::path& file)
{
    std::ostringstream text;
    text << std::ifstream(file).rdbuf();
    return text.str().find("RAYLOOM_NODE(") != std::string::npos;
}

TEST(Declarations, EveryNodeFileHasItsTest)
{
    const fs::path source = test::source_folder();
    std::size_t seen = 0;
    for (const auto& entry : fs::recursive_directory_iterator(source / "nodes")) {
        const fs::path& file = entry.path();
        if (file.extension() != ".cpp" || !registers_a_node(file)) continue;
        ++seen;
        const fs::path stem = fs::relative(file, source).replace_extension();
        EXPECT_TRUE(fs::exists(source / "tests" / (stem.string() + "_test.cpp"))) << stem;
    }
    EXPECT_GT(seen, 0u);
}

} // namespace
} // namespace rayloom
