// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/reader.h"

#include "tests/support/folders.h"
#include "tests/support/graph_nodes.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <unistd.h>

namespace rayloom
{
namespace
{

namespace fs = std::filesystem;

const fs::path graphs_folder = test::source_folder() / "tests" / "data" / "graphs";

std::string file_text(const fs::path& path)
{
    std::ifstream file(path, std::ios::binary);
    std::ostringstream text;
    text << file.rdbuf();
    return text.str();
}

/// A graph of the given nodes over one input, `color`.
std::string graph_of(const std::string& nodes, const std::string& output)
{
    return "rayloom: 1\ninputs: {color: noisy image}\nnodes:\n" + nodes +
           "outputs: {image: " + output + "}\n";
}

std::string problems_of(const std::string& text)
{
    try {
        parse_graph(text, "g.yaml");
    } catch (const GraphError& error) {
        return error.what();
    }
    return "";
}

class Reader : public testing::Test
{
protected:
    static void SetUpTestSuite() { test::register_graph_nodes(); }
};

/// Runs in a folder, so that messages show paths as a person there would type them.
class WorkingFolder
{
public:
    explicit WorkingFolder(const fs::path& folder) : m_before(fs::current_path())
    {
        fs::current_path(folder);
    }
    ~WorkingFolder() { fs::current_path(m_before); }
    WorkingFolder(const WorkingFolder&) = delete;
    WorkingFolder& operator=(const WorkingFolder&) = delete;

private:
    fs::path m_before;
};

TEST_F(Reader, ReportsEveryMistakeOfEveryBadFile)
{
    const WorkingFolder folder(graphs_folder / "bad");
    int files = 0;
    for (const auto& entry : fs::directory_iterator(".")) {
        if (entry.path().extension() != ".yaml") continue;
        const std::string name = entry.path().filename().string();
        SCOPED_TRACE(name);
        fs::path expected = entry.path();
        expected.replace_extension(".expect");
        try {
            read_graph(name);
            ADD_FAILURE() << "read without a complaint";
        } catch (const GraphError& error) {
            EXPECT_EQ(std::string(error.what()) + "\n", file_text(expected));
            EXPECT_EQ(error.exit_code(), 2);
        }
        ++files;
    }
    EXPECT_GE(files, 50);
}

TEST_F(Reader, EveryExpectedMessageHasItsFile)
{
    for (const auto& entry : fs::directory_iterator(graphs_folder / "bad")) {
        fs::path graph = entry.path();
        EXPECT_TRUE(fs::exists(graph.replace_extension(".yaml"))) << entry.path();
    }
}

TEST_F(Reader, ReadsEveryConstruct)
{
    const Graph graph = read_graph((graphs_folder / "good" / "everything.yaml").string());
    EXPECT_EQ(graph.name, "everything");
    EXPECT_EQ(graph.doc, "Uses every construct of the format, and nothing else.\n");
    EXPECT_TRUE(graph.warnings.empty());
    EXPECT_EQ(graph.nodes.size(), 17u);
    EXPECT_EQ(graph.expanded_nodes, 17u);
    EXPECT_EQ(graph.nodes[0].id, "first");
    EXPECT_EQ(graph.nodes[16].id, "inner");

    const GraphParam* strength = graph.param("strength");
    ASSERT_NE(strength, nullptr);
    EXPECT_EQ(strength->info.type, ParamType::real);
    EXPECT_EQ(strength->info.default_value, ParamValue(1.0));
    EXPECT_EQ(strength->info.min, 0.0);
    EXPECT_EQ(strength->info.max, 8.0);
    EXPECT_EQ(strength->info.doc, "How much.");
    EXPECT_EQ(graph.param("scales")->info.default_value, ParamValue(std::int64_t{3}));
    EXPECT_EQ(graph.param("kappa")->info.type, ParamType::real);
    EXPECT_EQ(graph.param("enabled")->info.type, ParamType::boolean);
    EXPECT_EQ(graph.param("label")->info.default_value, ParamValue(std::string("word")));
    EXPECT_EQ(graph.param("weights")->info.default_value,
              ParamValue(std::vector<double>{1.0, 2.5, 3.0}));
    EXPECT_EQ(graph.param("names")->info.default_value,
              ParamValue(std::vector<std::string>{"a", "b"}));
    EXPECT_TRUE(graph.param("path")->info.required);
    EXPECT_EQ(graph.param("mode")->info.type, ParamType::choice);

    EXPECT_EQ(graph.input("color")->doc, "noisy linear radiance");
    EXPECT_EQ(graph.input("color")->channels, "any");
    EXPECT_FALSE(graph.input("albedo")->required);
    EXPECT_EQ(graph.input("albedo")->role, "albedo");
    EXPECT_EQ(graph.input("albedo")->channels, "RGB");
    EXPECT_EQ(graph.input("frames")->kind, PortKind::list);
    EXPECT_EQ(graph.input("stack")->kind, PortKind::list);
    EXPECT_EQ(graph.input("stack")->channels, "R,G,B");
    EXPECT_EQ(graph.input("samples")->kind, PortKind::deep);
    EXPECT_TRUE(graph.input("mask")->required);

    const GraphNode* blended = graph.node("blended");
    ASSERT_NE(blended, nullptr);
    EXPECT_EQ(blended->where.line, 27);
    EXPECT_EQ(blended->where.column, 3);
    EXPECT_EQ(blended->op, "mock.blend");
    ASSERT_TRUE(blended->when);
    ASSERT_TRUE(blended->otherwise);
    EXPECT_EQ(blended->otherwise->node, "first");
    const Argument* mode = blended->argument("mode");
    ASSERT_NE(mode, nullptr);
    EXPECT_FALSE(mode->is_port);
    ASSERT_EQ(mode->items.size(), 1u);
    EXPECT_EQ(std::get<ParamReference>(mode->items[0]).name, "mode");

    const Argument* levels = graph.node("joined")->argument("levels");
    EXPECT_TRUE(levels->is_port);
    EXPECT_FALSE(levels->streams_are_list);
    const Argument* pair = graph.node("pair")->argument("levels");
    EXPECT_TRUE(pair->streams_are_list);
    ASSERT_EQ(pair->streams.size(), 3u);
    EXPECT_EQ(pair->streams[1].port, "mean");
    EXPECT_EQ(pair->streams[2].index, 0);

    const Argument* factor = graph.node("mapped")->argument("factor");
    EXPECT_TRUE(factor->items_are_list);
    ASSERT_EQ(factor->items.size(), 3u);
    EXPECT_EQ(std::get<ParamValue>(factor->items[0]), ParamValue(1.0));
    EXPECT_EQ(std::get<ParamReference>(factor->items[1]).name, "strength");

    // Text parameters keep what was written; `$$` stands for one `$`.
    EXPECT_EQ(std::get<ParamValue>(graph.node("types")->argument("text")->items[0]),
              ParamValue(std::string("1.0")));
    EXPECT_EQ(std::get<ParamValue>(graph.node("worded")->argument("text")->items[0]),
              ParamValue(std::string("$name")));

    // A key given beside a merged mapping wins over it.
    EXPECT_EQ(std::get<ParamReference>(graph.node("first")->argument("factor")->items[0]).name,
              "strength");
    EXPECT_EQ(std::get<ParamValue>(graph.node("first")->argument("repeat")->items[0]),
              ParamValue(std::int64_t{2}));

    const GraphNode* inner = graph.node("inner");
    ASSERT_TRUE(inner->graph);
    EXPECT_EQ(inner->graph->name, "inner");
    EXPECT_TRUE(inner->argument("picture")->is_port);
    EXPECT_FALSE(inner->argument("gain")->is_port);

    EXPECT_EQ(graph.output("variance")->stream.port, "variance");
    EXPECT_EQ(graph.output("variance")->doc, "What was lost.");
    EXPECT_EQ(graph.output("inner")->stream.port, "bright");
}

TEST_F(Reader, KnowsWhatOutputsCarry)
{
    const auto kind = [](const std::string& nodes, const std::string& output) {
        return parse_graph(graph_of(nodes, output), "g.yaml").outputs.at(0).kind;
    };
    const std::string levels = "  a: {op: mock.levels, image: color}\n";
    const std::string mapped = levels + "  b: {op: mock.gain, image: a}\n";
    EXPECT_EQ(kind(levels, "a"), PortKind::list);
    EXPECT_EQ(kind(levels, "'a[1]'"), PortKind::image);
    EXPECT_EQ(kind(mapped, "b"), PortKind::list);
    EXPECT_EQ(kind(mapped + "  c: {op: mock.join, levels: b}\n", "c"), PortKind::image);
    EXPECT_EQ(kind("  a: {op: mock.measure, image: color}\n", "a"), PortKind::table);
    // Measured over a list: as many tables as elements, which the planner counts.
    EXPECT_EQ(kind(levels + "  b: {op: mock.measure, image: a}\n", "b"), std::nullopt);
    EXPECT_EQ(kind(levels + "  b: {op: mock.gain, image: color, when: true, otherwise: a}\n", "b"),
              std::nullopt);
}

TEST_F(Reader, WarnsOfWhatNobodyUses)
{
    const Graph graph = parse_graph("rayloom: 1\n"
                                    "params: {used: 1.0, asked: true, spare: 2}\n"
                                    "inputs: {color: x, idle: y, seen: z}\n"
                                    "nodes:\n"
                                    "  a: {op: mock.gain, image: color, factor: $used,\n"
                                    "      when: $asked and has(seen)}\n"
                                    "outputs: {image: a}\n",
                                    "g.yaml");
    ASSERT_EQ(graph.warnings.size(), 2u);
    EXPECT_EQ(graph.warnings[0].text(), "g.yaml:2:34: parameter 'spare' is not used");
    EXPECT_EQ(graph.warnings[1].text(), "g.yaml:3:20: input 'idle' is not used");
}

TEST_F(Reader, TakesJsonForItIsYaml)
{
    const Graph graph =
        parse_graph(R"({"rayloom": 1, "params": {"f": 2.0}, "inputs": {"color": "x"},
            "nodes": {"a": {"op": "mock.gain", "image": "color", "factor": "$f"}},
            "outputs": {"image": "a"}})",
                    "g.json");
    EXPECT_EQ(std::get<ParamReference>(graph.node("a")->argument("factor")->items[0]).name, "f");
}

TEST_F(Reader, TakesWindowsLineEndsAndAByteOrderMark)
{
    std::string text = graph_of("  a: {op: mock.gain, image: color}\n", "a");
    for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 2)
        text.replace(at, 1, "\r\n");
    EXPECT_NO_THROW(parse_graph("\xef\xbb\xbf" + text, "g.yaml"));
}

TEST_F(Reader, ColumnsCountCharacters)
{
    EXPECT_EQ(problems_of(graph_of("  a: {op: mock.gain, image: color, "
                                   "when: \"'é' == 'é' and bad\"}\n",
                                   "a")),
              "g.yaml:4:58: node 'a' (mock.gain): 'when': 'bad' stands alone; write $bad for a "
              "parameter, has(bad) for a stream, 'bad' in quotes for text");
}

TEST_F(Reader, RefusesWhatIsNoFile)
{
    try {
        read_graph("no/such/graph.yaml");
        FAIL();
    } catch (const InputError& error) {
        EXPECT_STREQ(error.what(),
                     "cannot read graph 'no/such/graph.yaml': No such file or directory");
    }
    EXPECT_THROW(read_graph(graphs_folder.string()), InputError);
}

TEST_F(Reader, BoundsSizeNestingAndReuse)
{
    EXPECT_EQ(problems_of(std::string(2'000'000, '#')),
              "g.yaml: the file is larger than 1 MiB; is it a graph file?");
    for (const char* opening : {"[", "{a: ", "- ", "? ", "a: [", "&a ["}) {
        std::string text = "rayloom: 1\nx: ";
        while (text.size() < 300'000) text += opening;
        EXPECT_NE(problems_of(text), "") << opening;
    }
    // Fifteen files that each use the next ten times would be 10^15 nodes.
    const fs::path folder =
        fs::temp_directory_path() / ("rayloom_reader_test_" + std::to_string(::getpid()));
    fs::create_directories(folder);
    for (int i = 0; i < 15; ++i) {
        std::ofstream file(folder / ("g" + std::to_string(i) + ".yaml"));
        file << "rayloom: 1\ninputs: {color: x}\nnodes:\n";
        for (int k = 0; k < 10; ++k)
            if (i == 14)
                file << "  n" << k << ": {op: mock.gain, image: color}\n";
            else
                file << "  n" << k << ": {op: \"graph:g" << i + 1 << ".yaml\", color: color}\n";
        file << "outputs: {image: n0}\n";
    }
    try {
        read_graph((folder / "g0.yaml").string());
        ADD_FAILURE() << "a million billion nodes were accepted";
    } catch (const GraphError& error) {
        EXPECT_NE(std::string(error.what()).find("the graph has more than 10000 nodes"),
                  std::string::npos);
    }
    fs::remove_all(folder);
}

TEST_F(Reader, FollowsLongChains)
{
    std::string nodes = "  n0: {op: mock.gain, image: color}\n";
    for (int i = 1; i < 5000; ++i)
        nodes += "  n" + std::to_string(i) + ": {op: mock.gain, image: n" + std::to_string(i - 1) +
                 "}\n";
    EXPECT_EQ(parse_graph(graph_of(nodes, "n4999"), "g.yaml").nodes.size(), 5000u);
}

TEST_F(Reader, ReportsAManyTimesRepeatedMistakeInBounds)
{
    std::string nodes;
    for (int i = 0; i < 500; ++i)
        nodes += "  n" + std::to_string(i) + ": {op: mock.gain, image: colour}\n";
    try {
        parse_graph(graph_of(nodes, "n0"), "g.yaml");
        FAIL();
    } catch (const GraphError& error) {
        EXPECT_EQ(error.problems().size(), 201u);
        EXPECT_EQ(error.problems().back().text(), "g.yaml: and 300 more problems");
    }
}

TEST_F(Reader, SignatureIsThatOfANode)
{
    const NodeInfo info =
        graph_signature(read_graph((graphs_folder / "good" / "everything.yaml").string()));
    EXPECT_EQ(info.name, "everything");
    EXPECT_FALSE(info.input("albedo")->required);
    EXPECT_EQ(info.input("frames")->kind, PortKind::list);
    EXPECT_EQ(info.param("scales")->type, ParamType::integer);
    EXPECT_EQ(info.output("figures")->kind, PortKind::image);
    EXPECT_EQ(info.output("image")->doc, "");
}

TEST_F(Reader, FindsGraphsByPathAndByName)
{
    const std::string path = (graphs_folder / "good" / "inner.yaml").string();
    EXPECT_EQ(find_graph(path), path);
    ::setenv("RAYLOOM_GRAPH_PATH", (graphs_folder / "good").c_str(), 1);
    EXPECT_EQ(find_graph("inner"), path);
    EXPECT_EQ(find_graph("inner.yaml"), path);
    try {
        find_graph("iner");
        ADD_FAILURE();
    } catch (const InputError& error) {
        const std::string message = error.what();
        EXPECT_TRUE(message.starts_with("graph 'iner' was not found; did you mean 'inner'?"));
        EXPECT_NE(message.find(graphs_folder / "good"), std::string::npos);
        EXPECT_EQ(error.exit_code(), 3);
    }
    ::setenv("RAYLOOM_GRAPH_PATH", "/nowhere", 1);
    EXPECT_THROW(find_graph("inner"), InputError) << "a folder that is not there is a slip";
    ::unsetenv("RAYLOOM_GRAPH_PATH");
    EXPECT_THROW(find_graph(""), InputError);
    EXPECT_THROW(find_graph("inner"), InputError);
}

TEST_F(Reader, ACommaThatEndsATextIsExplained)
{
    EXPECT_EQ(
        problems_of("rayloom: 1\ninputs: {color: {doc: noisy, linear}}\n"
                    "nodes: {a: {op: mock.gain, image: color}}\noutputs: {image: a}\n"),
        "g.yaml:2:30: input 'color': 'linear' is not a key here; there is: doc, channels, kind, "
        "list, optional, role and neighbours; a text with a comma in it needs quotes");
}

TEST_F(Reader, GraphsAsNodesAreFoundBesideTheFileOrByName)
{
    const test::TemporaryFolder folder;
    const auto inside = [&](const std::string& name) {
        const std::string text =
            "rayloom: 1\ninputs: {image: noisy}\nnodes:\n  a: {op: 'graph:" + name +
            "', image: image}\noutputs: {image: a.image}\n";
        return parse_graph(text, "g.yaml", folder.path()).node("a")->graph;
    };
    EXPECT_EQ(inside("nlm-image")->name, "nlm-image") << "one that comes with rayloom";
    std::ofstream(folder.path() / "nlm-image.yaml")
        << "rayloom: 1\nname: mine\ninputs: {image: noisy}\n"
           "nodes: {b: {op: mock.gain, image: image}}\noutputs: {image: b}\n";
    EXPECT_EQ(inside("nlm-image.yaml")->name, "mine");
    EXPECT_EQ(inside("nlm-image")->name, "nlm-image");
}

/// The paths a node of a graph in `folder` is given by `argument`; `params` are the graph's.
std::vector<std::string> paths_given(const std::string& params, const std::string& argument,
                                     const std::string& folder)
{
    const Graph graph = parse_graph("rayloom: 1\n" + params + "nodes: {a: {op: mock.files, " +
                                        argument + "}}\noutputs: {image: a}\n",
                                    "g.yaml", folder);
    std::vector<std::string> paths;
    for (const auto& item : graph.node("a")->arguments.at(0).items) {
        const auto* reference = std::get_if<ParamReference>(&item);
        const ParamValue& value = reference ? graph.param(reference->name)->info.default_value
                                            : std::get<ParamValue>(item);
        if (const auto* list = std::get_if<std::vector<std::string>>(&value))
            paths.insert(paths.end(), list->begin(), list->end());
        else
            paths.push_back(std::get<std::string>(value));
    }
    return paths;
}

TEST_F(Reader, PathsAreRelativeToTheFileThatHoldsThem)
{
    using Paths = std::vector<std::string>;
    EXPECT_EQ(paths_given("", "file: a.exr", "shots/x"), Paths{"shots/x/a.exr"});
    EXPECT_EQ(paths_given("", "file: ../a.exr", "/shots/x"), Paths{"/shots/x/../a.exr"});
    EXPECT_EQ(paths_given("", "file: /a.exr", "shots"), Paths{"/a.exr"});
    EXPECT_EQ(paths_given("", "file: ''", "shots"), Paths{""});
    EXPECT_EQ(paths_given("", "file: a.exr", "."), Paths{"a.exr"});
    EXPECT_EQ(paths_given("", "files: [a.exr, /b.exr]", "shots"), (Paths{"shots/a.exr", "/b.exr"}));
    EXPECT_EQ(paths_given("", "files: a.exr", "shots"), Paths{"shots/a.exr"});
    EXPECT_EQ(paths_given("params: {p: {type: path, default: a.exr}}\n", "file: $p", "shots"),
              Paths{"shots/a.exr"});
    EXPECT_EQ(paths_given("params: {p: {type: paths, default: [a, b]}}\n", "files: $p", "shots"),
              (Paths{"shots/a", "shots/b"}));
    EXPECT_EQ(paths_given("params: {p: {type: path}}\n", "files: [$p, c]", "shots"),
              (Paths{"", "shots/c"}));
}

TEST_F(Reader, WhereAPathBeginsIsNeverInDoubt)
{
    const auto problems = [](const std::string& param, const std::string& argument) {
        return problems_of("rayloom: 1\nparams: {p: " + param +
                           "}\nnodes:\n  a: {op: mock.files, " + argument +
                           "}\noutputs: {image: a}\n");
    };
    EXPECT_EQ(problems("a.exr", "file: $p"),
              "g.yaml:4:29: node 'a' (mock.files): parameter 'file' is of type path, '$p' of type "
              "string; declare 'p' with 'type: path'");
    EXPECT_EQ(problems("[a, b]", "files: $p"),
              "g.yaml:4:30: node 'a' (mock.files): parameter 'files' is of type paths, '$p' of "
              "type strings; declare 'p' with 'type: paths'");
    EXPECT_EQ(problems("{type: path, default: a}", "file: $p, when: $p == 'a'"),
              "g.yaml:4:45: node 'a' (mock.files): 'when': the path '$p' can only be compared "
              "with ''");
    EXPECT_EQ(problems("{type: path, default: ''}", "file: $p, when: $p != ''"), "");
}

} // namespace
} // namespace rayloom
