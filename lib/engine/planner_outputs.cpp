// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/planner.h"

#include "rayloom/core/text.h"
#include "rayloom/engine/engine_nodes.h"
#include "rayloom/image/atomic_file.h"
#include "rayloom/image/renderer_map.h"

#include <algorithm>
#include <filesystem>
#include <set>

namespace rayloom::planning
{

namespace
{

/// "out.exr" → "out.3.exr": the files of a list output.
std::string numbered_path(const std::string& path, std::size_t index)
{
    const std::size_t dot = path.rfind('.');
    const std::size_t slash = path.find_last_of('/');
    const std::string number = "." + std::to_string(index);
    if (dot == std::string::npos || (slash != std::string::npos && dot < slash))
        return path + number;
    return path.substr(0, dot) + number + path.substr(dot);
}

void check_figures_path(const std::string& output, const std::string& path)
{
    if (!path.ends_with(".json") && !path.starts_with("/dev/"))
        throw UsageError("output '" + output +
                         "' is figures, which are written as JSON; name a .json file, not '" +
                         path + "'");
    check_text_writable(path);
}

} // namespace

void Planner::add_output(const GraphOutput& declared, const OutputBinding* binding,
                         const Value& value)
{
    const bool deep = value.kind == PortKind::deep;
    const std::string port = deep ? "deep" : "image";
    PlannedOutput out;
    out.name = declared.name;
    out.deep = deep;
    if (binding) out.binding = *binding;
    if (value.kind == PortKind::table) {
        if (!out.binding.path.empty()) check_figures_path(declared.name, out.binding.path);
        for (std::size_t i = 0; i < value.tables.size(); ++i) {
            PlannedOutput table = out;
            table.table_op = value.tables[i].op;
            table.table_port = value.tables[i].port;
            if (value.list && !out.binding.path.empty())
                table.binding.path = numbered_path(out.binding.path, i);
            m_plan.outputs.push_back(std::move(table));
        }
        return;
    }
    for (std::size_t i = 0; i < value.streams.size(); ++i) {
        PlannedOutput image = out;
        if (value.list && !out.binding.path.empty() && value.streams.size() > 1)
            image.binding.path = numbered_path(out.binding.path, i);
        Value one;
        one.kind = value.kind;
        one.streams = {value.streams[i]};
        const std::size_t before = m_plan.items.size();
        if (image.binding.path.empty()) {
            image.in_memory = true;
            NewOp sink;
            sink.id = declared.name;
            sink.name = "memory";
            sink.role = OpRole::output;
            sink.where = declared.where;
            if (deep)
                sink.node = std::make_unique<MemoryDeepSink>();
            else
                sink.node = std::make_unique<MemorySink>();
            sink.inputs = {{port, value.kind, true, ""}};
            sink.arguments[port] = one;
            sink.crop = m_request.roi;
            add_op(std::move(sink));
        } else {
            ParamValues params;
            params["path"] = image.binding.path;
            params["type"] = image.binding.type;
            params["compression"] = image.binding.compression;
            params["layer"] = image.binding.layer;
            if (!deep)
                params["template"] = image.binding.pass_through_from;
            else if (!image.binding.pass_through_from.empty())
                throw UsageError("output '" + declared.name +
                                 "' is a deep image, and no other layers can be kept beside it; "
                                 "write it in a run without --pass-through");
            add_node_op(OpRole::output, declared.name, deep ? "io.write_deep" : "io.write",
                        std::move(params), {{port, one}}, declared.where, m_request.roi);
        }
        if (m_plan.items.size() > before)
            image.sink_item = static_cast<int>(m_plan.items.size()) - 1;
        m_plan.outputs.push_back(std::move(image));
    }
}

void Planner::plan_outputs(const Graph& graph, Scope& scope)
{
    std::vector<std::string> names;
    for (const GraphOutput& output : graph.outputs) names.push_back(output.name);
    for (const auto& [name, binding] : m_request.outputs)
        if (!graph.output(name))
            throw UsageError("graph '" + graph.name + "' has no output '" + name + "'" +
                             suggestion(name, names));
    for (const GraphOutput& output : graph.outputs) {
        const auto binding = m_request.outputs.find(output.name);
        if (!m_request.outputs.empty() && binding == m_request.outputs.end()) continue;
        const Value value = lookup(scope, output.stream);
        if (value.broken) continue;
        if (value.absent) {
            if (binding != m_request.outputs.end())
                problem(output.where,
                        "output '" + output.name +
                            "' cannot be made: what it comes from is not there with these inputs");
            continue;
        }
        if (m_request.roi && value.kind != PortKind::table)
            for (const int s : value.streams)
                if (m_plan.streams[static_cast<std::size_t>(s)]
                        .desc.data.intersect(*m_request.roi)
                        .empty())
                    throw UsageError("the region of interest " + m_request.roi->text() +
                                     " lies outside output '" + output.name + "' (" +
                                     m_plan.streams[static_cast<std::size_t>(s)].desc.data.text() +
                                     ")");
        add_output(output, binding == m_request.outputs.end() ? nullptr : &binding->second, value);
    }
    add_writing_nodes();
    refuse_shared_files();
}

void Planner::add_writing_nodes()
{
    for (std::size_t i = 0; i < m_plan.items.size(); ++i) {
        const PlannedOp& op = m_plan.ops[static_cast<std::size_t>(m_plan.items[i].op)];
        if (op.role != OpRole::node || !op.result.sink) continue;
        PlannedOutput file;
        file.name = op.id;
        file.sink_item = static_cast<int>(i);
        if (const auto path = op.params.find("path"); path != op.params.end())
            if (const auto* text = std::get_if<std::string>(&path->second))
                file.binding.path = *text;
        m_plan.outputs.push_back(std::move(file));
    }
}

void Planner::refuse_shared_files() const
{
    namespace fs = std::filesystem;
    std::map<fs::path, std::string> writers;
    for (const PlannedOutput& out : m_plan.outputs) {
        if (out.binding.path.empty()) continue;
        std::error_code unknown;
        if (fs::is_other(out.binding.path, unknown)) continue; // /dev/null and its like
        const fs::path absolute = fs::absolute(out.binding.path, unknown);
        fs::path file = fs::weakly_canonical(absolute, unknown);
        if (unknown) file = absolute.lexically_normal();
        const bool node = out.sink_item >= 0 &&
                          m_plan.ops[static_cast<std::size_t>(
                                         m_plan.items[static_cast<std::size_t>(out.sink_item)].op)]
                                  .role == OpRole::node;
        const std::string title = (node ? "node '" : "output '") + out.name + "'";
        const auto [first, fresh] = writers.emplace(file, title);
        if (!fresh)
            throw UsageError(first->second + " and " + title + " would both be written to '" +
                             out.binding.path +
                             "'; give each a file of its own (transform.merge_layers puts several "
                             "images into one)");
    }
}

namespace
{

/// What an input's layer is for, by its role.
const char* use_of(const std::string& role)
{
    for (const char* guide : {"albedo", "normal", "depth", "position", "object_id", "material_id",
                              "cryptomatte", "motion", "flash"})
        if (role == guide) return "used as guide";
    for (const char* statistics : {"variance", "count", "histogram", "covariance"})
        if (role == statistics) return "used as statistics";
    return "filtered";
}

} // namespace

void Planner::describe_files(const Graph& graph)
{
    // A line per layer of every input file; a list is described by its first file.
    std::set<std::string> handed_on;
    for (const PlannedOutput& out : m_plan.outputs)
        if (!out.binding.pass_through_from.empty()) handed_on.insert(out.binding.pass_through_from);
    std::map<std::string, std::map<std::string, std::string>> uses; // file → layer → use
    std::map<std::string, std::size_t> more;
    std::vector<std::string> order;
    for (const GraphInput& input : graph.inputs) {
        const auto given = m_request.inputs.find(input.name);
        if (given == m_request.inputs.end() || given->second.files.empty()) continue;
        const InputFile& file = given->second.files.front();
        if (!uses.contains(file.path)) order.push_back(file.path);
        more[file.path] = given->second.files.size() - 1;
        const auto opened = ImageFile::open(file.path);
        ChannelRequest wanted;
        wanted.layer = file.layer;
        wanted.role = input.role;
        wanted.channels = input.channels;
        uses[file.path][choose_channels(*opened, wanted).layer] =
            std::string(use_of(input.role)) + " (input '" + input.name + "')";
    }
    for (const std::string& path : handed_on)
        if (uses.emplace(path, std::map<std::string, std::string>{}).second) order.push_back(path);
    for (const std::string& path : order) {
        const std::string rest = handed_on.contains(path) ? "passed through" : "not read";
        std::size_t others = 0;
        const std::string files =
            path +
            (more[path] > 0 ? " and " + std::to_string(more[path]) + " more" : std::string());
        const std::shared_ptr<const ImageFile> opened = ImageFile::open(path);
        for (const LayerInfo& layer : opened->layers()) {
            const auto use = uses[path].find(layer.address());
            if (use != uses[path].end()) {
                m_plan.channel_plan.push_back(
                    files + ": " +
                    (layer.address().empty() ? "(plain channels)" : layer.address()) + ": " +
                    use->second);
                uses[path].erase(use);
            } else if (rest == "not read") {
                ++others;
            } else {
                m_plan.channel_plan.push_back(
                    files + ": " +
                    (layer.address().empty() ? "(plain channels)" : layer.address()) + ": " + rest);
            }
        }
        // Selections that are no single layer: a whole part, one channel.
        for (const auto& [layer, use] : uses[path])
            m_plan.channel_plan.push_back(files + ": " +
                                          (layer.empty() ? "(all channels)" : layer) + ": " + use);
        if (others > 0)
            m_plan.channel_plan.push_back(files + ": " + std::to_string(others) + " other layer" +
                                          (others == 1 ? "" : "s") + ": not read");
    }
}

} // namespace rayloom::planning
