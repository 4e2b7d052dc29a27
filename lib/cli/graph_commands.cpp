// SPDX-License-Identifier: Apache-2.0
#include "rayloom/cli/command.h"
#include "rayloom/core/error.h"
#include "rayloom/core/text.h"
#include "rayloom/graph/picture.h"
#include "rayloom/graph/reader.h"
#include "rayloom/image/atomic_file.h"
#include "rayloom/image/renderer_map.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <memory>

namespace rayloom::cli
{

namespace
{

const char* kind_name(PortKind kind)
{
    switch (kind) {
    case PortKind::image: return "image";
    case PortKind::list: return "list";
    case PortKind::deep: return "deep";
    case PortKind::table: return "table";
    }
    return "";
}

/// What a program must know to run a graph on files of its own.
std::string interface_json(const Graph& graph)
{
    std::string inputs, outputs, params;
    for (const GraphInput& input : graph.inputs)
        inputs += std::string(inputs.empty() ? "" : ", ") + "{\"name\": " + json_quote(input.name) +
                  ", \"kind\": " + json_quote(kind_name(input.kind)) +
                  ", \"required\": " + (input.required ? "true" : "false") +
                  ", \"channels\": " + json_quote(input.channels) +
                  ", \"role\": " + json_quote(input.role) + ", \"doc\": " + json_quote(input.doc) +
                  "}";
    for (const GraphOutput& output : graph.outputs)
        outputs += std::string(outputs.empty() ? "" : ", ") +
                   "{\"name\": " + json_quote(output.name) +
                   ", \"kind\": " + (output.kind ? json_quote(kind_name(*output.kind)) : "null") +
                   ", \"doc\": " + json_quote(output.doc) + "}";
    for (const GraphParam& param : graph.params)
        params += std::string(params.empty() ? "" : ", ") +
                  "{\"name\": " + json_quote(param.info.name) +
                  ", \"type\": " + json_quote(param_type_name(param.info.type)) +
                  ", \"required\": " + (param.info.required ? "true" : "false") +
                  ", \"default\": " + json_quote(format_param(param.info.default_value)) +
                  ", \"doc\": " + json_quote(param.info.doc) + "}";
    return "{\"file\": " + json_quote(graph.file) + ", \"graph\": " + json_quote(graph.name) +
           ", \"doc\": " + json_quote(graph.doc) +
           ", \"nodes\": " + std::to_string(graph.nodes.size()) + ",\n \"inputs\": [" + inputs +
           "],\n \"outputs\": [" + outputs + "],\n \"params\": [" + params + "]}";
}

/// Whether a file is a renderer map: it begins with its renderer's name where a graph says
/// `rayloom: 1`.
bool is_renderer_map(const std::string& path)
{
    std::ifstream file(path);
    for (std::string line; std::getline(file, line);)
        if (line.starts_with("renderer:")) return true;
    return false;
}

int check(const std::vector<std::string>& files, bool json)
{
    int exit_code = 0;
    for (const std::string& file : files) {
        try {
            if (is_renderer_map(file)) {
                const RendererMap map = RendererMap::read(file);
                if (!json)
                    std::cout << file << ": a renderer map for " << map.name()
                              << ", no mistake found\n";
                continue;
            }
            const Graph graph = read_graph(find_graph(file));
            for (const Problem& warning : graph.warnings)
                std::cerr << warning.text() << " (a warning)\n";
            if (json) {
                std::cout << interface_json(graph) << "\n";
                continue;
            }
            std::cout << file << ": a graph of " << graph.nodes.size()
                      << (graph.nodes.size() == 1 ? " node" : " nodes") << ", no mistake found\n";
        } catch (const Error& e) {
            std::cerr << e.what() << "\n";
            exit_code = std::max(exit_code, e.exit_code());
        }
    }
    return exit_code;
}

int list_graphs()
{
    for (const std::string& name : graph_names()) {
        std::string doc;
        try {
            doc = read_graph(find_graph(name)).doc;
            doc.resize(std::min(doc.find(". "), doc.size()));
            if (doc.ends_with('.')) doc.pop_back();
        } catch (const Error&) {
            doc = "cannot be read; 'rayloom check " + name + "' says why";
        }
        std::printf("%-28s %s\n", name.c_str(), doc.c_str());
    }
    return 0;
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
    CLI::App* check_command = app.add_subcommand(
        "check", "Find every mistake in graph files and renderer maps, running nothing");
    struct Check {
        std::vector<std::string> files;
        bool json = false;
    };
    auto checked = std::make_shared<Check>();
    check_command->add_option("graphs", checked->files, "Graph files or renderer maps")
        ->required()
        ->type_name("GRAPH");
    check_command->add_flag("--json", checked->json,
                            "Print inputs, outputs and parameters of each graph as JSON");
    check_command->callback([checked, &action] {
        action = [checked] { return check(checked->files, checked->json); };
    });

    app.add_subcommand("graphs", "List the graphs that are found by name")->callback([&action] {
        action = list_graphs;
    });

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
