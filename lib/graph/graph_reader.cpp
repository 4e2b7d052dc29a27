// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/graph_reader.h"

#include "rayloom/core/text.h"
#include "rayloom/graph/names.h"
#include "rayloom/image/frames.h"

#include <algorithm>

namespace rayloom::reading
{

namespace
{

constexpr std::size_t max_expanded_nodes = 10'000;

const std::vector<std::string> top_keys{"rayloom", "name",  "doc",    "params",
                                        "inputs",  "nodes", "outputs"};
const std::vector<std::string> input_keys{"doc",      "channels", "kind",      "list",
                                          "optional", "role",     "neighbours"};
const std::vector<std::string> output_keys{"from", "doc"};
const std::vector<std::string> input_kinds{"image", "list", "deep"};

} // namespace

void GraphReader::read(const Value& root)
{
    if (!root.is_mapping()) {
        problem(root.where,
                "a graph is a mapping that begins with 'rayloom: 1', this is " + root.describe());
        return;
    }
    check_version(root);
    for (const Entry& entry : root.entries) read_section(entry);
    if (!root.find("nodes") && !root.find("outputs"))
        problem({m_graph.file, 0, 0}, "the graph has no nodes and no outputs");
    check_name_clashes();
    check_neighbours();
    resolve_ops();
    resolve_nodes();
    find_cycles();
    infer_shapes();
    resolve_outputs(root);
    warn_unused();
    count_expanded();
}

bool GraphReader::unknown_key(const Entry& entry, const std::vector<std::string>& known,
                              const std::string& what)
{
    if (std::find(known.begin(), known.end(), entry.key) != known.end()) return false;
    std::string message = what + "'" + entry.key + "' is not a key here";
    message += suggestion(entry.key, known);
    // `{doc: noisy, linear}`: what stands behind the comma is read as one more key.
    if (entry.value->is_null()) message += "; a text with a comma in it needs quotes";
    problem(entry.where, message);
    return true;
}

std::optional<std::string> GraphReader::text_of(const Entry& entry, const std::string& what)
{
    if (entry.value->is_scalar()) return entry.value->text;
    problem(entry.value->where,
            what + "'" + entry.key + "' wants text, this is " + entry.value->describe());
    return std::nullopt;
}

std::optional<bool> GraphReader::truth_of(const Entry& entry, const std::string& what)
{
    if (entry.value->is_scalar() && !entry.value->quoted) {
        const ParamValue value = plain_scalar(entry.value->text);
        if (const bool* truth = std::get_if<bool>(&value)) return *truth;
    }
    problem(entry.value->where,
            what + "'" + entry.key + "' wants true or false, this is " + entry.value->describe());
    return std::nullopt;
}

std::optional<double> GraphReader::number_of(const Entry& entry, const std::string& what)
{
    if (entry.value->is_scalar() && !entry.value->quoted) {
        const ParamValue value = plain_scalar(entry.value->text);
        if (const auto* whole = std::get_if<std::int64_t>(&value))
            return static_cast<double>(*whole);
        if (const auto* real = std::get_if<double>(&value); real && *real == *real) return *real;
    }
    problem(entry.value->where,
            what + "'" + entry.key + "' wants a number, this is " + entry.value->describe());
    return std::nullopt;
}

bool GraphReader::check_name(const std::string& name, const SourcePosition& where,
                             const std::string& what)
{
    if (!is_graph_name(name)) {
        problem(where, what + " name '" + name +
                           "' must be letters, digits, '_' and '-', beginning with a letter");
        return false;
    }
    return true;
}

bool GraphReader::reserved(const std::string& name, const SourcePosition& where,
                           const std::string& what)
{
    if (std::find(node_keys.begin(), node_keys.end(), name) == node_keys.end()) return false;
    problem(where, what + " cannot be named '" + name + "', a word of the format");
    return true;
}

void GraphReader::each_entry(const Entry& section,
                             const std::function<void(const Entry&)>& read_entry)
{
    if (section.value->is_null()) return;
    if (!section.value->is_mapping()) {
        problem(section.value->where, "'" + section.key + "' wants a mapping of names, this is " +
                                          section.value->describe());
        return;
    }
    for (const Entry& entry : section.value->entries) read_entry(entry);
}

void GraphReader::check_version(const Value& root)
{
    const Entry* entry = root.find("rayloom");
    if (!entry) {
        problem(root.where,
                "the version of the format is missing; a graph begins with 'rayloom: 1'");
        return;
    }
    const Value& value = *entry->value;
    const ParamValue version =
        value.is_scalar() && !value.quoted ? plain_scalar(value.text) : ParamValue(false);
    const auto* number = std::get_if<std::int64_t>(&version);
    if (!number)
        problem(value.where,
                "'rayloom' is the version of the format, 1; this is " + value.describe());
    else if (*number != 1)
        problem(value.where,
                "this is version " + value.text + " of the format; this rayloom reads version 1");
}

void GraphReader::read_section(const Entry& entry)
{
    if (entry.key == "rayloom" || entry.key.starts_with("x-")) return;
    if (unknown_key(entry, top_keys, "")) return;
    if (entry.key == "name" || entry.key == "doc") {
        if (const auto text = text_of(entry, ""))
            (entry.key == "name" ? m_graph.name : m_graph.doc) = *text;
    } else if (entry.key == "params") {
        each_entry(entry, [this](const Entry& e) { read_param(e); });
    } else if (entry.key == "inputs") {
        each_entry(entry, [this](const Entry& e) { read_input(e); });
    } else if (entry.key == "nodes") {
        each_entry(entry, [this](const Entry& e) { read_node(e); });
    }
    // Outputs are read last: they need to know what the nodes give.
}

void GraphReader::read_input(const Entry& entry)
{
    if (!check_name(entry.key, entry.where, "input") ||
        reserved(entry.key, entry.where, "an input"))
        return;
    const std::string what = "input '" + entry.key + "': ";
    GraphInput input;
    input.name = entry.key;
    input.where = entry.where;
    const Value& value = *entry.value;
    if (value.is_scalar()) {
        input.doc = value.text;
    } else if (value.is_mapping()) {
        for (const Entry& e : value.entries)
            if (!unknown_key(e, input_keys, what)) read_input_key(input, e, what);
        if (value.find("kind") && value.find("list"))
            problem(value.find("list")->where,
                    what + "'list: true' says the same as 'kind: list'; keep one");
    } else if (!value.is_null()) {
        problem(value.where, what + "wants a mapping or a text, this is " + value.describe());
    }
    m_graph.inputs.push_back(std::move(input));
}

void GraphReader::read_input_key(GraphInput& input, const Entry& entry, const std::string& what)
{
    if (entry.key == "doc" || entry.key == "role") {
        if (const auto text = text_of(entry, what))
            (entry.key == "doc" ? input.doc : input.role) = *text;
    } else if (entry.key == "channels") {
        read_channels(input, entry, what);
    } else if (entry.key == "kind") {
        const auto text = text_of(entry, what);
        if (!text) return;
        if (*text == "image")
            input.kind = PortKind::image;
        else if (*text == "list")
            input.kind = PortKind::list;
        else if (*text == "deep")
            input.kind = PortKind::deep;
        else
            problem(entry.value->where,
                    what + "kind '" + *text + "' is not known" + suggestion(*text, input_kinds));
    } else if (entry.key == "neighbours") {
        read_neighbours(input, entry, what);
    } else if (entry.key == "list") {
        if (truth_of(entry, what).value_or(false)) input.kind = PortKind::list;
    } else {
        input.required = !truth_of(entry, what).value_or(false);
    }
}

void GraphReader::read_neighbours(GraphInput& input, const Entry& entry, const std::string& what)
{
    const auto text = text_of(entry, what);
    if (!text) return;
    const std::size_t at = text->rfind('@');
    try {
        const auto frames = at == std::string::npos
                                ? std::nullopt
                                : parse_relative_frames(std::string_view(*text).substr(at + 1));
        if (!frames) throw UsageError("'neighbours' wants input@-5..-1, this is '" + *text + "'");
        input.neighbours = {text->substr(0, at), frames->first, frames->last, entry.value->where};
    } catch (const UsageError& error) {
        problem(entry.value->where, what + error.what());
    }
}

void GraphReader::read_channels(GraphInput& input, const Entry& entry, const std::string& what)
{
    if (!entry.value->is_sequence()) {
        if (const auto text = text_of(entry, what)) input.channels = *text;
        return;
    }
    std::string channels;
    for (const auto& item : entry.value->items) {
        if (!item->is_scalar()) {
            problem(item->where, what + "a channel is a name, this is " + item->describe());
            return;
        }
        channels += (channels.empty() ? "" : ",") + item->text;
    }
    input.channels = channels;
}

void GraphReader::check_name_clashes()
{
    for (const GraphNode& node : m_graph.nodes)
        if (const GraphInput* input = m_graph.input(node.id))
            problem(node.where, "node '" + node.id + "' has the name of an input (line " +
                                    std::to_string(input->where.line) + ")");
    for (const GraphInput& input : m_graph.inputs)
        if (const GraphParam* param = m_graph.param(input.name))
            problem(input.where, "input '" + input.name + "' has the name of a parameter (line " +
                                     std::to_string(param->where.line) + ")");
}

void GraphReader::check_neighbours()
{
    for (const GraphInput& input : m_graph.inputs) {
        if (!input.neighbours) continue;
        const std::string what = "input '" + input.name + "': ";
        if (!m_graph.input(input.neighbours->input))
            problem(input.neighbours->where,
                    what + "there is no input '" + input.neighbours->input + "'" +
                        suggestion(
                            input.neighbours->input,
                            names_of(m_graph.inputs, [](const GraphInput& i) { return i.name; })));
        if (input.kind != PortKind::list || input.required)
            problem(input.neighbours->where,
                    what + "neighbours are as many as there are, so it must be a list and "
                           "optional");
    }
}

void GraphReader::resolve_outputs(const Value& root)
{
    if (const Entry* section = root.find("outputs"))
        each_entry(*section, [this](const Entry& e) { read_output(e); });
    const bool sinks = std::any_of(m_trees.begin(), m_trees.end(), [](const NodeTree& tree) {
        return !tree.info || tree.info->outputs.empty();
    });
    const bool misspelt =
        std::any_of(root.entries.begin(), root.entries.end(), [](const Entry& entry) {
            return entry.key != "outputs" && closest_name(entry.key, top_keys) == "outputs";
        });
    if (m_outputs_seen || sinks || misspelt) return;
    const Entry* section = root.find("outputs");
    if (section && !section->value->is_null() && !section->value->is_mapping()) return;
    if (!section && !root.find("nodes")) return;
    problem(section ? section->where : root.where,
            section
                ? "'outputs' is empty; name what the graph gives: 'image: " + example_node() + "'"
                : "'outputs' is missing; name what the graph gives: 'outputs: {image: " +
                      example_node() + "}'");
}

std::string GraphReader::example_node() const
{
    return m_graph.nodes.empty() ? "some_node" : m_graph.nodes.back().id;
}

void GraphReader::read_output(const Entry& entry)
{
    m_outputs_seen = true;
    if (!check_name(entry.key, entry.where, "output")) return;
    const std::string what = "output '" + entry.key + "': ";
    GraphOutput output;
    output.name = entry.key;
    output.where = entry.where;
    const Value* from = entry.value.get();
    if (from->is_mapping()) {
        for (const Entry& e : from->entries) unknown_key(e, output_keys, what);
        if (const Entry* doc = from->find("doc")) output.doc = text_of(*doc, what).value_or("");
        const Entry* source = from->find("from");
        if (!source) {
            problem(from->where, what + "'from' is missing: the node it comes from");
            return;
        }
        from = source->value.get();
    }
    const auto stream = checked_reference(*from, what);
    if (!stream) return;
    output.stream = *stream;
    output.kind = kind_of(stream_shape(*stream, what));
    m_graph.outputs.push_back(std::move(output));
}

void GraphReader::warn_unused()
{
    for (const GraphNode& node : m_graph.nodes)
        for (const Argument& argument : node.arguments)
            for (const auto& item : argument.items)
                if (const auto* reference = std::get_if<ParamReference>(&item))
                    m_used_params.insert(reference->name);
    for (const GraphParam& param : m_graph.params)
        if (!m_used_params.contains(param.info.name))
            m_graph.warnings.push_back(
                {param.where, "parameter '" + param.info.name + "' is not used"});
    for (const GraphInput& input : m_graph.inputs)
        if (!m_used_inputs.contains(input.name))
            m_graph.warnings.push_back({input.where, "input '" + input.name + "' is not used"});
}

void GraphReader::count_expanded()
{
    for (const GraphNode& node : m_graph.nodes)
        m_graph.expanded_nodes += node.graph ? node.graph->expanded_nodes : 1;
    if (m_graph.expanded_nodes > max_expanded_nodes)
        problem({m_graph.file, 0, 0}, "the graph has more than " +
                                          std::to_string(max_expanded_nodes) +
                                          " nodes once the graphs in it are put in their places");
}

} // namespace rayloom::reading
