// SPDX-License-Identifier: Apache-2.0
#include "rayloom/cli/command.h"
#include "rayloom/core/error.h"
#include "rayloom/core/reference.h"
#include "rayloom/core/registry.h"
#include "rayloom/core/text.h"
#include "rayloom/engine/cache.h"
#include "rayloom/graph/reader.h"
#include "rayloom/graph/schema.h"

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>

namespace rayloom::cli
{

namespace
{

int list_nodes()
{
    for (const NodeInfo* node : Registry::instance().all())
        std::printf("%-28s %s\n", node->name.c_str(), node->summary.c_str());
    return 0;
}

int help(const std::string& name)
{
    if (const NodeInfo* node = Registry::instance().find(name)) {
        std::cout << node_help(*node);
        return 0;
    }
    std::string file;
    try {
        file = find_graph(name);
    } catch (const InputError&) {
        throw UsageError("there is no node and no graph '" + name + "'" +
                         suggestion(name, Registry::instance().names()) +
                         " (rayloom nodes lists the nodes)");
    }
    const Graph graph = read_graph(file);
    NodeInfo info = graph_signature(graph);
    info.name = graph.name.empty() ? name : graph.name;
    info.summary = "A graph of " + std::to_string(graph.nodes.size()) + " nodes.";
    info.origin = file;
    std::cout << node_help(info);
    return 0;
}

int write_docs(const std::string& folder)
{
    std::error_code status;
    std::filesystem::create_directories(folder, status);
    if (status) throw OutputError("'" + folder + "' cannot be made: " + status.message());
    const auto nodes = Registry::instance().all();
    write_text_file(folder + "/README.md", node_index(nodes));
    for (const NodeInfo* node : nodes)
        write_text_file(folder + "/" + node->name + ".md", node_page(*node));
    std::cout << nodes.size() << " pages and README.md in " << folder << "\n";
    return 0;
}

} // namespace

void add_node_commands(CLI::App& app, Action& action)
{
    app.add_subcommand("nodes", "List the nodes")->callback([&action] { action = list_nodes; });

    CLI::App* help_command =
        app.add_subcommand("help", "Explain a node or a graph: inputs, outputs, parameters");
    auto op = std::make_shared<std::string>();
    help_command->add_option("op", *op, "Name of a node or a graph")->required()->type_name("OP");
    help_command->callback([op, &action] { action = [op] { return help(*op); }; });

    CLI::App* docs_command = app.add_subcommand("docs", "Write the reference pages of all nodes");
    auto folder = std::make_shared<std::string>();
    docs_command->add_option("--out", *folder, "Folder")->required()->type_name("DIR");
    docs_command->callback(
        [folder, &action] { action = [folder] { return write_docs(*folder); }; });

    app.add_subcommand("schema", "Print the JSON schema of graph files, for editors")
        ->callback([&action] {
            action = [] {
                std::cout << graph_schema() << "\n";
                return 0;
            };
        });
}

} // namespace rayloom::cli
