// SPDX-License-Identifier: Apache-2.0
#include "rayloom/cli/command.h"
#include "rayloom/core/error.h"
#include "rayloom/engine/cache.h"
#include "rayloom/graph/picture.h"
#include "rayloom/graph/reader.h"

#include <iostream>
#include <memory>

namespace rayloom::cli
{

namespace
{

int check(const std::vector<std::string>& files)
{
    int exit_code = 0;
    for (const std::string& file : files) {
        try {
            const Graph graph = read_graph(find_graph(file));
            for (const Problem& warning : graph.warnings)
                std::cerr << warning.text() << " (a warning)\n";
            std::cout << file << ": a graph of " << graph.nodes.size()
                      << " nodes, no mistake found\n";
        } catch (const Error& e) {
            std::cerr << e.what() << "\n";
            exit_code = std::max(exit_code, e.exit_code());
        }
    }
    return exit_code;
}

int picture(const std::string& file, const std::string& out)
{
    const bool svg = out.ends_with(".svg");
    if (!out.empty() && !svg && !out.ends_with(".dot") && !out.ends_with(".gv"))
        throw UsageError("a picture of a graph is .svg or .dot, not '" + out + "'");
    const Graph graph = read_graph(find_graph(file));
    const std::string text = svg ? graph_svg(graph) : graph_dot(graph);
    if (out.empty())
        std::cout << text;
    else
        write_text_file(out, text);
    return 0;
}

} // namespace

void add_graph_commands(CLI::App& app, Action& action)
{
    CLI::App* check_command =
        app.add_subcommand("check", "Find every mistake in graph files, running nothing");
    auto files = std::make_shared<std::vector<std::string>>();
    check_command->add_option("graphs", *files, "Graph files")->required()->type_name("GRAPH");
    check_command->callback([files, &action] { action = [files] { return check(*files); }; });

    CLI::App* picture_command =
        app.add_subcommand("picture", "Draw a graph as DOT (default) or SVG");
    struct Picture {
        std::string graph, out;
    };
    auto arguments = std::make_shared<Picture>();
    picture_command->add_option("graph", arguments->graph, "Graph file")
        ->required()
        ->type_name("GRAPH");
    picture_command
        ->add_option("-o,--output", arguments->out,
                     "File, .svg or .dot; default DOT to the terminal")
        ->type_name("FILE");
    picture_command->callback([arguments, &action] {
        action = [arguments] { return picture(arguments->graph, arguments->out); };
    });
}

} // namespace rayloom::cli
