// SPDX-License-Identifier: Apache-2.0
#include "rayloom/cli/command.h"
#include "rayloom/cli/manual.h"
#include "rayloom/core/error.h"
#include "rayloom/core/reference.h"
#include "rayloom/core/registry.h"
#include "rayloom/core/text.h"
#include "rayloom/graph/reader.h"
#include "rayloom/graph/schema.h"
#include "rayloom/image/atomic_file.h"

#include <algorithm>
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

int help(const CLI::App& app, const std::string& name)
{
    if (name.empty()) {
        std::cout << app.help();
        return 0;
    }
    if (const NodeInfo* node = Registry::instance().find(name)) {
        std::cout << node_help(*node);
        return 0;
    }
    const std::vector<std::string> commands = command_names(app);
    if (std::ranges::find(commands, name) != commands.end()) {
        std::cout << app.get_subcommand(name)->help();
        return 0;
    }
    std::string file;
    try {
        file = find_graph(name);
    } catch (const InputError&) {
        std::vector<std::string> known = Registry::instance().names();
        for (const std::string& graph : graph_names()) known.push_back(graph);
        throw UsageError("there is no node, graph or command '" + name + "'" +
                         suggestion(name, known) +
                         " (rayloom nodes lists the nodes, rayloom graphs the graphs)");
    }
    const Graph graph = read_graph(file);
    NodeInfo info = graph_signature(graph);
    info.name = graph.name.empty() ? name : graph.name;
    info.summary = "A graph of " + std::to_string(graph.nodes.size()) + " nodes.";
    info.origin = file;
    std::cout << node_help(info);
    return 0;
}

void write_pages(const std::string& folder)
{
    std::error_code status;
    std::filesystem::create_directories(folder, status);
    if (status) throw OutputError("'" + folder + "' cannot be made: " + status.message());
    const auto nodes = Registry::instance().all();
    write_text_file(folder + "/README.md", node_index(nodes));
    for (const NodeInfo* node : nodes)
        write_text_file(folder + "/" + node->name + ".md", node_page(*node));
    std::cout << nodes.size() << " pages and README.md in " << folder << "\n";
}

struct DocsArguments {
    std::string folder, manual, completion;
};

int write_docs(const CLI::App& app, const DocsArguments& arguments)
{
    if (arguments.folder.empty() && arguments.manual.empty() && arguments.completion.empty())
        throw UsageError("docs wants --out DIR, --man FILE or --completion FILE");
    if (!arguments.folder.empty()) write_pages(arguments.folder);
    if (!arguments.manual.empty()) write_text_file(arguments.manual, manual_page(app));
    if (!arguments.completion.empty()) write_text_file(arguments.completion, bash_completion(app));
    return 0;
}

} // namespace

void add_node_commands(CLI::App& app, Action& action)
{
    app.add_subcommand("nodes", "List the nodes")->callback([&action] { action = list_nodes; });

    CLI::App* help_command = app.add_subcommand("help", "Explain a node, a graph or a command");
    auto op = std::make_shared<std::string>();
    help_command->add_option("op", *op, "Name of a node, a graph or a command")->type_name("NAME");
    help_command->callback([op, &app, &action] { action = [op, &app] { return help(app, *op); }; });

    CLI::App* docs_command =
        app.add_subcommand("docs", "Write the reference pages of all nodes, or the manual page");
    auto docs = std::make_shared<DocsArguments>();
    docs_command->add_option("--out", docs->folder, "Folder for the pages")->type_name("DIR");
    docs_command->add_option("--man", docs->manual, "File for the manual page")->type_name("FILE");
    docs_command->add_option("--completion", docs->completion, "File for the completion of bash")
        ->type_name("FILE");
    docs_command->callback(
        [docs, &app, &action] { action = [docs, &app] { return write_docs(app, *docs); }; });

    app.add_subcommand("schema", "Print the JSON schema of graph files, for editors")
        ->callback([&action] {
            action = [] {
                std::cout << graph_schema() << "\n";
                return 0;
            };
        });
}

} // namespace rayloom::cli
