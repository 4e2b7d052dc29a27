// SPDX-License-Identifier: Apache-2.0
#include "rayloom/cli/command.h"
#include "rayloom/cli/request_options.h"
#include "rayloom/core/text.h"
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"

#include <cstdio>
#include <iostream>
#include <memory>
#include <optional>
#include <set>
#include <string>

namespace rayloom::cli
{

namespace
{

const char* how(const WorkItem& item, const PlannedOp& op)
{
    if (item.lent) return "in memory";
    if (item.in_place >= 0) return "in place, on the rows just read";
    if (item.source) return "from the cache";
    if (op.result.sink) return "written row by row";
    if (op.result.access == Access::rows) return "read row by row";
    if (op.result.access == Access::whole) return "whole image at once";
    return item.deep ? "whole rows" : item.inlined ? "tiles, inside its reader's" : "tiles";
}

/// One line of the table; the elements of a list that are alike share one.
struct Line {
    std::string id;
    std::optional<std::size_t> first, last; ///< elements
    std::string op, rest;
};

Line line_of(const Plan& plan, const WorkItem& item)
{
    const PlannedOp& op = plan.ops[static_cast<std::size_t>(item.op)];
    Line line;
    line.id = op.id;
    line.op = op.op;
    // An op makes several elements, or is one of those that a mapped node became: "fused[1]".
    if (const auto& outs = op.result.outputs; !outs.empty() && outs.begin()->second.size() > 1) {
        line.first = line.last = item.element;
    } else if (const std::size_t at = op.id.rfind('['); op.id.ends_with(']')) {
        line.first = line.last = std::stoul(op.id.substr(at + 1));
        line.id = op.id.substr(0, at);
    }
    int channels = 0;
    for (const WorkItem::Output& out : item.outputs)
        if (out.wanted)
            channels += plan.streams[static_cast<std::size_t>(out.stream)].desc.channel_count();
    char text[96];
    std::snprintf(text, sizeof text, "%-20s %9d  %s", item.window.text().c_str(), channels,
                  how(item, op));
    line.rest = text;
    return line;
}

void print_items(const Plan& plan)
{
    std::printf("%-32s %-22s %-20s %9s  %s\n", "node", "op", "window", "channels", "how");
    const auto print = [](const Line& line) {
        std::string id = line.id;
        if (line.first)
            id += "[" + std::to_string(*line.first) +
                  (line.first == line.last ? "" : "-" + std::to_string(*line.last)) + "]";
        std::printf("%-32s %-22s %s\n", id.c_str(), line.op.c_str(), line.rest.c_str());
    };
    std::optional<Line> open;
    for (const WorkItem& item : plan.items) {
        if (!item.needed) continue;
        const Line line = line_of(plan, item);
        if (open && open->last && line.first == *open->last + 1 && line.id == open->id &&
            line.op == open->op && line.rest == open->rest) {
            open->last = line.last;
            continue;
        }
        if (open) print(*open);
        open = line;
    }
    if (open) print(*open);
}

int show_plan(const RequestOptions& arguments)
{
    const Graph graph = read_graph(find_graph(arguments.graph));
    const RunOptions options = arguments.run_options();
    const Plan plan =
        make_plan(graph, arguments.request(graph, arguments.frame_list().front()), options);
    const Schedule schedule = make_schedule(plan, options);
    for (const std::string& line : plan.channel_plan) std::cout << line << "\n";
    print_items(plan);
    for (const PlannedOp& op : plan.ops)
        if (op.needed && op.result.reduction)
            std::printf("%-32s %-22s %-20s %9s  %s\n", op.id.c_str(), op.op.c_str(),
                        op.result.reduction->domain.text().c_str(), "",
                        op.cached_totals ? "sums over the image, from the cache"
                                         : "sums over the image first");
    std::set<std::string> said;
    for (const PrunedNode& p : plan.pruned)
        if (said.insert(p.id).second) std::cout << "skipped: " << p.id << ": " << p.reason << "\n";
    for (const std::string& note : plan.notes) std::cout << "note: " << note << "\n";
    std::printf(
        "%zu sweep%s of %d strip%s, tiles %dx%d, %d thread%s; at most %s of pixels in memory\n",
        schedule.sweeps.size(), schedule.sweeps.size() == 1 ? "" : "s", schedule.strips,
        schedule.strips == 1 ? "" : "s", schedule.tile_width, schedule.tile_height,
        schedule.threads, schedule.threads == 1 ? "" : "s",
        format_bytes(schedule.peak_bytes).c_str());
    return 0;
}

} // namespace

void add_plan(CLI::App& app, Action& action)
{
    CLI::App* command = app.add_subcommand(
        "plan", "Show what a run would do: nodes, what is skipped and why, memory");
    auto arguments = std::make_shared<RequestOptions>();
    arguments->add_to(*command);
    command->callback(
        [arguments, &action] { action = [arguments] { return show_plan(*arguments); }; });
}

} // namespace rayloom::cli
