// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/reader.h"

#include "rayloom/core/text.h"
#include "rayloom/graph/expression.h"
#include "rayloom/graph/names.h"
#include "rayloom/graph/yaml.h"
#include "rayloom/image/frames.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <set>
#include <tuple>
#include <unordered_map>

namespace rayloom
{

namespace
{

namespace fs = std::filesystem;
using yaml::Entry;
using yaml::Value;

constexpr std::string_view graph_prefix = "graph:";
constexpr std::size_t max_graph_depth = 16;
constexpr std::size_t max_expanded_nodes = 10'000;
constexpr std::size_t max_problems = 200;

const std::vector<std::string> top_keys{"rayloom", "name",  "doc",    "params",
                                        "inputs",  "nodes", "outputs"};
const std::vector<std::string> param_keys{"type",    "default", "min", "max",
                                          "choices", "unit",    "doc", "source"};
const std::vector<std::string> input_keys{"doc",      "channels", "kind",      "list",
                                          "optional", "role",     "neighbours"};
const std::vector<std::string> output_keys{"from", "doc"};
const std::vector<std::string> node_keys{"op", "when", "otherwise"};
const std::vector<std::string> param_types{"bool",   "int",    "float",  "string",
                                           "choice", "floats", "strings"};
const std::vector<std::string> input_kinds{"image", "list", "deep"};

template <class T, class Name>
std::vector<std::string> names_of(const T& items, Name name)
{
    std::vector<std::string> out;
    for (const auto& item : items) out.push_back(name(item));
    return out;
}

/// The bytes of a graph file, one more than allowed at most.
std::string read_text(const std::string& path)
{
    std::error_code error;
    if (fs::is_directory(path, error))
        throw InputError("'" + path + "' is a folder, not a graph file");
    std::ifstream file(path, std::ios::binary);
    if (!file) throw InputError("cannot read graph '" + path + "': " + std::strerror(errno));
    std::string text(yaml::max_bytes + 1, '\0');
    file.read(text.data(), static_cast<std::streamsize>(text.size()));
    if (file.bad()) throw InputError("cannot read graph '" + path + "': " + std::strerror(errno));
    text.resize(static_cast<std::size_t>(file.gcount()));
    return text;
}

/// What a stream carries as far as the file alone says.
enum class Shape { unknown, image, list, deep, table };

Shape shape_of(PortKind kind)
{
    switch (kind) {
    case PortKind::image: return Shape::image;
    case PortKind::list: return Shape::list;
    case PortKind::deep: return Shape::deep;
    case PortKind::table: return Shape::table;
    }
    return Shape::unknown;
}

std::optional<PortKind> kind_of(Shape shape)
{
    switch (shape) {
    case Shape::image: return PortKind::image;
    case Shape::list: return PortKind::list;
    case Shape::deep: return PortKind::deep;
    case Shape::table: return PortKind::table;
    case Shape::unknown: break;
    }
    return std::nullopt;
}

const char* shape_text(Shape shape)
{
    switch (shape) {
    case Shape::image: return "an image";
    case Shape::list: return "a list of images";
    case Shape::deep: return "a deep image";
    case Shape::table: return "a table";
    case Shape::unknown: break;
    }
    return "unknown";
}

/// Shared by a graph and the graphs it uses as nodes.
struct ReadState {
    std::vector<Problem> problems;
    /// Graphs already read, by canonical path; null for one with problems.
    std::map<std::string, std::shared_ptr<const Graph>> done;
    /// Files being read, outermost first: canonical path and path as shown.
    std::vector<std::pair<std::string, std::string>> open;
};

Graph read_tree(const std::string& text, const std::string& name, const std::string& folder,
                ReadState& state);

/// Turns one file's tree into a Graph.
class Reader
{
public:
    Reader(Graph& graph, ReadState& state) : m_graph(graph), m_state(state) {}

    void read(const Value& root)
    {
        if (!root.is_mapping()) {
            problem(root.where, "a graph is a mapping that begins with 'rayloom: 1', this is " +
                                    root.describe());
            return;
        }
        check_version(root);
        for (const Entry& entry : root.entries) read_section(entry);
        if (!root.find("nodes") && !root.find("outputs"))
            problem({m_graph.file, 0, 0}, "the graph has no nodes and no outputs");
        check_name_clashes();
        check_neighbours();
        resolve_nodes();
        find_cycles();
        infer_shapes();
        resolve_outputs(root);
        warn_unused();
        count_expanded();
    }

private:
    // --- small helpers -----------------------------------------------------------------------

    void problem(const SourcePosition& where, std::string message)
    {
        m_state.problems.push_back({where, std::move(message)});
    }

    static std::string label(const GraphNode& node)
    {
        return "node '" + node.id + "'" + (node.op.empty() ? "" : " (" + node.op + ")") + ": ";
    }

    bool unknown_key(const Entry& entry, const std::vector<std::string>& known,
                     const std::string& what)
    {
        if (std::find(known.begin(), known.end(), entry.key) != known.end()) return false;
        problem(entry.where,
                what + "'" + entry.key + "' is not a key here" + suggestion(entry.key, known));
        return true;
    }

    /// Text of a scalar; a problem and nothing for anything else.
    std::optional<std::string> text_of(const Entry& entry, const std::string& what)
    {
        if (entry.value->is_scalar()) return entry.value->text;
        problem(entry.value->where,
                what + "'" + entry.key + "' wants text, this is " + entry.value->describe());
        return std::nullopt;
    }

    std::optional<bool> truth_of(const Entry& entry, const std::string& what)
    {
        if (entry.value->is_scalar() && !entry.value->quoted) {
            const ParamValue value = plain_scalar(entry.value->text);
            if (const bool* truth = std::get_if<bool>(&value)) return *truth;
        }
        problem(entry.value->where, what + "'" + entry.key + "' wants true or false, this is " +
                                        entry.value->describe());
        return std::nullopt;
    }

    std::optional<double> number_of(const Entry& entry, const std::string& what)
    {
        if (entry.value->is_scalar() && !entry.value->quoted) {
            const ParamValue value = plain_scalar(entry.value->text);
            if (const auto* whole = std::get_if<std::int64_t>(&value))
                return static_cast<double>(*whole);
            if (const auto* real = std::get_if<double>(&value); real && *real == *real)
                return *real;
        }
        problem(entry.value->where,
                what + "'" + entry.key + "' wants a number, this is " + entry.value->describe());
        return std::nullopt;
    }

    bool check_name(const std::string& name, const SourcePosition& where, const std::string& what)
    {
        if (!is_graph_name(name)) {
            problem(where, what + " name '" + name +
                               "' must be letters, digits, '_' and '-', beginning with a letter");
            return false;
        }
        return true;
    }

    /// Checks that a section is a mapping and hands its entries over.
    void each_entry(const Entry& section, const std::function<void(const Entry&)>& read_entry)
    {
        if (section.value->is_null()) return;
        if (!section.value->is_mapping()) {
            problem(section.value->where, "'" + section.key +
                                              "' wants a mapping of names, this is " +
                                              section.value->describe());
            return;
        }
        for (const Entry& entry : section.value->entries) read_entry(entry);
    }

    std::optional<StreamReference> reference(const Value& value, const std::string& what)
    {
        if (!value.is_scalar()) {
            problem(value.where, what + "wants a reference, this is " + value.describe());
            return std::nullopt;
        }
        if (value.text.starts_with('$')) {
            problem(value.where, what + "wants a reference; '" + value.text +
                                     "' is a parameter, which only parameters take");
            return std::nullopt;
        }
        std::string reason;
        auto out = parse_stream_reference(value.text, value.where, reason);
        if (!out) problem(value.where, what + "'" + value.text + "': " + reason);
        return out;
    }

    // --- sections ----------------------------------------------------------------------------

    void check_version(const Value& root)
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
            problem(value.where, "this is version " + value.text +
                                     " of the format; this rayloom reads version 1");
    }

    void read_section(const Entry& entry)
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

    bool reserved(const std::string& name, const SourcePosition& where, const std::string& what)
    {
        if (std::find(node_keys.begin(), node_keys.end(), name) == node_keys.end()) return false;
        problem(where, what + " cannot be named '" + name + "', a word of the format");
        return true;
    }

    void read_param(const Entry& entry)
    {
        if (!check_name(entry.key, entry.where, "parameter") ||
            reserved(entry.key, entry.where, "a parameter"))
            return;
        const std::string what = "parameter '" + entry.key + "': ";
        GraphParam param;
        param.info.name = entry.key;
        param.where = entry.where;
        bool valid = true;
        if (entry.value->is_mapping())
            valid = read_param_mapping(param.info, *entry.value, what);
        else
            valid = read_default(param.info, *entry.value, false, what);
        // One that failed is kept, so that references to it are not reported as well.
        if (!valid) m_broken_params.insert(entry.key);
        m_graph.params.push_back(std::move(param));
    }

    bool read_param_mapping(ParamInfo& info, const Value& value, const std::string& what)
    {
        bool valid = true;
        bool typed = false;
        for (const Entry& entry : value.entries)
            if (unknown_key(entry, param_keys, what)) valid = false;
        if (const Entry* entry = value.find("type")) {
            const auto text = text_of(*entry, what);
            const auto type = text ? param_type_from_name(*text) : std::nullopt;
            if (text && !type)
                problem(entry->value->where, what + "type '" + *text + "' is not known" +
                                                 suggestion(*text, param_types));
            if (!type) return false;
            info.type = *type;
            typed = true;
        }
        if (const Entry* entry = value.find("choices")) {
            if (!typed) info.type = ParamType::choice;
            typed = true;
            valid = read_choices(info, *entry, what) && valid;
        } else if (typed && info.type == ParamType::choice) {
            problem(value.where, what + "a choice lists its 'choices'");
            return false;
        }
        for (const char* key : {"unit", "doc", "source"})
            if (const Entry* entry = value.find(key)) {
                const auto text = text_of(*entry, what);
                if (!text) continue;
                (entry->key == "unit"  ? info.unit
                 : entry->key == "doc" ? info.doc
                                       : info.source) = *text;
            }
        const Entry* fallback = value.find("default");
        if (!fallback && !typed) {
            problem(value.where, what + "wants a 'type' or a 'default'");
            return false;
        }
        // The type comes first, the range next: both are needed to judge the default.
        if (!typed && !infer_type(info, *fallback->value, what)) return false;
        valid = read_range(info, value, what) && valid;
        if (!valid) return false;
        if (fallback) return read_default(info, *fallback->value, true, what);
        info.required = true;
        info.default_value = neutral(info);
        return true;
    }

    /// A value of the declared type for a parameter that has no default.
    static ParamValue neutral(const ParamInfo& info)
    {
        switch (info.type) {
        case ParamType::boolean: return false;
        case ParamType::integer: return std::int64_t{0};
        case ParamType::real: return 0.0;
        case ParamType::text: return std::string();
        case ParamType::choice: return info.choices.front();
        case ParamType::reals: return std::vector<double>();
        case ParamType::texts: return std::vector<std::string>();
        }
        return 0.0;
    }

    bool read_choices(ParamInfo& info, const Entry& entry, const std::string& what)
    {
        if (info.type != ParamType::choice && info.type != ParamType::text) {
            problem(entry.where,
                    what + "'choices' are for text, not for type " + param_type_name(info.type));
            return false;
        }
        info.type = ParamType::choice;
        if (!entry.value->is_sequence() || entry.value->items.empty()) {
            problem(entry.value->where,
                    what + "'choices' wants a list of texts, this is " +
                        (entry.value->is_sequence() ? "an empty list" : entry.value->describe()));
            return false;
        }
        for (const auto& item : entry.value->items) {
            if (!item->is_scalar()) {
                problem(item->where, what + "a choice is text, this is " + item->describe());
                return false;
            }
            info.choices.push_back(item->text);
        }
        return true;
    }

    bool read_range(ParamInfo& info, const Value& value, const std::string& what)
    {
        bool valid = true;
        for (const char* key : {"min", "max"}) {
            const Entry* entry = value.find(key);
            if (!entry) continue;
            if (info.type != ParamType::integer && info.type != ParamType::real &&
                info.type != ParamType::reals) {
                problem(entry->where, what + "'" + key + "' is for numbers, not for type " +
                                          param_type_name(info.type));
                valid = false;
                continue;
            }
            const auto number = number_of(*entry, what);
            (std::string_view(key) == "min" ? info.min : info.max) = number;
            valid = valid && number.has_value();
        }
        if (valid && info.min && info.max && *info.min > *info.max) {
            problem(value.find("min")->value->where, what + "'min' " + format_param(*info.min) +
                                                         " is above 'max' " +
                                                         format_param(*info.max));
            valid = false;
        }
        return valid;
    }

    /// The type of a parameter that only has a default.
    bool infer_type(ParamInfo& info, const Value& value, const std::string& what)
    {
        const auto type_of_scalar = [](const Value& v) {
            const ParamValue plain = v.quoted ? ParamValue(v.text) : plain_scalar(v.text);
            if (std::holds_alternative<bool>(plain)) return ParamType::boolean;
            if (std::holds_alternative<std::int64_t>(plain)) return ParamType::integer;
            return std::holds_alternative<double>(plain) ? ParamType::real : ParamType::text;
        };
        if (value.is_scalar()) {
            info.type = type_of_scalar(value);
            return true;
        }
        if (value.is_sequence() && !value.items.empty() &&
            std::all_of(value.items.begin(), value.items.end(),
                        [](const auto& item) { return item->is_scalar(); })) {
            const bool numbers =
                std::all_of(value.items.begin(), value.items.end(), [&](const auto& item) {
                    const ParamType type = type_of_scalar(*item);
                    return type == ParamType::integer || type == ParamType::real;
                });
            info.type = numbers ? ParamType::reals : ParamType::texts;
            return true;
        }
        problem(value.where, what + "the type cannot be told from a default that is " +
                                 (value.is_sequence() ? "such a list" : value.describe()) +
                                 "; give a 'type'");
        return false;
    }

    bool read_default(ParamInfo& info, const Value& value, bool typed, const std::string& what)
    {
        if (!typed && !infer_type(info, value, what)) return false;
        std::string reason;
        const auto fallback = literal(info, value, reason);
        if (!fallback) {
            problem(value.where, "the default of " + reason);
            return false;
        }
        info.default_value = *fallback;
        return true;
    }

    /// A scalar as the parameter's type wants it: text parameters keep it as written.
    static ParamValue scalar(const ParamInfo& info, const Value& value)
    {
        const bool textual = info.type == ParamType::text || info.type == ParamType::choice ||
                             info.type == ParamType::texts;
        return value.quoted || textual ? ParamValue(value.text) : plain_scalar(value.text);
    }

    /// A scalar or a list of scalars, checked against the declaration.
    static std::optional<ParamValue> literal(const ParamInfo& info, const Value& value,
                                             std::string& reason)
    {
        try {
            if (value.is_scalar()) return check_param(info, scalar(info, value));
            if (!value.is_sequence()) {
                reason = "parameter '" + info.name + "' wants a value of type " +
                         param_type_name(info.type) + ", this is " + value.describe();
                return std::nullopt;
            }
            std::vector<double> numbers;
            std::vector<std::string> texts;
            for (const auto& item : value.items) {
                if (!item->is_scalar()) {
                    reason =
                        "parameter '" + info.name + "' holds " + item->describe() + " in its list";
                    return std::nullopt;
                }
                const ParamValue v = scalar(info, *item);
                if (const auto* whole = std::get_if<std::int64_t>(&v))
                    numbers.push_back(static_cast<double>(*whole));
                else if (const auto* real = std::get_if<double>(&v))
                    numbers.push_back(*real);
                else
                    texts.push_back(item->text);
            }
            if (info.type == ParamType::reals && !texts.empty()) {
                reason = "parameter '" + info.name + "' is a list of numbers, and '" + texts[0] +
                         "' is none";
                return std::nullopt;
            }
            if (info.type == ParamType::texts) return check_param(info, texts);
            return check_param(info, numbers);
        } catch (const NodeError& error) {
            reason = error.what();
            if (info.type == ParamType::boolean) reason += "; write true or false";
            return std::nullopt;
        }
    }

    void read_input(const Entry& entry)
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

    void read_input_key(GraphInput& input, const Entry& entry, const std::string& what)
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
                problem(entry.value->where, what + "kind '" + *text + "' is not known" +
                                                suggestion(*text, input_kinds));
        } else if (entry.key == "neighbours") {
            read_neighbours(input, entry, what);
        } else if (entry.key == "list") {
            if (truth_of(entry, what).value_or(false)) input.kind = PortKind::list;
        } else {
            input.required = !truth_of(entry, what).value_or(false);
        }
    }

    void read_neighbours(GraphInput& input, const Entry& entry, const std::string& what)
    {
        const auto text = text_of(entry, what);
        if (!text) return;
        const std::size_t at = text->rfind('@');
        try {
            const auto frames = at == std::string::npos
                                    ? std::nullopt
                                    : parse_relative_frames(std::string_view(*text).substr(at + 1));
            if (!frames)
                throw UsageError("'neighbours' wants input@-5..-1, this is '" + *text + "'");
            input.neighbours = {text->substr(0, at), frames->first, frames->last,
                                entry.value->where};
        } catch (const UsageError& error) {
            problem(entry.value->where, what + error.what());
        }
    }

    void read_channels(GraphInput& input, const Entry& entry, const std::string& what)
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

    // --- nodes -------------------------------------------------------------------------------

    void read_node(const Entry& entry)
    {
        if (!check_name(entry.key, entry.where, "node")) return;
        GraphNode node;
        node.id = entry.key;
        node.where = entry.where;
        const Value& value = *entry.value;
        const Entry* op = nullptr;
        if (!value.is_mapping()) {
            problem(value.where, label(node) +
                                     "wants a mapping such as {op: stage.what, …}, this is " +
                                     value.describe());
        } else if (op = value.find("op"); !op) {
            problem(entry.where, label(node) + "'op' is missing");
        } else if (!op->value->is_scalar()) {
            problem(op->value->where, label(node) + "'op' wants the name of a node, this is " +
                                          op->value->describe());
            op = nullptr;
        }
        NodeTree tree;
        if (op) {
            node.op = op->value->text;
            node.op_where = op->value->where;
            tree.info = find_op(node);
        }
        tree.value = entry.value;
        m_node_index.emplace(node.id, m_graph.nodes.size());
        m_graph.nodes.push_back(std::move(node));
        m_trees.push_back(std::move(tree));
    }

    /// Declaration behind a node's op; empty when there is none.
    std::optional<NodeInfo> find_op(GraphNode& node)
    {
        if (node.op.starts_with(graph_prefix)) {
            node.graph = find_graph_node(node);
            if (node.graph) return graph_signature(*node.graph);
            return std::nullopt;
        }
        if (const NodeInfo* info = Registry::instance().find(node.op)) return *info;
        problem(node.op_where, "node '" + node.id + "': op '" + node.op + "' is not known" +
                                   op_suggestion(node.op));
        return std::nullopt;
    }

    static std::string op_suggestion(const std::string& op)
    {
        const std::vector<std::string> names = Registry::instance().names();
        if (!closest_name(op, names).empty()) return suggestion(op, names);
        const std::size_t dot = op.find('.');
        const std::string stage = op.substr(0, dot);
        std::vector<std::string> same_what;
        std::vector<std::string> same_stage;
        for (const std::string& name : names) {
            const std::size_t split = name.find('.');
            if (dot == std::string::npos && name.substr(split + 1) == op) same_what.push_back(name);
            if (dot != std::string::npos && name.substr(0, split) == stage)
                same_stage.push_back(name);
        }
        if (same_what.size() == 1) return "; did you mean '" + same_what[0] + "'?";
        if (same_what.size() > 1) return "; there is: " + join_names(same_what);
        if (!same_stage.empty() && same_stage.size() <= 24)
            return "; under '" + stage + "' there is: " + join_names(same_stage);
        return "; 'rayloom nodes' lists them";
    }

    std::shared_ptr<const Graph> find_graph_node(const GraphNode& node)
    {
        const std::string given = node.op.substr(graph_prefix.size());
        if (given.empty()) {
            problem(node.op_where, label(node) + "'graph:' wants a file: 'graph:other.yaml'");
            return nullptr;
        }
        const fs::path path =
            fs::path(given).is_absolute() || m_graph.folder.empty() || m_graph.folder == "."
                ? fs::path(given)
                : fs::path(m_graph.folder) / given;
        const std::string shown = path.lexically_normal().string();
        std::error_code error;
        fs::path canonical = fs::weakly_canonical(path, error);
        if (error) canonical = fs::absolute(path, error);
        const auto open =
            std::find_if(m_state.open.begin(), m_state.open.end(),
                         [&](const auto& file) { return file.first == canonical.string(); });
        if (open != m_state.open.end()) {
            std::string chain;
            for (auto it = open; it != m_state.open.end(); ++it) chain += it->second + " -> ";
            problem(node.op_where, label(node) + "the graph uses itself: " + chain + open->second);
            return nullptr;
        }
        if (m_state.open.size() >= max_graph_depth) {
            problem(node.op_where, label(node) + "graphs within graphs more than " +
                                       std::to_string(max_graph_depth) + " deep");
            return nullptr;
        }
        if (const auto it = m_state.done.find(canonical.string()); it != m_state.done.end())
            return it->second;
        std::shared_ptr<const Graph> inner;
        m_state.open.emplace_back(canonical.string(), shown);
        const std::size_t before = m_state.problems.size();
        try {
            Graph read =
                read_tree(read_text(path.string()), shown, path.parent_path().string(), m_state);
            if (m_state.problems.size() == before)
                inner = std::make_shared<const Graph>(std::move(read));
        } catch (const InputError& failure) {
            problem(node.op_where, label(node) + failure.what());
        }
        m_state.open.pop_back();
        m_state.done[canonical.string()] = inner;
        return inner;
    }

    void check_name_clashes()
    {
        for (const GraphNode& node : m_graph.nodes)
            if (const GraphInput* input = m_graph.input(node.id))
                problem(node.where, "node '" + node.id + "' has the name of an input (line " +
                                        std::to_string(input->where.line) + ")");
        for (const GraphInput& input : m_graph.inputs)
            if (const GraphParam* param = m_graph.param(input.name))
                problem(input.where, "input '" + input.name +
                                         "' has the name of a parameter (line " +
                                         std::to_string(param->where.line) + ")");
    }

    void check_neighbours()
    {
        for (const GraphInput& input : m_graph.inputs) {
            if (!input.neighbours) continue;
            const std::string what = "input '" + input.name + "': ";
            if (!m_graph.input(input.neighbours->input))
                problem(input.neighbours->where,
                        what + "there is no input '" + input.neighbours->input + "'" +
                            suggestion(input.neighbours->input,
                                       names_of(m_graph.inputs,
                                                [](const GraphInput& i) { return i.name; })));
            if (input.kind != PortKind::list || input.required)
                problem(input.neighbours->where,
                        what + "neighbours are as many as there are, so it must be a list and "
                               "optional");
        }
    }

    void resolve_nodes()
    {
        for (std::size_t i = 0; i < m_graph.nodes.size(); ++i) {
            GraphNode& node = m_graph.nodes[i];
            NodeTree& tree = m_trees[i];
            if (!tree.value->is_mapping()) continue;
            for (const Entry& entry : tree.value->entries) {
                if (entry.key == "op") continue;
                if (entry.key == "when")
                    read_when(node, entry);
                else if (entry.key == "otherwise")
                    node.otherwise = checked_reference(*entry.value, label(node) + "'otherwise': ");
                else if (tree.info)
                    read_argument(node, *tree.info, entry);
            }
            if (node.otherwise && !tree.value->find("when"))
                problem(tree.value->find("otherwise")->where,
                        label(node) + "'otherwise' means nothing without 'when'");
            if (tree.info) check_missing(node, *tree.info, *tree.value);
        }
    }

    void read_when(GraphNode& node, const Entry& entry)
    {
        const Value& value = *entry.value;
        if (!value.is_scalar()) {
            problem(value.where, label(node) +
                                     "'when' wants a condition such as has(albedo), "
                                     "this is " +
                                     value.describe());
            return;
        }
        SourcePosition where = value.where;
        const bool exact = stands_in_file(value, where);
        std::vector<Problem> found;
        node.when = parse_expression(value.text, where, exact, found);
        if (node.when) check_expression(*node.when, m_graph, found);
        for (Problem& p : found) problem(p.where, label(node) + "'when': " + p.message);
        if (!node.when) return;
        for (const std::string& name : parameters(*node.when)) m_used_params.insert(name);
        for (const StreamReference& stream : references(*node.when))
            check_reference(stream, label(node) + "'when': ");
    }

    /// Whether a scalar stands in the file character for character, so that positions within it
    /// can be told; moves `where` behind an opening quote.
    bool stands_in_file(const Value& value, SourcePosition& where) const
    {
        std::size_t at = 0;
        for (int line = 1; line < where.line; ++line) {
            at = m_graph.text.find('\n', at);
            if (at == std::string::npos) return false;
            ++at;
        }
        // Columns count characters; step over the bytes that continue one.
        for (int column = 1; column < where.column && at < m_graph.text.size(); ++column) do
                ++at;
            while (at < m_graph.text.size() &&
                   (static_cast<unsigned char>(m_graph.text[at]) & 0xc0) == 0x80);
        if (m_graph.text.compare(at, value.text.size(), value.text) == 0) return true;
        if (at + 1 < m_graph.text.size() &&
            m_graph.text.compare(at + 1, value.text.size(), value.text) == 0) {
            ++where.column;
            return true;
        }
        return false;
    }

    void read_argument(GraphNode& node, const NodeInfo& info, const Entry& entry)
    {
        Argument argument;
        argument.key = entry.key;
        argument.where = entry.where;
        argument.value_where = entry.value->where;
        if (const PortInfo* port = info.input(entry.key)) {
            argument.is_port = true;
            read_streams(node, *port, argument, *entry.value);
        } else if (const ParamInfo* param = info.param(entry.key)) {
            read_items(node, *param, argument, *entry.value);
        } else {
            problem(entry.where, label(node) + unknown_argument(info, entry.key));
            return;
        }
        node.arguments.push_back(std::move(argument));
    }

    /// The input, parameter or word of the format a key is a slip of; empty when there is none.
    static std::string closest_argument(const NodeInfo& info, const std::string& key)
    {
        std::vector<std::string> all{"op", "when", "otherwise"};
        for (const PortInfo& port : info.inputs) all.push_back(port.name);
        for (const ParamInfo& param : info.params) all.push_back(param.name);
        return closest_name(key, all);
    }

    static std::string unknown_argument(const NodeInfo& info, const std::string& key)
    {
        if (const std::string near = closest_argument(info, key); !near.empty()) {
            const char* what = info.input(near) ? "input" : info.param(near) ? "parameter" : "key";
            return std::string(what) + " '" + key + "' is not known; did you mean '" + near + "'?";
        }
        const auto name = [](const auto& item) { return item.name; };
        const std::vector<std::string> ports = names_of(info.inputs, name);
        const std::vector<std::string> params = names_of(info.params, name);
        const auto list = [](const std::vector<std::string>& names) {
            return names.empty() ? std::string("none") : join_names(names);
        };
        return "'" + key + "' is neither an input (" + list(ports) + ") nor a parameter (" +
               list(params) + ")";
    }

    void read_streams(const GraphNode& node, const PortInfo& port, Argument& argument,
                      const Value& value)
    {
        const std::string what = label(node) + "input '" + port.name + "': ";
        if (value.is_null()) {
            problem(argument.where, what + "no value is given");
        } else if (value.is_sequence()) {
            argument.streams_are_list = true;
            if (value.items.empty()) problem(value.where, what + "the list is empty");
            for (const auto& item : value.items)
                if (const auto stream = checked_reference(*item, what))
                    argument.streams.push_back(*stream);
        } else if (const auto stream = checked_reference(value, what)) {
            argument.streams.push_back(*stream);
        }
    }

    void read_items(const GraphNode& node, const ParamInfo& info, Argument& argument,
                    const Value& value)
    {
        const std::string what = label(node);
        if (value.is_null()) {
            problem(argument.where, what + "parameter '" + info.name + "' is given no value");
        } else if (value.is_sequence()) {
            argument.items_are_list = true;
            const bool list = info.type == ParamType::reals || info.type == ParamType::texts;
            if (value.items.empty() && !list)
                problem(value.where, what + "parameter '" + info.name + "' is given an empty list");
            for (const auto& item : value.items) read_item(info, argument, *item, what);
        } else {
            read_item(info, argument, value, what);
        }
    }

    void read_item(const ParamInfo& info, Argument& argument, const Value& value,
                   const std::string& what)
    {
        if (value.is_scalar() && value.text.starts_with('$') && !value.text.starts_with("$$")) {
            const std::string name = value.text.substr(1);
            argument.items.emplace_back(ParamReference{name});
            check_param_reference(info, name, argument.items_are_list, value, what);
            return;
        }
        std::string reason;
        std::optional<ParamValue> item;
        if (value.is_scalar() && value.text.starts_with("$$")) {
            Value escaped = value;
            escaped.text.erase(0, 1);
            item = literal(info, escaped, reason);
        } else if (value.is_sequence()) {
            reason = "parameter '" + info.name + "' holds a list within a list";
        } else {
            item = literal(info, value, reason);
        }
        if (!item) {
            problem(value.where, what + reason);
            return;
        }
        // An element of a list parameter is one value; check_param() made a list of one of it.
        if (argument.items_are_list) {
            if (const auto* numbers = std::get_if<std::vector<double>>(&*item))
                item = ParamValue((*numbers)[0]);
            else if (const auto* texts = std::get_if<std::vector<std::string>>(&*item))
                item = ParamValue(std::string((*texts)[0]));
        }
        argument.items.emplace_back(std::move(*item));
    }

    /// A graph parameter must be of a type the node's parameter takes, and its default and its
    /// choices must be allowed there.
    void check_param_reference(const ParamInfo& info, const std::string& name, bool in_list,
                               const Value& value, const std::string& what)
    {
        const GraphParam* param = m_graph.param(name);
        if (!param) {
            const auto names =
                names_of(m_graph.params, [](const GraphParam& p) { return p.info.name; });
            problem(value.where, what + "parameter '$" + name + "' is not declared under params" +
                                     suggestion(name, names));
            return;
        }
        m_used_params.insert(name);
        if (m_broken_params.contains(name)) return;
        const ParamInfo& from = param->info;
        const bool from_list = from.type == ParamType::reals || from.type == ParamType::texts;
        if (in_list && from_list) {
            problem(value.where, what + "parameter '" + info.name + "' holds '$" + name +
                                     "', a list, within a list");
            return;
        }
        if (!fits(from, info)) {
            problem(value.where, what + "parameter '" + info.name + "' is of type " +
                                     param_type_name(info.type) + ", '$" + name + "' of type " +
                                     param_type_name(from.type));
            return;
        }
        for (const std::string& choice : from.choices)
            if (info.type == ParamType::choice &&
                std::find(info.choices.begin(), info.choices.end(), choice) == info.choices.end())
                problem(value.where, what + "'$" + name + "' may be '" + choice +
                                         "', which parameter '" + info.name + "' cannot" +
                                         suggestion(choice, info.choices));
        if (from.required || from.type == ParamType::choice) return;
        try {
            check_list_or_value(info, from.default_value);
        } catch (const NodeError& error) {
            problem(value.where,
                    what + std::string(error.what()) + ", the default of '$" + name + "'");
        }
    }

    static bool fits(const ParamInfo& from, const ParamInfo& to)
    {
        using enum ParamType;
        const auto number = [](ParamType t) { return t == integer || t == real; };
        const auto textual = [](ParamType t) { return t == text || t == choice; };
        switch (to.type) {
        case boolean: return from.type == boolean;
        case integer: return from.type == integer;
        case real: return number(from.type) || from.type == reals;
        case text: return textual(from.type) || from.type == texts;
        case choice: return textual(from.type) || from.type == texts;
        case reals: return number(from.type) || from.type == reals;
        case texts: return textual(from.type) || from.type == texts;
        }
        return false;
    }

    /// A list for a parameter of one value is one value per element of the list it is mapped over.
    static void check_list_or_value(const ParamInfo& info, const ParamValue& value)
    {
        const bool list = info.type == ParamType::reals || info.type == ParamType::texts;
        if (const auto* numbers = std::get_if<std::vector<double>>(&value); numbers && !list)
            for (const double number : *numbers) check_param(info, number);
        else if (const auto* texts = std::get_if<std::vector<std::string>>(&value); texts && !list)
            for (const std::string& text : *texts) check_param(info, text);
        else
            check_param(info, value);
    }

    /// "(its description)" for messages.
    static std::string in_brackets(std::string doc)
    {
        if (doc.ends_with('.')) doc.pop_back();
        return doc.empty() ? "" : " (" + doc + ")";
    }

    void check_missing(const GraphNode& node, const NodeInfo& info, const Value& value)
    {
        // A misspelt key is reported as such, not as a missing one too.
        std::set<std::string> meant;
        for (const Entry& entry : value.entries)
            if (!info.input(entry.key) && !info.param(entry.key))
                meant.insert(closest_argument(info, entry.key));
        const auto missing = [&](const std::string& name) {
            return !value.find(name) && !meant.contains(name);
        };
        for (const PortInfo& port : info.inputs)
            if (port.required && missing(port.name))
                problem(node.where, label(node) + "input '" + port.name + "' is missing" +
                                        in_brackets(port.doc));
        for (const ParamInfo& param : info.params)
            if (param.required && missing(param.name))
                problem(node.where, label(node) + "parameter '" + param.name + "' is missing" +
                                        in_brackets(param.doc));
    }

    // --- references --------------------------------------------------------------------------

    std::optional<StreamReference> checked_reference(const Value& value, const std::string& what)
    {
        const auto stream = reference(value, what);
        if (stream) check_reference(*stream, what);
        return stream;
    }

    /// The name and the port exist; what the stream carries is looked at later.
    void check_reference(const StreamReference& stream, const std::string& what)
    {
        if (m_graph.input(stream.node)) {
            m_used_inputs.insert(stream.node);
            if (!stream.port.empty())
                problem(stream.where, what + "'" + stream_text(stream) + "': '" + stream.node +
                                          "' is an input of the graph and has no outputs");
            return;
        }
        const std::size_t i = node_index(stream.node);
        if (i == m_graph.nodes.size()) {
            auto names = names_of(m_graph.nodes, [](const GraphNode& n) { return n.id; });
            for (const GraphInput& input : m_graph.inputs) names.push_back(input.name);
            problem(stream.where, what + "'" + stream.node + "' is neither a node nor an input" +
                                      suggestion(stream.node, names));
            return;
        }
        if (!m_trees[i].info) return;
        const NodeInfo& info = *m_trees[i].info;
        if (info.outputs.empty())
            problem(stream.where, what + "node '" + stream.node + "' (" + m_graph.nodes[i].op +
                                      ") has no output");
        else if (!stream.port.empty() && !info.output(stream.port))
            problem(stream.where,
                    what + "node '" + stream.node + "' (" + m_graph.nodes[i].op +
                        ") has no output '" + stream.port + "'" +
                        suggestion(stream.port, names_of(info.outputs, [](const PortInfo& p) {
                                       return p.name;
                                   })));
    }

    std::size_t node_index(const std::string& id) const
    {
        const auto it = m_node_index.find(id);
        return it == m_node_index.end() ? m_graph.nodes.size() : it->second;
    }

    /// Every stream a node depends on.
    static std::vector<StreamReference> dependencies(const GraphNode& node)
    {
        std::vector<StreamReference> out;
        for (const Argument& argument : node.arguments)
            out.insert(out.end(), argument.streams.begin(), argument.streams.end());
        if (node.otherwise) out.push_back(*node.otherwise);
        if (node.when)
            for (const StreamReference& stream : references(*node.when)) out.push_back(stream);
        return out;
    }

    /// Orders the nodes so that each follows what it depends on; reports each cycle once. The walk
    /// keeps its own stack: a chain of nodes may be as long as the file allows.
    void find_cycles()
    {
        enum class Mark { fresh, open, done };
        std::vector<Mark> marks(m_graph.nodes.size(), Mark::fresh);
        struct Step {
            std::size_t node;
            std::vector<StreamReference> streams;
            std::size_t next = 0;
        };
        std::vector<Step> path;
        for (std::size_t start = 0; start < m_graph.nodes.size(); ++start) {
            if (marks[start] != Mark::fresh) continue;
            marks[start] = Mark::open;
            path.push_back({start, dependencies(m_graph.nodes[start])});
            while (!path.empty()) {
                Step& step = path.back();
                if (step.next == step.streams.size()) {
                    marks[step.node] = Mark::done;
                    m_order.push_back(step.node);
                    path.pop_back();
                    continue;
                }
                const StreamReference stream = step.streams[step.next++];
                const auto it = m_node_index.find(stream.node);
                if (it == m_node_index.end() || m_graph.input(stream.node)) continue;
                if (marks[it->second] == Mark::open) {
                    report_cycle(
                        stream,
                        [&] {
                            std::vector<std::size_t> nodes;
                            for (const Step& s : path) nodes.push_back(s.node);
                            return nodes;
                        }(),
                        it->second);
                } else if (marks[it->second] == Mark::fresh) {
                    marks[it->second] = Mark::open;
                    path.push_back({it->second, dependencies(m_graph.nodes[it->second])});
                }
            }
        }
    }

    void report_cycle(const StreamReference& stream, const std::vector<std::size_t>& path,
                      std::size_t to)
    {
        // The path runs from a node to what it reads; data flows the other way.
        std::string chain = m_graph.nodes[to].id;
        for (auto it = path.rbegin(); it != path.rend(); ++it) {
            chain += " -> " + m_graph.nodes[*it].id;
            if (*it == to) break;
        }
        problem(stream.where, label(m_graph.nodes[path.back()]) + "depends on itself: " + chain);
    }

    // --- what streams carry ------------------------------------------------------------------

    /// Follows images and lists through the graph in the order of dependence and reports what can
    /// never fit. Needs every name to be right, so it says nothing about what is already wrong.
    void infer_shapes()
    {
        for (const GraphInput& input : m_graph.inputs)
            m_shapes[{input.name, ""}] = shape_of(input.kind);
        for (const std::size_t i : m_order) {
            GraphNode& node = m_graph.nodes[i];
            if (node.when)
                for (const StreamReference& stream : references(*node.when))
                    stream_shape(stream, label(node) + "'when': ");
            if (!m_trees[i].info) continue;
            infer_node(node, *m_trees[i].info);
        }
    }

    void infer_node(GraphNode& node, const NodeInfo& info)
    {
        bool mapped = false;
        bool sure = true;
        for (const Argument& argument : node.arguments) {
            if (!argument.is_port) continue;
            const PortInfo& port = *info.input(argument.key);
            for (const StreamReference& stream : argument.streams) {
                const Shape shape =
                    stream_shape(stream, label(node) + "input '" + port.name + "': ");
                check_shape(node, port, stream, shape, argument.streams_are_list);
                if (port.kind == PortKind::list) continue;
                mapped = mapped || shape == Shape::list;
                sure = sure && shape != Shape::unknown;
            }
            if (port.kind != PortKind::list && argument.streams_are_list) mapped = true;
        }
        if (sure && !mapped) check_lone_items(node, info);
        std::optional<Shape> otherwise;
        if (node.otherwise)
            otherwise = stream_shape(*node.otherwise, label(node) + "'otherwise': ");
        for (std::size_t k = 0; k < info.outputs.size(); ++k) {
            const PortInfo& output = info.outputs[k];
            Shape shape = shape_of(output.kind);
            if (node.graph) {
                const auto kind = node.graph->outputs[k].kind;
                // A graph mapped over a list gives lists only where the list is followed.
                shape = kind && !mapped && sure ? shape_of(*kind) : Shape::unknown;
            } else if (mapped) {
                shape = shape == Shape::image ? Shape::list : Shape::unknown;
            } else if (!sure) {
                shape = shape == Shape::list ? Shape::list : Shape::unknown;
            }
            if (otherwise && *otherwise != shape) shape = Shape::unknown;
            if (k == 0) m_shapes[{node.id, ""}] = shape;
            m_shapes[{node.id, output.name}] = shape;
            if (const auto kind = kind_of(shape)) {
                if (k == 0) node.carries.emplace("", *kind);
                node.carries.emplace(output.name, *kind);
            }
        }
    }

    /// A list given to a parameter of one value needs a list of images to go along with.
    void check_lone_items(const GraphNode& node, const NodeInfo& info)
    {
        for (const Argument& argument : node.arguments) {
            if (argument.is_port) continue;
            const ParamInfo& param = *info.param(argument.key);
            if (param.type == ParamType::reals || param.type == ParamType::texts) continue;
            bool list = argument.items_are_list;
            for (const auto& item : argument.items)
                if (const auto* reference = std::get_if<ParamReference>(&item))
                    if (const GraphParam* from = m_graph.param(reference->name))
                        list = list || from->info.type == ParamType::reals ||
                               from->info.type == ParamType::texts;
            if (list && !argument.items.empty())
                problem(argument.value_where,
                        label(node) + "parameter '" + param.name +
                            "' takes one value; a list of values goes along a list of images, "
                            "and no input here is one");
        }
    }

    Shape stream_shape(const StreamReference& stream, const std::string& what)
    {
        const auto it = m_shapes.find({stream.node, stream.port});
        const Shape shape = it == m_shapes.end() ? Shape::unknown : it->second;
        if (!stream.index) return shape;
        if (shape == Shape::list) return Shape::image;
        if (shape != Shape::unknown)
            problem(stream.where, what + "'" + stream_text(stream) + "': an index is for lists, '" +
                                      stream.node + (stream.port.empty() ? "" : "." + stream.port) +
                                      "' is " + shape_text(shape));
        return Shape::unknown;
    }

    void check_shape(const GraphNode& node, const PortInfo& port, const StreamReference& stream,
                     Shape shape, bool in_list)
    {
        const Shape wanted = shape_of(port.kind);
        // One image is a list of one, a list maps the node; list elements are images.
        const bool pixels = shape == Shape::image || shape == Shape::list;
        const bool wants_pixels = wanted == Shape::image || wanted == Shape::list;
        if (shape == Shape::unknown || shape == wanted) {
            if (!(in_list && shape == Shape::list)) return;
            problem(stream.where, label(node) + "input '" + port.name + "' is a list, and '" +
                                      stream_text(stream) +
                                      "' in it is a list itself; lists hold images");
            return;
        }
        if (pixels && wants_pixels) {
            if (!(in_list && shape == Shape::list)) return;
            problem(stream.where, label(node) + "input '" + port.name + "' is given a list, and '" +
                                      stream_text(stream) +
                                      "' in it is a list itself; lists hold images");
            return;
        }
        // A list may hold deep images or tables when what made it was mapped.
        if (shape == Shape::list) return;
        problem(stream.where, label(node) + "input '" + port.name + "' wants " +
                                  shape_text(wanted) + "; '" + stream_text(stream) + "' is " +
                                  shape_text(shape));
    }

    // --- outputs and the whole ---------------------------------------------------------------

    void resolve_outputs(const Value& root)
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
                section ? "'outputs' is empty; name what the graph gives: 'image: " +
                              example_node() + "'"
                        : "'outputs' is missing; name what the graph gives: 'outputs: {image: " +
                              example_node() + "}'");
    }

    std::string example_node() const
    {
        return m_graph.nodes.empty() ? "some_node" : m_graph.nodes.back().id;
    }

    void read_output(const Entry& entry)
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

    void warn_unused()
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

    void count_expanded()
    {
        for (const GraphNode& node : m_graph.nodes)
            m_graph.expanded_nodes += node.graph ? node.graph->expanded_nodes : 1;
        if (m_graph.expanded_nodes > max_expanded_nodes)
            problem({m_graph.file, 0, 0},
                    "the graph has more than " + std::to_string(max_expanded_nodes) +
                        " nodes once the graphs in it are put in their places");
    }

    struct NodeTree {
        std::optional<NodeInfo> info;
        yaml::ValuePtr value;
    };

    Graph& m_graph;
    ReadState& m_state;
    std::vector<NodeTree> m_trees; ///< beside m_graph.nodes
    std::unordered_map<std::string, std::size_t> m_node_index;
    std::vector<std::size_t> m_order; ///< each after what it depends on
    std::set<std::string> m_broken_params, m_used_params, m_used_inputs;
    std::map<std::pair<std::string, std::string>, Shape> m_shapes;
    bool m_outputs_seen = false;
};

Graph read_tree(const std::string& text, const std::string& name, const std::string& folder,
                ReadState& state)
{
    Graph graph;
    graph.file = name;
    graph.folder = folder.empty() ? "." : folder;
    graph.text = text;
    if (const yaml::ValuePtr root = yaml::parse(text, name, state.problems))
        Reader(graph, state).read(*root);
    return graph;
}

/// Throws when there are problems: in the order of the files, then of lines, each once.
void throw_problems(std::vector<Problem>& problems)
{
    if (problems.empty()) return;
    std::vector<std::string> files;
    for (const Problem& p : problems)
        if (std::find(files.begin(), files.end(), p.where.file) == files.end())
            files.push_back(p.where.file);
    const auto place = [&](const Problem& p) {
        const auto file = std::find(files.begin(), files.end(), p.where.file) - files.begin();
        return std::tuple(file, p.where.line, p.where.column);
    };
    std::stable_sort(problems.begin(), problems.end(),
                     [&](const Problem& a, const Problem& b) { return place(a) < place(b); });
    std::vector<Problem> out;
    for (Problem& p : problems)
        if (std::none_of(out.begin(), out.end(), [&](const Problem& q) {
                return q.where == p.where && q.message == p.message;
            }))
            out.push_back(std::move(p));
    if (out.size() > max_problems) {
        const std::size_t more = out.size() - max_problems;
        out.resize(max_problems);
        const SourcePosition whole_file{out.front().where.file, 0, 0};
        out.push_back({whole_file, "and " + std::to_string(more) + " more problems"});
    }
    throw GraphError(std::move(out));
}

} // namespace

NodeInfo graph_signature(const Graph& graph)
{
    NodeInfo info;
    info.name = graph.name;
    info.doc = graph.doc;
    for (const GraphInput& input : graph.inputs)
        info.inputs.push_back({input.name, input.kind, input.required, input.doc});
    for (const GraphOutput& output : graph.outputs)
        info.outputs.push_back(
            {output.name, output.kind.value_or(PortKind::image), true, output.doc});
    for (const GraphParam& param : graph.params) info.params.push_back(param.info);
    return info;
}

Graph read_graph(const std::string& path)
{
    ReadState state;
    const std::string text = read_text(path);
    std::error_code error;
    state.open.emplace_back(fs::weakly_canonical(path, error).string(), path);
    Graph graph = read_tree(text, path, fs::path(path).parent_path().string(), state);
    throw_problems(state.problems);
    return graph;
}

Graph parse_graph(const std::string& text, const std::string& name, const std::string& folder)
{
    ReadState state;
    Graph graph = read_tree(text, name, folder, state);
    throw_problems(state.problems);
    return graph;
}

} // namespace rayloom
