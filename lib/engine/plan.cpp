// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/plan.h"

#include "rayloom/core/file_source.h"
#include "rayloom/engine/cache.h"
#include "rayloom/engine/engine_nodes.h"
#include "rayloom/engine/planner.h"
#include "rayloom/image/exr_reader.h"

#include <OpenImageIO/hash.h>

#include <algorithm>
#include <cmath>

namespace rayloom
{

namespace planning
{

std::string digest(const std::string& text)
{
    OIIO::SHA1 sha(text.data(), text.size());
    return sha.digest();
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
                    // A negative zero would come out of a filter as a positive one.
                    if (v != 0.0f || std::signbit(v)) black[static_cast<std::size_t>(c)] = false;
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
        item.inlined = uses[s] == 1 && !keep[s] && !item.deep;
    }
    for (WorkItem& item : m_plan.items) choose_in_place(item, uses);
    // Without shortcuts every item makes rows of its own.
    for (WorkItem& item : m_plan.items)
        if (m_options.skip && item.needed && !item.source)
            if (const auto* memory = dynamic_cast<const MemorySource*>(
                    m_plan.ops[static_cast<std::size_t>(item.op)].node.get())) {
                item.lent = memory->pixels();
                item.inlined = false;
            }
}

void Planner::choose_in_place(WorkItem& item, const std::vector<int>& uses)
{
    const auto index = [](int i) { return static_cast<std::size_t>(i); };
    const auto wanted = [](const WorkItem& i) {
        return std::ranges::count_if(i.outputs, &WorkItem::Output::wanted);
    };
    // Without shortcuts every item is kept for itself.
    if (!m_options.skip || !item.needed || item.source || item.inlined || wanted(item) != 1) return;
    const PlanResult& result = m_plan.ops[index(item.op)].result;
    const auto in = std::ranges::find(item.inputs, result.in_place, &WorkItem::Input::port);
    if (result.in_place.empty() || in == item.inputs.end() || in->streams.size() != 1) return;
    const int s = in->streams.front();
    WorkItem& reader = m_plan.items[index(m_plan.streams[index(s)].item)];
    const auto out = std::ranges::find_if(item.outputs, &WorkItem::Output::wanted);
    const ImageDesc& from = m_plan.streams[index(s)].desc;
    const ImageDesc& to = m_plan.streams[index(out->stream)].desc;
    if (reader.source || !reader.inputs.empty() || wanted(reader) != 1 || uses[index(s)] != 1 ||
        m_plan.ops[index(reader.op)].result.access != Access::rows || from.data != to.data ||
        from.channel_count() != to.channel_count())
        return;
    for (const auto& [op, ports] : m_reduce_streams)
        for (const auto& [port, streams] : ports)
            if (m_plan.ops[index(op)].needed && std::ranges::find(streams, s) != streams.end())
                return;
    item.in_place = s;
    reader.inlined = true;
}

/// Rows of one file are read together, as a block of an EXR is unpacked with all its channels.
void Planner::find_files()
{
    if (!m_options.skip) return;
    struct Part {
        int number = 0;
        const ImageReader* reader = nullptr;
    };
    std::map<std::pair<std::string, int>, std::vector<Part>> files;
    int numbers = 0;
    for (WorkItem& item : m_plan.items) {
        if (!item.needed || item.inlined) continue;
        const ImageReader* const reader = m_plan.file_reader(item);
        if (reader == nullptr) continue;
        // One name may stand for two files: one that was replaced while the other was planned.
        std::vector<Part>& parts = files[{reader->file().path(), reader->selection().part}];
        const auto same = std::ranges::find_if(
            parts, [&](const Part& part) { return part.reader->may_share(*reader); });
        item.file = same == parts.end() ? numbers++ : same->number;
        if (same == parts.end()) parts.push_back({item.file, reader});
    }
}

Plan Planner::make(const Graph& written)
{
    m_plan.graph_name = written.name;
    Scope scope;
    bind_params(written, scope);
    const Graph& graph = bind_ops(written, scope);
    scope.graph = &graph;
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
    find_files();
    return std::move(m_plan);
}

} // namespace planning

const ImageReader* Plan::file_reader(const WorkItem& item) const
{
    if (item.source) return nullptr;
    if (item.in_place >= 0) {
        const Stream& read = streams[static_cast<std::size_t>(item.in_place)];
        return file_reader(items[static_cast<std::size_t>(read.item)]);
    }
    const auto* const node =
        dynamic_cast<const FileSource*>(ops[static_cast<std::size_t>(item.op)].node.get());
    return node != nullptr ? &node->reader(item.element) : nullptr;
}

Plan::RowAccess Plan::access_of(const WorkItem& item) const
{
    const auto result = [&](const WorkItem& i) -> const PlanResult& {
        return ops[static_cast<std::size_t>(i.op)].result;
    };
    if (item.source) return {};
    if (item.in_place < 0) {
        const PlanResult& r = result(item);
        return {r.access, r.row_alignment, item.deep || r.access == Access::rows};
    }
    const Stream& read = streams[static_cast<std::size_t>(item.in_place)];
    return {Access::rows, result(items[static_cast<std::size_t>(read.item)]).row_alignment, true};
}

std::string op_title(OpRole role, const std::string& id, const std::string& op)
{
    switch (role) {
    case OpRole::node: return "node '" + id + "' (" + op + ")";
    case OpRole::input: return "input '" + id + "'";
    case OpRole::output: return "output '" + id + "'";
    }
    return id;
}

std::string Stream::key() const
{
    std::string text = desc.data.text() + desc.display.text();
    for (std::size_t c = 0; c < channel_keys.size(); ++c)
        text += "\n" + desc.channels[c] + " " + channel_keys[c];
    return planning::digest(text);
}

Plan make_plan(const Graph& graph, const RunRequest& request, const RunOptions& options)
{
    return planning::Planner(request, options).make(graph);
}

} // namespace rayloom
