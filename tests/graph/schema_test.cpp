// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/schema.h"

#include "rayloom/core/registry.h"
#include "rayloom/graph/yaml.h"
#include "tests/support/folders.h"
#include "tests/support/graph_nodes.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <set>

#include <unistd.h>

namespace rayloom
{
namespace
{

namespace fs = std::filesystem;

const fs::path graphs_folder = test::source_folder() / "tests" / "data" / "graphs";

class Schema : public testing::Test
{
protected:
    static void SetUpTestSuite() { test::register_graph_nodes(); }
};

/// JSON is YAML, so the reader's own tree serves.
yaml::ValuePtr parsed(const std::string& json)
{
    std::vector<Problem> problems;
    yaml::ValuePtr root = yaml::parse(json, "schema", problems);
    for (const Problem& p : problems) ADD_FAILURE() << p.text();
    return root;
}

const yaml::Value& at(const yaml::Value& value, std::initializer_list<const char*> path)
{
    const yaml::Value* here = &value;
    for (const char* key : path) {
        const yaml::Entry* entry = here->find(key);
        if (!entry) throw std::runtime_error(std::string("no key ") + key);
        here = entry->value.get();
    }
    return *here;
}

TEST_F(Schema, DescribesEveryNode)
{
    const yaml::ValuePtr root = parsed(graph_schema());
    ASSERT_TRUE(root);
    const yaml::Value& definitions = at(*root, {"$defs"});
    for (const NodeInfo* info : Registry::instance().all()) {
        SCOPED_TRACE(info->name);
        const yaml::Value& node = at(definitions, {info->name.c_str()});
        EXPECT_EQ(at(node, {"additionalProperties"}).text, "false");
        EXPECT_EQ(at(node, {"properties", "op", "const"}).text, info->name);
        std::set<std::string> required;
        for (const auto& item : at(node, {"required"}).items) required.insert(item->text);
        for (const PortInfo& port : info->inputs) {
            EXPECT_NE(at(node, {"properties"}).find(port.name), nullptr) << port.name;
            EXPECT_EQ(required.contains(port.name), port.required) << port.name;
        }
        for (const ParamInfo& param : info->params)
            EXPECT_EQ(at(node, {"properties", param.name.c_str(), "description"})
                          .text.substr(0, param.doc.size()),
                      param.doc);
    }
    const yaml::Value& factor =
        *at(definitions, {"mock.gain", "properties", "factor", "anyOf"}).items.at(0);
    EXPECT_EQ(at(factor, {"type"}).text, "number");
    EXPECT_EQ(at(factor, {"minimum"}).text, "0");
    EXPECT_EQ(at(factor, {"maximum"}).text, "16");
    EXPECT_EQ(at(definitions, {"mock.gain", "properties", "factor", "default"}).text, "1");
}

TEST_F(Schema, EveryReferenceResolves)
{
    const yaml::ValuePtr root = parsed(graph_schema());
    ASSERT_TRUE(root);
    const yaml::Value& definitions = at(*root, {"$defs"});
    int references = 0;
    const std::function<void(const yaml::Value&)> walk = [&](const yaml::Value& value) {
        for (const yaml::Entry& entry : value.entries) {
            if (entry.key == "$ref") {
                const std::string prefix = "#/$defs/";
                ASSERT_TRUE(entry.value->text.starts_with(prefix)) << entry.value->text;
                EXPECT_NE(definitions.find(entry.value->text.substr(prefix.size())), nullptr)
                    << entry.value->text;
                ++references;
            }
            walk(*entry.value);
        }
        for (const auto& item : value.items) walk(*item);
    };
    walk(*root);
    EXPECT_GT(references, 20);
}

/// Python's validator, where it is installed, agrees with the reader on what the schema can know.
TEST_F(Schema, AcceptsGoodFilesAndRefusesBadOnes)
{
    if (std::system("python3 -c 'import jsonschema, yaml; "
                    "jsonschema.Draft202012Validator' >/dev/null 2>&1") != 0)
        GTEST_SKIP() << "python3-jsonschema (4.0 or newer) and python3-yaml are not installed";
    const fs::path folder =
        fs::temp_directory_path() / ("rayloom_schema_test_" + std::to_string(::getpid()));
    fs::create_directories(folder);
    std::ofstream(folder / "schema.json") << graph_schema();
    std::ofstream(folder / "validate.py")
        << "import json, sys, yaml, jsonschema\n"
           "schema = json.load(open(sys.argv[1]))\n"
           "jsonschema.Draft202012Validator.check_schema(schema)\n"
           "validator = jsonschema.Draft202012Validator(schema)\n"
           "for name in sys.argv[3:]:\n"
           "    if not validator.is_valid(yaml.safe_load(open(name))):\n"
           "        open(sys.argv[2], 'a').write(name + '\\n')\n";
    std::string command = "cd '" + graphs_folder.string() + "' && python3 '" +
                          (folder / "validate.py").string() + "' '" +
                          (folder / "schema.json").string() + "' '" +
                          (folder / "refused").string() + "' good/*.yaml";
    std::string expected;
    for (const char* bad :
         {"unknown-parameter", "unknown-op", "unknown-section", "missing-input", "version-newer",
          "version-missing", "missing-parameter", "out-of-range", "wrong-type", "op-missing",
          "bad-names", "inputs", "outputs", "params", "bad-reference"}) {
        const std::string file = "bad/" + std::string(bad) + ".yaml";
        command += " " + file;
        expected += file + "\n";
    }
    ASSERT_EQ(std::system(command.c_str()), 0);
    std::ifstream refused(folder / "refused");
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(refused), {}), expected);
    fs::remove_all(folder);
}

} // namespace
} // namespace rayloom
