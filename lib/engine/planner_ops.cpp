// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/planner.h"

#include "rayloom/core/deep_node.h"
#include "rayloom/core/text.h"
#include "rayloom/engine/engine_nodes.h"

#include <algorithm>
#include <new>

namespace rayloom::planning
{

namespace
{

constexpr std::size_t max_ops = 200'000; // a runaway of nested graphs and lists, not a pipeline

/// Sums and differences of coordinates of such windows fit an int.
bool near_origin(const Region& window)
{
    constexpr int far = 1 << 28;
    return window.x0 >= -far && window.y0 >= -far && window.x1 <= far && window.y1 <= far;
}

} // namespace

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
    const std::string title = op_title(request.role, request.id, request.name);

    std::map<std::string, PlannedInput, std::less<>> planned;
    std::size_t row_samples = 0; // of deep outputs: as the fullest deep input, unless a source
    for (const PortInfo& port : request.inputs) {
        PlannedInput& in = planned[port.name];
        in.kind = port.kind;
        const auto argument = request.arguments.find(port.name);
        if (argument == request.arguments.end()) continue;
        in.connected = true;
        for (const int s : argument->second.streams) {
            in.images.push_back(stream_of(s).desc);
            row_samples = std::max(row_samples, stream_of(s).row_samples);
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
        if (!request.node) request.node = request.info->create(request.params);
        request.node->plan(context);
    } catch (const NodeError& e) {
        problem(request.where, title + ": " + e.what());
        return std::nullopt;
    } catch (const InputError& e) {
        // Where a graph declares an input says nothing about the file it was given.
        const SourcePosition where =
            request.role == OpRole::node ? request.where : SourcePosition{};
        m_input_errors.push_back(Problem{where, title + ": " + e.what()}.text());
        return std::nullopt;
    } catch (const Error&) {
        throw;
    } catch (const std::bad_alloc&) {
        throw MemoryError(title + ": memory ran out");
    } catch (const std::exception& e) {
        throw Error(title + ": " + e.what());
    } catch (...) {
        throw Error(title + ": it threw what is no exception");
    }
    if (const auto* source = dynamic_cast<const DeepSource*>(request.node.get()))
        row_samples = source->row_samples();
    PlanResult result = context.result();
    for (const auto& [port, descs] : result.outputs)
        for (const ImageDesc& desc : descs)
            for (const Region& window : {desc.data, desc.display})
                if (!near_origin(window)) {
                    problem(request.where, title + ": window " + window.text() +
                                               " lies more than 2^28 pixels from the origin; "
                                               "move the image");
                    return std::nullopt;
                }

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
    // In quotes, so that a list of two texts and one text with a comma in it are two keys.
    const auto number = [](double v) { return format_param(v); };
    for (const auto& [name, value] : request.params)
        key += name + "=" + format_param(value, number, json_quote) + "\n";
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
    op.role = request.role;
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
                if (value.kind == PortKind::deep)
                    copy.node = std::make_unique<DeepCopyNode>();
                else
                    copy.node = std::make_unique<CopyNode>();
                copy.inputs = {{"image", value.kind, true, ""}};
                copy.outputs = {{"image", value.kind, true, ""}};
                Value from;
                from.kind = value.kind;
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
            if (port.kind == PortKind::deep) {
                stream.row_samples = row_samples;
                item.deep = true;
            }
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
        if (item.deep && item.outputs.size() > 1)
            throw Error(title + ": a node with a deep output can have no other");
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
Planner::add_node_op(OpRole role, const std::string& id, const std::string& op, ParamValues params,
                     std::map<std::string, Value, std::less<>> arguments,
                     const SourcePosition& where, std::optional<Region> crop)
{
    const NodeInfo* info = Registry::instance().find(op);
    if (!info) throw Error("node '" + op + "' is not built in; is the nodes library whole?");
    NewOp request;
    request.id = id;
    request.name = op;
    request.role = role;
    request.where = where;
    request.info = info;
    for (const ParamInfo& p : info->params) request.params[p.name] = p.default_value;
    for (auto& [name, value] : params) {
        const ParamInfo* p = info->param(name);
        if (!p) throw Error("node '" + op + "' has no parameter '" + name + "'");
        request.params[name] = check_param(*p, value);
    }
    request.inputs = info->inputs;
    request.outputs = info->outputs;
    request.arguments = std::move(arguments);
    request.crop = crop;
    return add_op(std::move(request)).value_or(std::map<std::string, Value, std::less<>>{});
}

} // namespace rayloom::planning
