// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/plan.h"

#include "rayloom/core/text.h"
#include "rayloom/engine/cache.h"
#include "rayloom/engine/engine_nodes.h"
#include "rayloom/graph/expression.h"
#include "rayloom/image/renderer_map.h"

#include <OpenImageIO/hash.h>

#include <algorithm>
#include <functional>
#include <set>

namespace rayloom
{

namespace
{

constexpr std::size_t max_ops = 200'000; // a runaway of nested graphs and lists, not a pipeline

/// What a name stands for while a graph is expanded.
struct Value {
    struct TableRef {
        int op = -1;
        std::string port;
    };
    PortKind kind = PortKind::image;
    bool list = false;
    bool absent = false; ///< an optional input nobody bound, or a node whose `when` is false
    bool broken = false; ///< its maker could not be planned; reported already
    std::vector<int> streams;
    std::vector<TableRef> tables;

    std::size_t count() const { return kind == PortKind::table ? tables.size() : streams.size(); }
};

/// Values of one graph while it is expanded: node or input name → port → value.
struct Scope {
    const Graph* graph = nullptr;
    std::string prefix; ///< "outer/" inside a graph used as a node
    ParamValues params;
    std::map<std::string, std::map<std::string, Value, std::less<>>, std::less<>> values;
    std::map<std::string, std::vector<std::string>, std::less<>> port_order; ///< as declared
};

std::string digest(const std::string& text)
{
    OIIO::SHA1 sha(text.data(), text.size());
    return sha.digest();
}

class Planner
{
public:
    Planner(const RunRequest& request, const RunOptions& options)
        : m_request(request), m_options(options)
    {
        m_plan.skip = options.skip;
    }

    Plan make(const Graph& graph);

private:
    // Expansion
    void bind_inputs(const Graph& graph, Scope& scope);
    Value bind_input(const GraphInput& input, const InputBinding& binding);
    void bind_params(const Graph& graph, Scope& scope);
    void expand(Scope& scope);
    void expand_node(Scope& scope, const GraphNode& node);
    void expand_graph_node(Scope& scope, const GraphNode& node);
    void plan_outputs(const Graph& graph, Scope& scope);
    void add_output(const GraphOutput& declared, const OutputBinding* binding, const Value& value);

    // Lookup
    Value lookup(const Scope& scope, const StreamReference& ref);
    Value argument_value(const Scope& scope, const Argument& argument);
    ParamValue item_value(const Scope& scope,
                          const std::variant<ParamValue, ParamReference>& item) const;
    ParamValues node_params(const Scope& scope, const GraphNode& node,
                            const std::vector<ParamInfo>& infos,
                            std::optional<std::size_t> mapped_index);

    // Making ops
    struct NewOp {
        std::string id, name;
        SourcePosition where;
        const NodeInfo* info = nullptr;
        ParamValues params;
        std::unique_ptr<Node> node;
        std::vector<PortInfo> inputs, outputs;
        std::map<std::string, Value, std::less<>>
            arguments;              ///< connected inputs, absent ones left out
        std::optional<Region> crop; ///< sinks: only these pixels
    };
    /// Plans one op and makes its items and streams; empty when it could not be planned.
    std::optional<std::map<std::string, Value, std::less<>>> add_op(NewOp request);
    int add_stream(Stream stream);
    std::map<std::string, Value, std::less<>>
    add_node_op(const std::string& id, const std::string& op, ParamValues params,
                std::map<std::string, Value, std::less<>> arguments, const SourcePosition& where,
                std::optional<Region> crop = {});

    void describe_files(const Graph& graph);
    void prune();
    void choose_inlined();
    bool stream_black(int stream);
    bool channel_black(int stream, int channel);

    void problem(const SourcePosition& where, std::string message)
    {
        m_problems.push_back({where, std::move(message)});
    }

    friend class Facts;

    const RunRequest& m_request;
    const RunOptions& m_options;
    Plan m_plan;
    std::vector<Problem> m_problems;
    std::vector<std::string> m_input_errors;
    std::vector<NewOp> m_pending; ///< copies and constants to make once their op is in place
    std::map<int, std::map<std::string, std::vector<int>, std::less<>>>
        m_op_inputs; ///< op → port → streams
    std::map<int, std::map<std::string, std::vector<int>, std::less<>>> m_reduce_streams;
    std::map<std::pair<int, int>, bool> m_black; ///< (stream, channel) → zero everywhere
};

/// Answers for `when:` conditions.
class Facts final : public ExpressionScope
{
public:
    Facts(Planner& planner, const Scope& scope) : m_planner(planner), m_scope(scope) {}

    ParamValue param(const std::string& name) const override
    {
        const auto it = m_scope.params.find(name);
        return it == m_scope.params.end() ? ParamValue(false) : it->second;
    }
    bool has(const StreamReference& ref) const override { return !value(ref).absent; }
    std::size_t count(const StreamReference& ref) const override { return value(ref).count(); }
    std::size_t channels(const StreamReference& ref) const override
    {
        const Value v = value(ref);
        return v.streams.empty() ? 0
                                 : m_planner.m_plan.streams[static_cast<std::size_t>(v.streams[0])]
                                       .desc.channels.size();
    }
    bool black(const StreamReference& ref) const override
    {
        const Value v = value(ref);
        return !v.streams.empty() &&
               std::ranges::all_of(v.streams, [&](int s) { return m_planner.stream_black(s); });
    }

private:
    Value value(const StreamReference& ref) const { return m_planner.lookup(m_scope, ref); }

    Planner& m_planner;
    const Scope& m_scope;
};

// ------------------------------------------------------------------------------- lookup

Value Planner::lookup(const Scope& scope, const StreamReference& ref)
{
    Value none;
    none.broken = true;
    const auto ports = scope.values.find(ref.node);
    if (ports == scope.values.end()) {
        problem(ref.where, "'" + ref.node + "' is not known here");
        return none;
    }
    std::string port = ref.port;
    if (port.empty()) {
        const auto order = scope.port_order.find(ref.node);
        if (order == scope.port_order.end() || order->second.empty()) return none;
        port = order->second.front();
    }
    const auto found = ports->second.find(port);
    if (found == ports->second.end()) return none;
    Value value = found->second;
    if (!ref.index || value.absent || value.broken) return value;
    const auto index = static_cast<std::size_t>(*ref.index);
    if (!value.list || index >= value.count()) {
        problem(ref.where, "'" + ref.node + "' has " + std::to_string(value.count()) +
                               " elements; number " + std::to_string(*ref.index) +
                               " is not among them (they count from 0)");
        return none;
    }
    if (value.kind == PortKind::table)
        value.tables = {value.tables[index]};
    else
        value.streams = {value.streams[index]};
    value.list = false;
    return value;
}

Value Planner::argument_value(const Scope& scope, const Argument& argument)
{
    if (!argument.streams_are_list) return lookup(scope, argument.streams.front());
    Value list;
    list.list = true;
    bool first = true;
    for (const StreamReference& ref : argument.streams) {
        const Value v = lookup(scope, ref);
        if (v.absent) continue;
        if (v.broken) {
            list.broken = true;
            return list;
        }
        if (!first && v.kind != list.kind)
            problem(ref.where, "a list cannot mix images and figures");
        list.kind = v.kind;
        first = false;
        list.streams.insert(list.streams.end(), v.streams.begin(), v.streams.end());
        list.tables.insert(list.tables.end(), v.tables.begin(), v.tables.end());
    }
    list.absent = first;
    return list;
}

ParamValue Planner::item_value(const Scope& scope,
                               const std::variant<ParamValue, ParamReference>& item) const
{
    if (const auto* literal = std::get_if<ParamValue>(&item)) return *literal;
    const auto it = scope.params.find(std::get<ParamReference>(item).name);
    return it == scope.params.end() ? ParamValue(false) : it->second;
}

/// A sequence of literals and references as one list value.
ParamValue gather(const std::vector<ParamValue>& items)
{
    std::vector<double> numbers;
    std::vector<std::string> texts;
    for (const ParamValue& item : items) {
        if (const auto* i = std::get_if<std::int64_t>(&item))
            numbers.push_back(static_cast<double>(*i));
        else if (const auto* d = std::get_if<double>(&item))
            numbers.push_back(*d);
        else if (const auto* list = std::get_if<std::vector<double>>(&item))
            numbers.insert(numbers.end(), list->begin(), list->end());
        else if (const auto* s = std::get_if<std::string>(&item))
            texts.push_back(*s);
        else if (const auto* names = std::get_if<std::vector<std::string>>(&item))
            texts.insert(texts.end(), names->begin(), names->end());
        else
            texts.push_back(format_param(item));
    }
    if (texts.empty()) return numbers;
    if (numbers.empty()) return texts;
    throw NodeError("a list cannot mix numbers and text");
}

/// One element of a list for element `index` of a mapped node; the last repeats.
std::optional<ParamValue> element_of(const ParamValue& value, std::size_t index)
{
    const auto pick = [&](const auto& list) -> std::optional<ParamValue> {
        if (list.empty()) return std::nullopt;
        return ParamValue(list[std::min(index, list.size() - 1)]);
    };
    if (const auto* numbers = std::get_if<std::vector<double>>(&value)) return pick(*numbers);
    if (const auto* texts = std::get_if<std::vector<std::string>>(&value)) return pick(*texts);
    return std::nullopt;
}

ParamValues Planner::node_params(const Scope& scope, const GraphNode& node,
                                 const std::vector<ParamInfo>& infos,
                                 std::optional<std::size_t> mapped_index)
{
    ParamValues values;
    for (const ParamInfo& info : infos) values[info.name] = info.default_value;
    for (const Argument& argument : node.arguments) {
        if (argument.is_port) continue;
        const auto info =
            std::ranges::find_if(infos, [&](const ParamInfo& p) { return p.name == argument.key; });
        if (info == infos.end()) continue;
        try {
            ParamValue value;
            if (argument.items_are_list) {
                std::vector<ParamValue> items;
                for (const auto& item : argument.items) items.push_back(item_value(scope, item));
                value = gather(items);
            } else {
                value = item_value(scope, argument.items.front());
            }
            const bool wants_list =
                info->type == ParamType::reals || info->type == ParamType::texts;
            if (!wants_list) {
                const std::optional<ParamValue> element =
                    element_of(value, mapped_index.value_or(0));
                if (element && !mapped_index && argument.items.size() > 1)
                    throw NodeError(
                        "parameter '" + info->name +
                        "' takes one value here: a list goes element by element over a node "
                        "that is mapped over a list, and this one is not");
                if (element) value = *element;
                // A whole number that came through a list of numbers is an integer again.
                if (const auto* d = std::get_if<double>(&value);
                    d && info->type == ParamType::integer &&
                    *d == static_cast<double>(static_cast<std::int64_t>(*d)))
                    value = static_cast<std::int64_t>(*d);
            }
            values[info->name] = check_param(*info, value);
        } catch (const NodeError& e) {
            problem(argument.value_where, "node '" + node.id + "' (" + node.op + "): " + e.what());
        }
    }
    return values;
}

// ------------------------------------------------------------------------------- making ops

int Planner::add_stream(Stream stream)
{
    const int id = static_cast<int>(m_plan.streams.size());
    if (stream.origins.empty())
        for (int c = 0; c < stream.desc.channel_count(); ++c) stream.origins.push_back({id, c});
    m_plan.streams.push_back(std::move(stream));
    return id;
}

std::optional<std::map<std::string, Value, std::less<>>> Planner::add_op(NewOp request)
{
    if (m_plan.ops.size() >= max_ops)
        throw GraphError(Problem{request.where, "the graph expands to more than " +
                                                    std::to_string(max_ops) + " nodes"});
    const auto stream_of = [&](int id) -> Stream& {
        return m_plan.streams[static_cast<std::size_t>(id)];
    };
    const std::string title = "node '" + request.id + "' (" + request.name + ")";

    std::map<std::string, PlannedInput, std::less<>> planned;
    for (const PortInfo& port : request.inputs) {
        PlannedInput& in = planned[port.name];
        in.kind = port.kind;
        const auto argument = request.arguments.find(port.name);
        if (argument == request.arguments.end()) continue;
        in.connected = true;
        for (const int s : argument->second.streams) {
            in.images.push_back(stream_of(s).desc);
            if (request.crop)
                in.images.back().data = in.images.back().data.intersect(*request.crop);
        }
        if (m_options.skip)
            in.black = [this, streams = argument->second.streams](std::size_t e) {
                return e < streams.size() && stream_black(streams[e]);
            };
    }

    PlanContext context(std::move(planned));
    try {
        request.node->plan(context);
    } catch (const NodeError& e) {
        problem(request.where, title + ": " + e.what());
        return std::nullopt;
    } catch (const InputError& e) {
        m_input_errors.push_back(title + ": " + e.what());
        return std::nullopt;
    }
    PlanResult result = context.result();

    std::size_t elements = 1;
    bool first = true;
    for (const PortInfo& port : request.outputs) {
        if (port.kind == PortKind::table) continue;
        const auto out = result.outputs.find(port.name);
        if (out == result.outputs.end()) {
            if (!port.required) continue;
            throw Error(title + ": plan() did not declare output '" + port.name + "'");
        }
        if (!first && out->second.size() != elements)
            throw Error(title + ": outputs differ in their number of elements");
        elements = out->second.size();
        first = false;
    }
    if (first && !result.sink) elements = result.reduction ? 0 : 1;

    // The op's key: what it is, and what comes in.
    std::string key =
        request.name + "\n" + std::to_string(request.info ? request.info->version : 1) + "\n";
    for (const auto& [name, value] : request.params) key += name + "=" + format_param(value) + "\n";
    key += request.node->content_key(!m_options.cache_folder.empty()) + "\n";
    for (const auto& [port, value] : request.arguments) {
        key += port + ":";
        for (const int s : value.streams) key += stream_of(s).key() + ",";
        for (const auto& t : value.tables)
            key += m_plan.ops[static_cast<std::size_t>(t.op)].key + "." + t.port + ",";
        key += "\n";
    }
    key = digest(key);

    const int op_index = static_cast<int>(m_plan.ops.size());
    PlannedOp op;
    op.id = request.id;
    op.op = request.name;
    op.where = request.where;
    op.info = request.info;
    op.version = request.info ? request.info->version : 1;
    op.params = request.params;
    op.key = key;
    for (const std::string& note : result.notes) m_plan.notes.push_back(title + ": " + note);
    for (const auto& [port, value] : request.arguments)
        for (const auto& t : value.tables) op.table_inputs.push_back({port, t.op, t.port});

    std::vector<WorkItem::Input> inputs;
    for (const PortInfo& port : request.inputs) {
        const auto argument = request.arguments.find(port.name);
        if (argument == request.arguments.end() || argument->second.kind == PortKind::table)
            continue;
        inputs.push_back({port.name, port.kind, argument->second.streams});
    }

    std::map<std::string, Value, std::less<>> values;
    const auto argument_stream = [&](const std::string& port, std::size_t element) {
        return request.arguments.at(port).streams.at(element);
    };
    for (std::size_t element = 0; element < elements; ++element) {
        WorkItem item;
        item.op = op_index;
        item.element = element;
        item.inputs = inputs;
        const int item_index = static_cast<int>(m_plan.items.size());
        if (result.sink) item.window = *result.sink;
        for (const PortInfo& port : request.outputs) {
            const auto out = result.outputs.find(port.name);
            if (port.kind == PortKind::table || out == result.outputs.end()) continue;
            const ImageDesc& desc = out->second[element];
            if (!item.window.empty() && item.window != desc.data)
                throw Error(title + ": outputs differ in their data windows");
            item.window = desc.data;
            Value& value = values[port.name];
            value.kind = port.kind == PortKind::list ? PortKind::image : port.kind;
            value.list = port.kind == PortKind::list;

            const auto alias =
                std::ranges::find_if(result.aliases, [&](const PlanResult::Alias& a) {
                    return a.output == port.name && a.output_element == element;
                });
            if (alias != result.aliases.end()) {
                const int source = argument_stream(alias->input, alias->input_element);
                if (m_options.skip) {
                    value.streams.push_back(source);
                    continue;
                }
                // No shortcuts: the pass-through becomes a copy.
                NewOp copy;
                copy.id = request.id + (elements > 1 ? "[" + std::to_string(element) + "]" : "") +
                          " copy";
                copy.name = "copy";
                copy.where = request.where;
                copy.node = std::make_unique<CopyNode>();
                copy.inputs = {{"image", PortKind::image, true, ""}};
                copy.outputs = {{"image", PortKind::image, true, ""}};
                Value from;
                from.streams = {source};
                copy.arguments["image"] = from;
                // The copy is planned after this op is in place.
                value.streams.push_back(-1 - static_cast<int>(m_pending.size()));
                m_pending.push_back(std::move(copy));
                continue;
            }
            const auto constant =
                std::ranges::find_if(result.constants, [&](const PlanResult::Constant& c) {
                    return c.output == port.name && c.element == element;
                });
            if (constant != result.constants.end()) {
                NewOp fill;
                fill.id = request.id + " constant";
                fill.name = "constant";
                fill.where = request.where;
                fill.node = std::make_unique<ConstantNode>(desc, constant->value);
                fill.outputs = {{"image", PortKind::image, true, ""}};
                fill.params["value"] = static_cast<double>(constant->value);
                value.streams.push_back(-1 - static_cast<int>(m_pending.size()));
                m_pending.push_back(std::move(fill));
                continue;
            }

            Stream stream;
            stream.kind = port.kind;
            stream.desc = desc;
            stream.item = item_index;
            stream.output = static_cast<int>(item.outputs.size());
            const int id = static_cast<int>(m_plan.streams.size());
            for (int c = 0; c < desc.channel_count(); ++c) {
                stream.channel_keys.push_back(digest(key + "/" + port.name + "/" +
                                                     std::to_string(element) + "/" +
                                                     std::to_string(c)));
                stream.origins.push_back({id, c});
            }
            for (const PlanResult::ChannelAlias& a : result.channel_aliases) {
                if (a.output != port.name || a.output_element != element) continue;
                const Stream& from = stream_of(argument_stream(a.input, a.input_element));
                const auto to = static_cast<std::size_t>(a.output_channel);
                stream.channel_keys[to] =
                    from.channel_keys[static_cast<std::size_t>(a.input_channel)];
                stream.origins[to] = from.origins[static_cast<std::size_t>(a.input_channel)];
            }
            item.outputs.push_back({port.name, id, false});
            value.streams.push_back(add_stream(std::move(stream)));
        }
        if (!item.outputs.empty() || result.sink) m_plan.items.push_back(std::move(item));
    }
    for (const PortInfo& port : request.outputs)
        if (port.kind == PortKind::table) {
            Value& value = values[port.name];
            value.kind = PortKind::table;
            value.tables = {{op_index, port.name}};
        }
    for (const WorkItem::Input& in : inputs) m_op_inputs[op_index][in.port] = in.streams;
    op.result = std::move(result);
    op.node = std::move(request.node);
    m_plan.ops.push_back(std::move(op));

    // Copies and constants that stand in for outputs of this op.
    std::vector<NewOp> pending = std::move(m_pending);
    m_pending.clear();
    std::vector<int> made;
    for (NewOp& p : pending) {
        auto out = add_op(std::move(p));
        made.push_back(out ? out->at("image").streams.front() : -1);
    }
    for (auto& [port, value] : values)
        for (int& s : value.streams)
            if (s < 0) s = made.at(static_cast<std::size_t>(-1 - s));
    return values;
}

std::map<std::string, Value, std::less<>>
Planner::add_node_op(const std::string& id, const std::string& op, ParamValues params,
                     std::map<std::string, Value, std::less<>> arguments,
                     const SourcePosition& where, std::optional<Region> crop)
{
    const NodeInfo* info = Registry::instance().find(op);
    if (!info) throw Error("node '" + op + "' is not built in; is the nodes library whole?");
    NewOp request;
    request.id = id;
    request.name = op;
    request.where = where;
    request.info = info;
    for (const ParamInfo& p : info->params) request.params[p.name] = p.default_value;
    for (auto& [name, value] : params) {
        const ParamInfo* p = info->param(name);
        if (!p) throw Error("node '" + op + "' has no parameter '" + name + "'");
        request.params[name] = check_param(*p, value);
    }
    request.node = info->create(request.params);
    request.inputs = info->inputs;
    request.outputs = info->outputs;
    request.arguments = std::move(arguments);
    request.crop = crop;
    return add_op(std::move(request)).value_or(std::map<std::string, Value, std::less<>>{});
}

// ------------------------------------------------------------------------------- expansion

void Planner::bind_params(const Graph& graph, Scope& scope)
{
    std::vector<std::string> names;
    for (const GraphParam& p : graph.params) {
        names.push_back(p.info.name);
        ParamValue value = p.info.default_value;
        bool given = false;
        try {
            if (const auto it = m_request.params.find(p.info.name); it != m_request.params.end()) {
                value = check_param(p.info, it->second);
                given = true;
            }
            if (const auto it = m_request.param_texts.find(p.info.name);
                it != m_request.param_texts.end()) {
                value = parse_param(p.info, it->second);
                given = true;
            }
        } catch (const NodeError& e) {
            problem(p.where, e.what());
        }
        if (p.info.required && !given)
            problem(p.where, "parameter '" + p.info.name + "' has no default; give it with -p " +
                                 p.info.name + "=…");
        scope.params[p.info.name] = std::move(value);
    }
    const auto check_known = [&](const auto& given) {
        for (const auto& [name, value] : given)
            if (!graph.param(name))
                throw UsageError("graph '" + graph.name + "' has no parameter '" + name + "'" +
                                 suggestion(name, names));
    };
    check_known(m_request.params);
    check_known(m_request.param_texts);
}

Value Planner::bind_input(const GraphInput& input, const InputBinding& binding)
{
    Value value;
    value.kind = input.kind == PortKind::list ? PortKind::image : input.kind;
    value.list = input.kind == PortKind::list;
    if (!binding.images.empty()) {
        if (!value.list && binding.images.size() > 1)
            throw UsageError("input '" + input.name + "' takes one image, not " +
                             std::to_string(binding.images.size()));
        for (const auto& image : binding.images) {
            NewOp source;
            source.id = input.name;
            source.name = "memory";
            source.where = input.where;
            source.node = std::make_unique<MemorySource>(image);
            source.outputs = {{"image", PortKind::image, true, ""}};
            if (auto out = add_op(std::move(source)))
                value.streams.push_back(out->at("image").streams.front());
            else
                value.broken = true;
        }
        return value;
    }
    if (binding.files.empty()) {
        value.absent = true;
        return value;
    }
    if (!value.list && binding.files.size() > 1)
        throw UsageError("input '" + input.name + "' takes one file, not " +
                         std::to_string(binding.files.size()) +
                         " (is a pattern or glob too wide?)");

    ParamValues params;
    const std::string& layer = binding.files.front().layer;
    params["layer"] = layer;
    if (layer.empty() && !input.role.empty()) params["role"] = input.role;
    params["channels"] = input.channels;
    std::string op = "io.read";
    if (value.list) {
        op = "io.stack";
        std::vector<std::string> paths;
        for (const InputFile& file : binding.files) paths.push_back(file.path);
        params["paths"] = paths;
    } else {
        if (input.kind == PortKind::deep) op = "io.read_deep";
        params["path"] = binding.files.front().path;
    }
    const auto out = add_node_op(input.name, op, std::move(params), {}, input.where);
    const auto found = out.find(Registry::instance().find(op)->outputs.front().name);
    if (found == out.end())
        value.broken = true;
    else
        value.streams = found->second.streams;
    return value;
}

void Planner::bind_inputs(const Graph& graph, Scope& scope)
{
    std::vector<std::string> names;
    for (const GraphInput& input : graph.inputs) names.push_back(input.name);
    for (const auto& [name, binding] : m_request.inputs)
        if (!graph.input(name))
            throw UsageError("graph '" + graph.name + "' has no input '" + name + "'" +
                             suggestion(name, names));
    std::vector<std::string> missing;
    for (const GraphInput& input : graph.inputs) {
        const auto given = m_request.inputs.find(input.name);
        Value value;
        if (given == m_request.inputs.end() ||
            (given->second.files.empty() && given->second.images.empty())) {
            value.absent = true;
            value.list = input.kind == PortKind::list;
            if (input.required) missing.push_back(input.name);
        } else {
            value = bind_input(input, given->second);
        }
        scope.values[input.name][""] = value;
        scope.port_order[input.name] = {""};
    }
    if (!missing.empty())
        throw UsageError("graph '" + graph.name + "' needs input" +
                         (missing.size() > 1 ? "s " : " ") + join_names(missing, true) + "; give " +
                         (missing.size() > 1 ? "them" : "it") + " with -i " + missing.front() +
                         "=FILE");
}

void Planner::expand(Scope& scope)
{
    // References first: a node is expanded after the nodes it names.
    std::set<std::string> done;
    std::function<void(const GraphNode&)> visit = [&](const GraphNode& node) {
        if (!done.insert(node.id).second) return;
        const auto visit_ref = [&](const StreamReference& ref) {
            if (const GraphNode* before = scope.graph->node(ref.node)) visit(*before);
        };
        for (const Argument& argument : node.arguments)
            for (const StreamReference& ref : argument.streams) visit_ref(ref);
        if (node.otherwise) visit_ref(*node.otherwise);
        if (node.when) {
            std::function<void(const Expression&)> visit_expression = [&](const Expression& e) {
                if (e.kind == Expression::Kind::call) visit_ref(e.argument);
                for (const Expression& operand : e.operands) visit_expression(operand);
            };
            visit_expression(*node.when);
        }
        expand_node(scope, node);
    };
    for (const GraphNode& node : scope.graph->nodes) visit(node);
}

void Planner::expand_node(Scope& scope, const GraphNode& node)
{
    const NodeInfo* info = node.graph ? nullptr : Registry::instance().find(node.op);
    std::vector<std::string> ports;
    if (node.graph)
        for (const GraphOutput& out : node.graph->outputs) ports.push_back(out.name);
    else if (info)
        for (const PortInfo& out : info->outputs) ports.push_back(out.name);
    scope.port_order[node.id] = ports;
    auto& values = scope.values[node.id];

    if (node.when && !evaluate(*node.when, Facts(*this, scope))) {
        Value absent;
        absent.absent = true;
        if (node.otherwise) absent = lookup(scope, *node.otherwise);
        for (const std::string& port : ports) values[port] = absent;
        m_plan.pruned.push_back({scope.prefix + node.id, "its condition (when:) does not hold"});
        return;
    }
    if (node.graph) {
        expand_graph_node(scope, node);
        return;
    }
    if (!info) {
        problem(node.op_where, "op '" + node.op + "' is not known");
        return;
    }

    const auto mark_broken = [&] {
        Value broken;
        broken.broken = true;
        for (const std::string& port : ports) values[port] = broken;
    };

    // Connected inputs, and the length of the list the node is mapped over, if any.
    std::map<std::string, Value, std::less<>> arguments;
    std::optional<std::size_t> mapped;
    std::string mapped_by;
    for (const Argument& argument : node.arguments) {
        if (!argument.is_port) continue;
        const PortInfo* port = info->input(argument.key);
        Value value = argument_value(scope, argument);
        if (value.broken || !port) return mark_broken();
        if (value.absent) {
            if (port->required) {
                // What the input should come from is not there: neither is this node.
                Value absent;
                absent.absent = true;
                for (const std::string& p : ports) values[p] = absent;
                m_plan.pruned.push_back(
                    {scope.prefix + node.id, "its input '" + argument.key + "' is not there"});
                return;
            }
            continue;
        }
        const bool wants_table = port->kind == PortKind::table,
                   is_table = value.kind == PortKind::table;
        const bool wants_deep = port->kind == PortKind::deep,
                   is_deep = value.kind == PortKind::deep;
        if (wants_table != is_table || wants_deep != is_deep) {
            const auto name = [](PortKind kind) {
                return kind == PortKind::table  ? "figures"
                       : kind == PortKind::deep ? "a deep image"
                                                : "an image";
            };
            problem(argument.value_where, "node '" + node.id + "' (" + node.op + "): input '" +
                                              argument.key + "' wants " + name(port->kind) +
                                              ", not " + name(value.kind));
            return mark_broken();
        }
        if (value.list && port->kind != PortKind::list) {
            if (mapped && *mapped != value.count()) {
                problem(argument.value_where, "node '" + node.id + "' (" + node.op + "): input '" +
                                                  argument.key + "' is a list of " +
                                                  std::to_string(value.count()) + " where '" +
                                                  mapped_by + "' has " + std::to_string(*mapped));
                return mark_broken();
            }
            mapped = value.count();
            mapped_by = argument.key;
        }
        arguments[argument.key] = std::move(value);
    }

    const std::string id = scope.prefix + node.id;
    const auto make_one = [&](std::optional<std::size_t> index)
        -> std::optional<std::map<std::string, Value, std::less<>>> {
        NewOp request;
        request.id = index ? id + "[" + std::to_string(*index) + "]" : id;
        request.name = node.op;
        request.where = node.where;
        request.info = info;
        const std::size_t before = m_problems.size();
        request.params = node_params(scope, node, info->params, index);
        if (m_problems.size() != before) return std::nullopt;
        request.node = info->create(request.params);
        request.inputs = info->inputs;
        request.outputs = info->outputs;
        for (const auto& [key, value] : arguments) {
            Value v = value;
            if (index && value.list && info->input(key)->kind != PortKind::list) {
                if (value.kind == PortKind::table)
                    v.tables = {value.tables[*index]};
                else
                    v.streams = {value.streams[*index]};
                v.list = false;
            }
            request.arguments[key] = std::move(v);
        }
        return add_op(std::move(request));
    };

    if (!mapped) {
        auto out = make_one(std::nullopt);
        if (!out) return mark_broken();
        values = std::move(*out);
        for (const std::string& port : ports)
            if (!values.contains(port)) values[port].absent = true;
        return;
    }
    for (const std::string& port : ports) values[port].list = true;
    for (std::size_t i = 0; i < *mapped; ++i) {
        const auto out = make_one(i);
        if (!out) return mark_broken();
        for (const auto& [port, value] : *out) {
            if (value.list) {
                problem(
                    node.where,
                    "node '" + node.id + "' (" + node.op +
                        ") makes a list and is mapped over one; lists of lists are not supported");
                return mark_broken();
            }
            Value& whole = values[port];
            whole.kind = value.kind;
            whole.streams.insert(whole.streams.end(), value.streams.begin(), value.streams.end());
            whole.tables.insert(whole.tables.end(), value.tables.begin(), value.tables.end());
        }
    }
    for (const std::string& port : ports)
        if (values[port].count() == 0) values[port].absent = true;
}

void Planner::expand_graph_node(Scope& scope, const GraphNode& node)
{
    const Graph& inner = *node.graph;
    auto& values = scope.values[node.id];

    std::map<std::string, Value, std::less<>> arguments;
    std::optional<std::size_t> mapped;
    for (const Argument& argument : node.arguments) {
        if (!argument.is_port) continue;
        Value value = argument_value(scope, argument);
        const GraphInput* input = inner.input(argument.key);
        if (!input) continue;
        if (value.list && input->kind != PortKind::list && !value.absent && !value.broken) {
            if (mapped && *mapped != value.count()) {
                problem(argument.value_where, "node '" + node.id + "' (" + node.op + "): input '" +
                                                  argument.key + "' is a list of " +
                                                  std::to_string(value.count()) +
                                                  " where another has " + std::to_string(*mapped));
                return;
            }
            mapped = value.count();
        }
        arguments[argument.key] = std::move(value);
    }

    std::vector<ParamInfo> infos;
    for (const GraphParam& p : inner.params) infos.push_back(p.info);
    for (std::size_t i = 0; i < mapped.value_or(1); ++i) {
        Scope sub;
        sub.graph = &inner;
        sub.prefix = scope.prefix + node.id + (mapped ? "[" + std::to_string(i) + "]/" : "/");
        sub.params = node_params(scope, node, infos, mapped ? std::optional(i) : std::nullopt);
        for (const GraphInput& input : inner.inputs) {
            Value value;
            value.absent = true;
            value.list = input.kind == PortKind::list;
            if (const auto it = arguments.find(input.name); it != arguments.end()) {
                value = it->second;
                if (mapped && value.list && input.kind != PortKind::list) {
                    value.streams = {value.streams[i]};
                    value.list = false;
                }
            }
            sub.values[input.name][""] = std::move(value);
            sub.port_order[input.name] = {""};
        }
        expand(sub);
        for (const GraphOutput& output : inner.outputs) {
            Value value = lookup(sub, output.stream);
            if (!mapped) {
                values[output.name] = std::move(value);
                continue;
            }
            Value& whole = values[output.name];
            whole.list = true;
            whole.kind = value.kind;
            whole.absent = value.absent;
            whole.broken |= value.broken || value.list;
            whole.streams.insert(whole.streams.end(), value.streams.begin(), value.streams.end());
            whole.tables.insert(whole.tables.end(), value.tables.begin(), value.tables.end());
        }
    }
}

// ------------------------------------------------------------------------------- outputs

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

void Planner::add_output(const GraphOutput& declared, const OutputBinding* binding,
                         const Value& value)
{
    PlannedOutput out;
    out.name = declared.name;
    if (binding) out.binding = *binding;
    if (value.kind == PortKind::table) {
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
        one.streams = {value.streams[i]};
        const std::size_t before = m_plan.items.size();
        if (image.binding.path.empty()) {
            image.in_memory = true;
            NewOp sink;
            sink.id = declared.name;
            sink.name = "memory";
            sink.where = declared.where;
            sink.node = std::make_unique<MemorySink>();
            sink.inputs = {{"image", PortKind::image, true, ""}};
            sink.arguments["image"] = one;
            sink.crop = m_request.roi;
            add_op(std::move(sink));
        } else {
            ParamValues params;
            params["path"] = image.binding.path;
            params["type"] = image.binding.type;
            params["compression"] = image.binding.compression;
            params["layer"] = image.binding.layer;
            params["template"] = image.binding.pass_through_from;
            add_node_op(declared.name, "io.write", std::move(params), {{"image", one}},
                        declared.where, m_request.roi);
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
        if (m_request.roi && value.kind == PortKind::image)
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
}

// ------------------------------------------------------------------------------- facts from pixels

bool Planner::channel_black(int stream, int channel)
{
    const Stream::Origin origin =
        m_plan.streams[static_cast<std::size_t>(stream)].origins[static_cast<std::size_t>(channel)];
    const auto key = std::pair{origin.stream, origin.channel};
    if (const auto it = m_black.find(key); it != m_black.end()) return it->second;
    const Stream& source = m_plan.streams[static_cast<std::size_t>(origin.stream)];
    const WorkItem& item = m_plan.items[static_cast<std::size_t>(source.item)];
    // Only what comes straight from a reader is looked at; anything else is not known to be black.
    if (!item.inputs.empty() || source.kind != PortKind::image) return m_black[key] = false;

    class NoServices final : public RunServices
    {
        bool cancelled() const noexcept override { return false; }
        bool may_skip() const noexcept override { return true; }
        void count_skip(std::string_view, std::size_t) override {}
        void count(std::string_view, std::size_t) override {}
    } services;
    const PlannedOp& op = m_plan.ops[static_cast<std::size_t>(item.op)];
    const int step = std::max(64, op.result.row_alignment);
    std::vector<bool> black(source.desc.channels.size(), true);
    for (int y = item.window.y0; y < item.window.y1; y += step) {
        const Region rows{item.window.x0, y, item.window.x1, std::min(item.window.y1, y + step)};
        ImageBuffer pixels(rows, source.desc.channel_count());
        const TileContext::Output out{item.outputs[static_cast<std::size_t>(source.output)].port,
                                      pixels.view()};
        op.node->compute(TileContext(rows, item.element, {}, {&out, 1}, services));
        for (int c = 0; c < pixels.channels(); ++c)
            for (int row = rows.y0; row < rows.y1 && black[static_cast<std::size_t>(c)]; ++row)
                for (const float v : std::as_const(pixels).view().row_span(c, row))
                    if (v != 0.0f) black[static_cast<std::size_t>(c)] = false;
        if (std::ranges::none_of(black, [](bool b) { return b; })) break;
    }
    for (int c = 0; c < source.desc.channel_count(); ++c)
        m_black[{origin.stream, c}] = black[static_cast<std::size_t>(c)];
    return m_black[key];
}

bool Planner::stream_black(int stream)
{
    const int channels = m_plan.streams[static_cast<std::size_t>(stream)].desc.channel_count();
    for (int c = 0; c < channels; ++c)
        if (!channel_black(stream, c)) return false;
    return channels > 0;
}

// ------------------------------------------------------------------------------- pruning

void Planner::prune()
{
    std::vector<int> queue;
    const auto need_item = [&](int i) {
        WorkItem& item = m_plan.items[static_cast<std::size_t>(i)];
        if (!item.needed) {
            item.needed = true;
            queue.push_back(i);
        }
    };
    std::vector<int> op_queue;
    const auto need_op = [&](int o) {
        PlannedOp& op = m_plan.ops[static_cast<std::size_t>(o)];
        if (!op.needed) {
            op.needed = true;
            op_queue.push_back(o);
        }
    };
    const auto need_stream = [&](int s) {
        const Stream& stream = m_plan.streams[static_cast<std::size_t>(s)];
        WorkItem& item = m_plan.items[static_cast<std::size_t>(stream.item)];
        item.outputs[static_cast<std::size_t>(stream.output)].wanted = true;
        need_item(stream.item);
    };
    for (const PlannedOutput& out : m_plan.outputs) {
        if (out.sink_item >= 0) need_item(out.sink_item);
        if (out.table_op >= 0) need_op(out.table_op);
    }
    if (!m_options.skip)
        for (std::size_t s = 0; s < m_plan.streams.size(); ++s) need_stream(static_cast<int>(s));
    while (!queue.empty() || !op_queue.empty()) {
        if (!queue.empty()) {
            const WorkItem& item = m_plan.items[static_cast<std::size_t>(queue.back())];
            queue.pop_back();
            if (item.source) continue;
            need_op(item.op);
            for (const WorkItem::Input& in : item.inputs)
                for (const int s : in.streams) need_stream(s);
            continue;
        }
        const PlannedOp& op = m_plan.ops[static_cast<std::size_t>(op_queue.back())];
        const int op_index = op_queue.back();
        op_queue.pop_back();
        for (const PlannedOp::TableInput& t : op.table_inputs) need_op(t.op);
        if (op.result.reduction && !op.cached_totals) {
            for (const auto& [port, streams] : m_reduce_streams.at(op_index))
                for (const int s : streams) need_stream(s);
        }
    }
}

void Planner::choose_inlined()
{
    // How often each stream is read, and by whom.
    std::vector<int> uses(m_plan.streams.size(), 0);
    std::vector<bool> keep(m_plan.streams.size(), false);
    for (const WorkItem& item : m_plan.items) {
        if (!item.needed || item.source) continue;
        const PlanResult& result = m_plan.ops[static_cast<std::size_t>(item.op)].result;
        for (const WorkItem::Input& in : item.inputs)
            for (const int s : in.streams) {
                ++uses[static_cast<std::size_t>(s)];
                // A reader with a halo, a writer or a global node wants rows that stay.
                if (result.access != Access::tiles || result.needs.contains(in.port))
                    keep[static_cast<std::size_t>(s)] = true;
            }
    }
    for (const auto& [op, ports] : m_reduce_streams)
        if (m_plan.ops[static_cast<std::size_t>(op)].needed &&
            !m_plan.ops[static_cast<std::size_t>(op)].cached_totals)
            for (const auto& [port, streams] : ports)
                for (const int s : streams) keep[static_cast<std::size_t>(s)] = true;
    for (WorkItem& item : m_plan.items) {
        if (!item.needed || item.source || item.outputs.empty()) continue;
        const PlannedOp& op = m_plan.ops[static_cast<std::size_t>(item.op)];
        if (op.result.access != Access::tiles) continue;
        const auto wanted = std::ranges::count_if(item.outputs, &WorkItem::Output::wanted);
        if (wanted != 1) continue;
        const auto out = std::ranges::find_if(item.outputs, &WorkItem::Output::wanted);
        const auto s = static_cast<std::size_t>(out->stream);
        item.inlined = uses[s] == 1 && !keep[s] && m_plan.streams[s].kind != PortKind::deep;
    }
}

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

Plan Planner::make(const Graph& graph)
{
    m_plan.graph_name = graph.name;
    Scope scope;
    scope.graph = &graph;
    bind_params(graph, scope);
    bind_inputs(graph, scope);
    expand(scope);
    plan_outputs(graph, scope);
    if (!m_problems.empty()) {
        // A mistake that shows in every element of a mapped node is one mistake.
        std::vector<Problem> unique;
        for (Problem& p : m_problems)
            if (std::ranges::none_of(unique,
                                     [&](const Problem& q) { return q.text() == p.text(); }))
                unique.push_back(std::move(p));
        for (std::string& e : m_input_errors) unique.push_back({{}, std::move(e)});
        throw GraphError(std::move(unique));
    }
    if (!m_input_errors.empty()) {
        std::string all;
        for (const std::string& e : m_input_errors) all += (all.empty() ? "" : "\n") + e;
        throw InputError(all);
    }
    describe_files(graph);
    // Streams a reduction reads, by port.
    for (std::size_t o = 0; o < m_plan.ops.size(); ++o) {
        const PlannedOp& op = m_plan.ops[o];
        if (!op.result.reduction) continue;
        auto& ports = m_reduce_streams[static_cast<int>(o)];
        for (const auto& [port, needs] : op.result.reduce_needs)
            ports[port] = m_op_inputs.at(static_cast<int>(o)).at(port);
    }
    m_plan.op_inputs = std::move(m_op_inputs);
    prune();
    if (m_options.skip && !m_options.cache_folder.empty()) {
        apply_cache(m_plan, m_options.cache_folder);
        for (WorkItem& item : m_plan.items) {
            item.needed = false;
            for (WorkItem::Output& out : item.outputs) out.wanted = false;
        }
        for (PlannedOp& op : m_plan.ops) op.needed = false;
        prune();
    }
    for (const PlannedOp& op : m_plan.ops) {
        const bool said =
            std::ranges::any_of(m_plan.pruned, [&](const PrunedNode& p) { return p.id == op.id; });
        if (!op.needed && op.info && !said)
            m_plan.pruned.push_back({op.id, "nothing that runs needs it"});
    }
    choose_inlined();
    return std::move(m_plan);
}

} // namespace

std::string PlannedOp::title() const { return "node '" + id + "' (" + op + ")"; }

std::string Stream::key() const
{
    std::string text = desc.data.text() + desc.display.text();
    for (std::size_t c = 0; c < channel_keys.size(); ++c)
        text += "\n" + desc.channels[c] + " " + channel_keys[c];
    return digest(text);
}

Plan make_plan(const Graph& graph, const RunRequest& request, const RunOptions& options)
{
    return Planner(request, options).make(graph);
}

} // namespace rayloom
