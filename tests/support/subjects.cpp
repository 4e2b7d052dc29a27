// SPDX-License-Identifier: Apache-2.0
#include "tests/support/subjects.h"

#include "rayloom/core/registry.h"
#include "rayloom/graph/reader.h"
#include "tests/support/folders.h"

#include <algorithm>
#include <cctype>
#include <filesystem>

namespace rayloom::test
{

namespace fs = std::filesystem;

std::vector<std::string> built_in_nodes()
{
    std::vector<std::string> names;
    for (const NodeInfo* node : Registry::instance().all())
        if (!node->name.starts_with("engine.") && !node->name.starts_with("mock."))
            names.push_back(node->name);
    return names;
}

Graph example_graph(const std::string& node)
{
    std::string text = Registry::instance().find(node)->example;
    const std::string config = "config: config.ocio";
    if (const std::size_t at = text.find(config); at != std::string::npos)
        text.replace(at, config.size(),
                     "config: " + test::source_folder().string() + "/tests/data/ocio/config.ocio");
    return parse_graph(text, node);
}

bool touches_files(const Graph& graph)
{
    return std::ranges::any_of(graph.nodes,
                               [](const GraphNode& n) { return n.op.starts_with("io."); });
}

std::vector<std::string> shipped_graphs()
{
    std::vector<std::string> files;
    for (const auto& entry : fs::directory_iterator(test::source_folder() / "graphs"))
        if (entry.path().extension() == ".yaml") files.push_back(entry.path().string());
    std::ranges::sort(files);
    return files;
}

std::string as_test_name(const std::string& subject)
{
    std::string name = fs::path(subject).filename().string();
    for (char& c : name)
        if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
    return name;
}

} // namespace rayloom::test
