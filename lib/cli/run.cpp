// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/run.h"
#include "rayloom/cli/command.h"
#include "rayloom/cli/progress.h"
#include "rayloom/cli/request_options.h"
#include "rayloom/cli/stop_signals.h"
#include "rayloom/core/error.h"
#include "rayloom/core/text.h"
#include "rayloom/engine/cache.h"
#include "rayloom/graph/reader.h"

#include <cstdio>
#include <filesystem>
#include <iostream>
#include <memory>

namespace rayloom::cli
{

namespace
{

struct RunArguments {
    RequestOptions request;
    std::string stats, cache_size;
    bool quiet = false, update = false, keep_going = false;
};

/// Whether every output is there and newer than every input.
bool up_to_date(const RunRequest& request)
{
    namespace fs = std::filesystem;
    if (request.outputs.empty()) return false; // what nodes of the graph write is not known here
    std::error_code status;
    fs::file_time_type oldest = fs::file_time_type::max();
    for (const auto& [name, output] : request.outputs) {
        const auto time = fs::last_write_time(output.path, status);
        if (status) return false;
        oldest = std::min(oldest, time);
    }
    for (const auto& [name, input] : request.inputs)
        for (const InputFile& file : input.files) {
            const auto time = fs::last_write_time(file.path, status);
            if (status || time > oldest) return false;
        }
    return true;
}

int run(const RunArguments& arguments)
{
    Graph graph = read_graph(find_graph(arguments.request.graph));
    std::vector<std::string> names;
    for (const GraphOutput& output : graph.outputs) names.push_back(output.name);
    // Without -o the files are those that nodes of the graph write.
    if (arguments.request.outputs.empty()) graph.outputs.clear();
    const auto frames = arguments.request.frame_list();
    const std::size_t cache_bytes =
        arguments.cache_size.empty() ? usual_cache_bytes : parse_bytes(arguments.cache_size);
    const StopSignals signals;
    int exit_code = 0;
    std::string all_stats;
    for (std::size_t i = 0; i < frames.size(); ++i) {
        const std::string title = frames[i] ? "frame " + std::to_string(*frames[i]) : "";
        try {
            const RunRequest request = arguments.request.request(graph, frames[i]);
            if (arguments.update && up_to_date(request)) {
                if (!arguments.quiet)
                    std::cerr << title << (title.empty() ? "" : ": ") << "up to date\n";
                continue;
            }
            RunOptions options = arguments.request.run_options();
            options.stop = signals.token();
            std::unique_ptr<Progress> progress;
            if (!arguments.quiet) {
                progress = std::make_unique<Progress>(title, i, frames.size());
                options.progress = [&](double share) { progress->show(share); };
            }
            Plan plan = make_plan(graph, request, options);
            if (plan.outputs.empty())
                throw UsageError("nothing would be written; did you forget -o? The graph makes " +
                                 join_names(names, true));
            // The patterns of -o are checked before; a path inside the graph has no frame.
            for (const PlannedOutput& out : plan.outputs)
                if (frames.size() > 1 && !request.outputs.contains(out.name))
                    throw UsageError(
                        "node '" + out.name + "' would write '" + out.binding.path +
                        "' again for every frame; make it an output and name it with -o");
            if (!arguments.quiet && i == 0)
                for (const std::string& line : plan.channel_plan) progress->message(line);
            const RunReport report = run_plan(plan, options);
            progress.reset();
            if (!options.cache_folder.empty()) trim_cache(options.cache_folder, cache_bytes);
            // Pixels that are not what was asked for are said even to those who asked for quiet.
            for (const NodeReport& node : report.nodes)
                for (const auto& [what, count] : node.counts)
                    std::cerr << "warning: " << title << (title.empty() ? "" : ": ") << "node '"
                              << node.id << "' (" << node.op << "): " << what << ": " << count
                              << "\n";
            for (const auto& [name, tables] : report.tables)
                if (!arguments.quiet && arguments.stats != "json")
                    for (const Table& table : tables)
                        std::cout << name << ": " << table.json() << "\n";
            if (!arguments.quiet)
                for (const std::string& file : report.written)
                    std::fprintf(stderr, "wrote %s (%.2f s)\n", file.c_str(), report.seconds);
            if (arguments.stats == "text") std::cout << report.text();
            if (arguments.stats == "json") std::cout << report.json() << "\n";
        } catch (const Cancelled&) {
            throw;
        } catch (const Error& e) {
            // One bad frame does not end the others when asked so; the exit code tells.
            if (!arguments.keep_going || frames.size() == 1) throw;
            std::cerr << "rayloom: " << title << ": " << e.what() << "\n";
            exit_code = e.exit_code();
        }
    }
    return exit_code;
}

} // namespace

void add_run(CLI::App& app, Action& action)
{
    CLI::App* command = app.add_subcommand("run", "Run a graph");
    auto arguments = std::make_shared<RunArguments>();
    arguments->request.add_to(*command);
    command
        ->add_flag("--stats{text}", arguments->stats,
                   "Print times, memory and skips; --stats=json for programs")
        ->check(CLI::IsMember({"text", "json"}));
    command
        ->add_option(
            "--cache-size", arguments->cache_size,
            "What --cache may hold, e.g. 500M; default 20G. What was unused for longest goes")
        ->type_name("SIZE");
    command->add_flag("-q,--quiet", arguments->quiet, "Print errors and warnings only");
    command->add_flag("-u,--update", arguments->update,
                      "Leave frames alone whose outputs are newer than their inputs");
    command->add_flag("--keep-going", arguments->keep_going,
                      "Go on with the next frame after an error");
    command->callback([arguments, &action] { action = [arguments] { return run(*arguments); }; });
}

} // namespace rayloom::cli
