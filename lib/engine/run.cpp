// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/run.h"

#include "rayloom/core/deep_node.h"
#include "rayloom/core/parallel.h"
#include "rayloom/engine/band.h"
#include "rayloom/engine/cache.h"
#include "rayloom/engine/engine_nodes.h"
#include "rayloom/image/atomic_file.h"
#include "rayloom/image/deep_rows.h"
#include "rayloom/image/exr_reader.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <mutex>

namespace rayloom
{

namespace
{

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start)
{
    return std::chrono::duration<double>(Clock::now() - start).count();
}

std::size_t index(int i) { return static_cast<std::size_t>(i); }

/// Per op: services of its compute() calls, and what they report.
class OpServices final : public RunServices
{
public:
    void bind(const RunOptions& options, const std::atomic<bool>& failed)
    {
        m_options = &options;
        m_failed = &failed;
    }
    bool cancelled() const noexcept override
    {
        return m_options->stop.stop_requested() || m_failed->load();
    }
    bool may_skip() const noexcept override { return m_options->skip; }
    void count_skip(std::string_view reason, std::size_t n) override
    {
        const std::lock_guard lock(m_mutex);
        m_skips[std::string(reason)] += n;
    }
    void count(std::string_view what, std::size_t n) override
    {
        if (n == 0) return;
        const std::lock_guard lock(m_mutex);
        m_counts[std::string(what)] += n;
    }

    std::atomic<std::int64_t> nanoseconds{0};
    std::atomic<std::size_t> pixels{0}, calls{0};
    std::map<std::string, std::size_t> m_skips, m_counts;

private:
    const RunOptions* m_options = nullptr;
    const std::atomic<bool>* m_failed = nullptr;
    std::mutex m_mutex;
};

/// Buffers a thread uses again and again for inlined producers.
class ScratchPool
{
public:
    ImageBuffer take(const Region& region, int channels)
    {
        ImageBuffer buffer;
        if (!m_free.empty()) {
            buffer = std::move(m_free.back());
            m_free.pop_back();
        }
        buffer.reshape(region, channels);
        return buffer;
    }
    void give(ImageBuffer buffer) { m_free.push_back(std::move(buffer)); }

private:
    std::vector<ImageBuffer> m_free;
};

class Runner final : public SweepVisitor
{
public:
    Runner(Plan& plan, const Schedule& schedule, const RunOptions& options)
        : m_plan(plan), m_schedule(schedule), m_options(options), m_services(plan.ops.size()),
          m_bands(plan.streams.size()), m_deep(plan.streams.size()),
          m_deep_bytes(plan.streams.size())
    {
        for (OpServices& s : m_services) s.bind(options, m_failed);
        const std::vector<Region> columns = total_demand(plan, schedule.sweeps);
        for (const WorkItem& item : plan.items)
            for (const WorkItem::Output& out : item.outputs) {
                if (!out.wanted) continue;
                const Stream& stream = plan.streams[index(out.stream)];
                const Region& c = columns[static_cast<std::size_t>(&item - plan.items.data())];
                if (stream.kind == PortKind::deep)
                    m_deep[index(out.stream)].set_window(item.window, stream.desc.channel_count());
                else if (item.lent)
                    m_bands[index(out.stream)] = Band(*item.lent);
                else
                    m_bands[index(out.stream)] = Band(stream.desc.channel_count(), c.x0, c.x1);
            }
        for (const WorkItem& item : plan.items) {
            const Region& c = columns[static_cast<std::size_t>(&item - plan.items.data())];
            if (item.needed && !item.inlined && !item.lent) m_total_work += c.pixels();
        }
        if (!options.cache_folder.empty()) m_cache.emplace(options.cache_folder);
        m_cache_writers.resize(plan.streams.size());
        if (m_cache)
            for (const WorkItem& item : plan.items) open_cache_writers(item, columns);
    }

    void run() { walk(m_plan, m_schedule, *this); }
    void commit_sinks()
    {
        for (const PlannedOutput& out : m_plan.outputs)
            if (out.sink_item >= 0) {
                PlannedOp& op = op_of(m_plan.items[index(out.sink_item)]);
                guarded(op, [&] { op.node->commit(); });
            }
    }
    void abandon_sinks() noexcept
    {
        for (const PlannedOutput& out : m_plan.outputs)
            if (out.sink_item >= 0) op_of(m_plan.items[index(out.sink_item)]).node->abandon();
    }
    void finish_cache()
    {
        for (auto& writer : m_cache_writers)
            if (writer) writer->commit();
    }
    RunReport report(double seconds) const;

    // SweepVisitor
    void extend(int item, int lo, int hi, int reserve) override
    {
        if (m_plan.items[index(item)].lent) return;
        for (const WorkItem::Output& out : m_plan.items[index(item)].outputs) {
            if (!out.wanted) continue;
            if (m_plan.streams[index(out.stream)].kind == PortKind::deep) {
                m_deep[index(out.stream)].extend(lo, hi);
                continue;
            }
            Band& band = m_bands[index(out.stream)];
            const std::size_t before = band.bytes();
            try {
                band.extend(lo, hi, reserve);
            } catch (const MemoryError& e) {
                throw MemoryError(op_of(m_plan.items[index(item)]).title() + ": " + e.what());
            }
            m_bytes += band.bytes() - before;
        }
        m_peak = std::max(m_peak, m_bytes);
    }
    void keep(int item, int lo, int hi) override
    {
        if (m_plan.items[index(item)].lent) return;
        for (const WorkItem::Output& out : m_plan.items[index(item)].outputs) {
            if (!out.wanted) continue;
            if (m_plan.streams[index(out.stream)].kind == PortKind::deep) {
                m_deep[index(out.stream)].keep(lo, hi);
                count_deep(out.stream);
                continue;
            }
            Band& band = m_bands[index(out.stream)];
            const std::size_t before = band.bytes();
            band.keep(lo, hi);
            m_bytes -= before - band.bytes();
        }
    }
    void compute(const std::vector<RowTask>& batch) override;
    void finish_strip(const SweepRoot& root, const Region& rows) override;
    void finish_sweep(const Sweep& sweep) override;

private:
    struct Task {
        int item;
        Region region;
    };

    PlannedOp& op_of(const WorkItem& item) const { return m_plan.ops[index(item.op)]; }

    /// Runs `body`, naming the op in what it throws.
    template <class Body>
    void guarded(const PlannedOp& op, const Body& body)
    {
        const std::string place = op.role == OpRole::node ? op.where.text() : "";
        const std::string prefix = (place.empty() ? "" : place + ": ") + op.title() + ": ";
        try {
            body();
        } catch (const Cancelled&) {
            throw;
        } catch (const InputError& e) {
            throw InputError(prefix + e.what());
        } catch (const OutputError& e) {
            throw OutputError(prefix + e.what());
        } catch (const MemoryError& e) {
            throw MemoryError(prefix + e.what());
        } catch (const std::bad_alloc&) {
            throw MemoryError(prefix + "memory ran out");
        } catch (const std::exception& e) {
            throw Error(prefix + e.what());
        } catch (...) {
            throw Error(prefix + "it threw what is no exception");
        }
    }

    void check_stop() const
    {
        if (m_options.stop.stop_requested()) throw Cancelled();
    }
    void compute_rows(std::span<const Task> together);
    void compute_in_place(const WorkItem& item, const Region& rows);
    void compute_tile(const WorkItem& item, const Region& region);
    void evaluate(const WorkItem& item, const Region& region,
                  std::span<const TileContext::Output> outputs);
    void call_node(const WorkItem& item, const Region& region,
                   std::span<const TileContext::Output> outputs, bool is_reduction,
                   std::span<double> sums);
    void make_deep_rows(const WorkItem& item, const Node& node, const TileContext& context);
    void open_cache_writers(const WorkItem& item, const std::vector<Region>& columns);
    void note_progress(std::size_t pixels);
    /// Brings the bytes of a deep stream up to date: they are known only once its rows are there.
    void count_deep(int stream)
    {
        std::size_t& counted = m_deep_bytes[index(stream)];
        m_bytes -= counted;
        counted = m_deep[index(stream)].bytes();
        m_bytes += counted;
        m_peak = std::max(m_peak, m_bytes);
    }
    void add_block(int op, std::vector<double> block);

    Plan& m_plan;
    const Schedule& m_schedule;
    const RunOptions& m_options;
    std::atomic<bool> m_failed{false};
    std::vector<OpServices> m_services;
    std::vector<Band> m_bands;
    std::vector<DeepBand> m_deep;
    std::vector<std::size_t> m_deep_bytes; ///< of each deep stream, as counted in m_bytes
    std::size_t m_bytes = 0, m_peak = 0;
    std::atomic<std::size_t> m_done{0};
    std::size_t m_total_work = 0;
    std::mutex m_progress_mutex;
    double m_last_progress = -1.0;
    tbb::enumerable_thread_specific<ScratchPool> m_scratch;
    /// Partial sums of a reduction: like a binary counter, two blocks of equal height are combined,
    /// so that the tree depends on the rows alone.
    struct Partial {
        int height = 0;
        std::vector<double> sums;
    };
    std::map<int, std::vector<Partial>> m_partials;
    std::optional<Cache> m_cache;
    std::vector<std::unique_ptr<CacheWriter>> m_cache_writers;
};

void Runner::note_progress(std::size_t pixels)
{
    const std::size_t done = m_done += pixels;
    if (!m_options.progress || m_total_work == 0) return;
    const double share =
        std::min(1.0, static_cast<double>(done) / static_cast<double>(m_total_work));
    const std::unique_lock lock(m_progress_mutex, std::try_to_lock);
    if (!lock || share < m_last_progress + 0.002) return;
    m_last_progress = share;
    m_options.progress(share);
}

// ------------------------------------------------------------------------------- computing

void Runner::call_node(const WorkItem& item, const Region& region,
                       std::span<const TileContext::Output> outputs, bool is_reduction,
                       std::span<double> sums)
{
    PlannedOp& op = op_of(item);
    OpServices& services = m_services[index(item.op)];
    const Node& node = item.source ? *item.source : *op.node;
    const PlanResult& result = op.result;

    std::vector<TileContext::Input> inputs;
    std::vector<std::vector<ConstImageView>> views(item.inputs.size());
    std::vector<DeepView> deep(item.inputs.size());
    std::vector<ImageBuffer> scratch;
    if (!item.source) {
        inputs.reserve(item.inputs.size() + op.table_inputs.size());
        for (std::size_t i = 0; i < item.inputs.size(); ++i) {
            const WorkItem::Input& in = item.inputs[i];
            if (is_reduction && !result.reduce_needs.contains(in.port)) continue;
            TileContext::Input tile_input;
            tile_input.port = in.port;
            for (std::size_t e = 0; e < in.streams.size(); ++e) {
                const Stream& stream = m_plan.streams[index(in.streams[e])];
                const WorkItem& producer = m_plan.items[index(stream.item)];
                if (stream.kind == PortKind::deep) {
                    deep[i] = m_deep[index(in.streams[e])].view();
                    tile_input.deep = {&deep[i], 1};
                    continue;
                }
                if (item.in_place == in.streams[e]) {
                    views[i].push_back(outputs.front().view);
                    continue;
                }
                if (!producer.inlined) {
                    views[i].push_back(std::as_const(m_bands[index(in.streams[e])]).view());
                    continue;
                }
                const Region part = region.intersect(producer.window);
                scratch.push_back(m_scratch.local().take(part, stream.desc.channel_count()));
                views[i].push_back(std::as_const(scratch.back()).view());
                if (part.empty()) continue;
                const TileContext::Output out{
                    producer.outputs[static_cast<std::size_t>(stream.output)].port,
                    scratch.back().view()};
                call_node(producer, part, {&out, 1}, false, {});
            }
            tile_input.images = views[i];
            inputs.push_back(tile_input);
        }
        for (const PlannedOp::TableInput& t : op.table_inputs) {
            TileContext::Input tile_input;
            tile_input.port = t.port;
            tile_input.table = &m_plan.ops[index(t.op)].tables.at(t.source_port);
            inputs.push_back(tile_input);
        }
    }
    const TileContext context(region, item.element, inputs, outputs, services);
    const auto start = Clock::now();
    guarded(op, [&] {
        if (is_reduction)
            node.reduce(context, sums);
        else if (item.deep)
            make_deep_rows(item, node, context);
        else
            node.compute(context);
    });
    services.nanoseconds +=
        std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now() - start).count();
    services.pixels += region.pixels();
    ++services.calls;
    for (ImageBuffer& buffer : scratch) m_scratch.local().give(std::move(buffer));
}

void Runner::make_deep_rows(const WorkItem& item, const Node& node, const TileContext& context)
{
    const WorkItem::Output& out = item.outputs.front();
    const Stream& stream = m_plan.streams[index(out.stream)];
    const auto* maker = dynamic_cast<const DeepNode*>(&node);
    for (int y = context.region().y0; y < context.region().y1; ++y) {
        check_stop();
        DeepRow row = maker ? maker->deep_row(context, y) : node.read_deep_row(y);
        if (!deep_row_fits(row, item.window.width(), stream.desc.channel_count()))
            throw Error("row " + std::to_string(y) + " of deep output '" + out.port +
                        "' does not fit its description");
        m_deep[index(out.stream)].put(y, std::move(row));
    }
}

void Runner::compute_tile(const WorkItem& item, const Region& region)
{
    if (item.deep) {
        call_node(item, region, {}, false, {});
        note_progress(region.pixels());
        return;
    }
    std::vector<TileContext::Output> outputs;
    for (const WorkItem::Output& out : item.outputs)
        if (out.wanted)
            outputs.push_back({out.port, m_bands[index(out.stream)].view().crop(region)});
    call_node(item, region, outputs, false, {});
    for (const WorkItem::Output& out : item.outputs)
        if (const auto& writer = m_cache_writers[index(out.stream)]; out.wanted && writer)
            writer->write(m_bands[index(out.stream)].view().crop(region));
    note_progress(region.pixels());
}

void Runner::compute_rows(std::span<const Task> together)
{
    // Two blocks a thread at a time: enough to decode in parallel, little to hold undecoded, and a
    // stop is noticed soon.
    int align = 1, y0 = together.front().region.y0, y1 = together.front().region.y1;
    for (const Task& task : together) {
        align = std::max(align, m_plan.access_of(m_plan.items[index(task.item)]).alignment);
        y0 = std::min(y0, task.region.y0);
        y1 = std::max(y1, task.region.y1);
    }
    int blocks =
        std::clamp(2 * m_schedule.threads, std::max(1, 64 / align), std::max(1, 512 / align));
    std::vector<const ImageReader*> readers;
    for (const Task& task : together) {
        const WorkItem& item = m_plan.items[index(task.item)];
        if (item.file < 0) continue;
        const ImageReader* const reader = m_plan.file_reader(item);
        if (std::ranges::find(readers, reader) == readers.end()) readers.push_back(reader);
    }
    ImageReader::share_rows(readers);
    if (readers.size() > 1) blocks = std::clamp(readers.front()->rows_at_once() / align, 1, blocks);
    for (int y = y0; y < y1; y += align * blocks) {
        check_stop();
        for (const Task& task : together) {
            Region part = task.region;
            part.y0 = std::max(part.y0, y);
            part.y1 = std::min(part.y1, y + align * blocks);
            if (part.empty()) continue;
            const WorkItem& item = m_plan.items[index(task.item)];
            if (item.in_place < 0)
                compute_tile(item, part);
            else
                compute_in_place(item, part);
        }
    }
    if (readers.size() > 1) readers.front()->rows_end();
}

void Runner::compute_in_place(const WorkItem& item, const Region& rows)
{
    const Stream& read = m_plan.streams[index(item.in_place)];
    const WorkItem& reader = m_plan.items[index(read.item)];
    const WorkItem::Output& from = reader.outputs[index(read.output)];
    const auto own = std::ranges::find_if(item.outputs, &WorkItem::Output::wanted);
    const TileContext::Output target{from.port, m_bands[index(own->stream)].view().crop(rows)};
    call_node(reader, rows, {&target, 1}, false, {});
    const int th = m_schedule.tile_height;
    parallel_for<int>(0, (rows.height() + th - 1) / th, 1, [&](int t) {
        Region part = rows;
        part.y0 = rows.y0 + t * th;
        part.y1 = std::min(rows.y1, part.y0 + th);
        compute_tile(item, part);
    });
}

void Runner::compute(const std::vector<RowTask>& batch)
{
    std::vector<Task> tasks;
    std::vector<std::vector<Task>> row_tasks;
    std::map<int, std::size_t> files; ///< row task of a file
    for (const RowTask& rows : batch) {
        const WorkItem& item = m_plan.items[index(rows.item)];
        if (item.lent) continue;
        Region all{item.window.x0, rows.lo, item.window.x1, rows.hi};
        for (const WorkItem::Output& out : item.outputs)
            if (out.wanted && m_plan.streams[index(out.stream)].kind != PortKind::deep) {
                const Region held = m_bands[index(out.stream)].held();
                all.x0 = held.x0;
                all.x1 = held.x1;
            }
        if (all.empty()) continue;
        const Access access = m_plan.access_of(item).access;
        if (access == Access::rows) {
            // Rows of one file are read together: a block of an EXR is unpacked with all channels.
            const auto known = item.file < 0 ? files.end() : files.find(item.file);
            if (known != files.end()) {
                row_tasks[known->second].push_back({rows.item, all});
            } else {
                if (item.file >= 0) files.emplace(item.file, row_tasks.size());
                row_tasks.push_back({{rows.item, all}});
            }
            continue;
        }
        if (access != Access::tiles) {
            tasks.push_back({rows.item, all});
            continue;
        }
        int tw = m_schedule.tile_width, th = m_schedule.tile_height;
        if (item.deep) { // whole rows, and some for every thread
            tw = all.width();
            th = std::clamp(all.height() / (4 * m_schedule.threads), 1, th);
        }
        for (int y = all.y0; y < all.y1; y += th)
            for (int x = all.x0; x < all.x1; x += tw)
                tasks.push_back(
                    {rows.item, {x, y, std::min(all.x1, x + tw), std::min(all.y1, y + th)}});
    }
    try {
        // Rows first: what reads a file takes longest.
        const std::size_t reads = row_tasks.size();
        parallel_for<std::size_t>(0, reads + tasks.size(), 1, [&](std::size_t t) {
            check_stop();
            if (t < reads)
                compute_rows(row_tasks[t]);
            else
                compute_tile(m_plan.items[index(tasks[t - reads].item)], tasks[t - reads].region);
        });
    } catch (...) {
        m_failed = true;
        throw;
    }
    for (const RowTask& rows : batch)
        for (const WorkItem::Output& out : m_plan.items[index(rows.item)].outputs)
            if (out.wanted && m_plan.streams[index(out.stream)].kind == PortKind::deep)
                count_deep(out.stream);
}

// ------------------------------------------------------------------------------- ends of a sweep

void Runner::add_block(int op, std::vector<double> block)
{
    std::vector<Partial>& stack = m_partials[op];
    Partial carry{0, std::move(block)};
    while (!stack.empty() && stack.back().height == carry.height) {
        m_plan.ops[index(op)].node->combine(stack.back().sums, carry.sums);
        carry = {carry.height + 1, std::move(stack.back().sums)};
        stack.pop_back();
    }
    stack.push_back(std::move(carry));
}

void Runner::finish_strip(const SweepRoot& root, const Region& rows)
{
    check_stop();
    if (root.item >= 0) {
        const WorkItem& item = m_plan.items[index(root.item)];
        if (!op_of(item).result.sink) return;
        call_node(item, rows, {}, false, {});
        note_progress(rows.pixels());
        return;
    }
    const PlannedOp& op = m_plan.ops[index(root.reduction_op)];
    const Reduction& reduction = *op.result.reduction;
    WorkItem item; // the reduction as an item without outputs
    item.op = root.reduction_op;
    for (const auto& [port, streams] : m_plan.op_inputs.at(root.reduction_op))
        item.inputs.push_back({port, PortKind::image, streams});
    const int step = reduction.block_rows;
    const int blocks = (rows.height() + step - 1) / step;
    std::vector<std::vector<double>> sums(static_cast<std::size_t>(blocks));
    parallel_for<int>(0, blocks, std::max(1, 8 / step), [&](int b) {
        check_stop();
        Region part = rows;
        part.y0 = rows.y0 + b * step;
        part.y1 = std::min(rows.y1, part.y0 + step);
        sums[index(b)].assign(reduction.values, 0.0);
        call_node(item, part, {}, true, sums[index(b)]);
    });
    for (auto& block : sums) add_block(root.reduction_op, std::move(block));
}

void Runner::finish_sweep(const Sweep& sweep)
{
    for (const SweepRoot& root : sweep) {
        if (root.reduction_op < 0) continue;
        PlannedOp& op = m_plan.ops[index(root.reduction_op)];
        std::vector<Partial>& stack = m_partials[root.reduction_op];
        std::vector<double> totals(op.result.reduction->values, 0.0);
        if (!stack.empty()) {
            totals = std::move(stack.back().sums);
            for (std::size_t i = stack.size() - 1; i-- > 0;) {
                op.node->combine(stack[i].sums, totals);
                totals = std::move(stack[i].sums);
            }
        }
        m_partials.erase(root.reduction_op);
        if (m_cache) m_cache->store_totals(op.key, totals);
        op.cached_totals = std::move(totals);
    }
    // Hand out totals whose turn has come: a reduction may stand on the tables of another.
    for (PlannedOp& op : m_plan.ops) {
        if (!op.needed || op.finished) continue;
        const bool makes_tables =
            op.info && std::ranges::any_of(op.info->outputs, [](const PortInfo& p) {
                return p.kind == PortKind::table;
            });
        if (op.result.reduction ? !op.cached_totals : !makes_tables) continue;
        std::vector<TileContext::Input> tables;
        bool ready = true;
        for (const PlannedOp::TableInput& t : op.table_inputs) {
            const auto& made = m_plan.ops[index(t.op)].tables;
            const auto it = made.find(t.source_port);
            ready &= it != made.end();
            if (ready) tables.push_back({t.port, {}, {}, &it->second});
        }
        if (!ready) continue;
        const std::vector<double> none;
        guarded(op, [&] {
            op.tables = op.node->finish(op.cached_totals ? *op.cached_totals : none, tables);
        });
        op.finished = true;
    }
}

// ------------------------------------------------------------------------------- cache

void Runner::open_cache_writers(const WorkItem& item, const std::vector<Region>& columns)
{
    if (!item.needed || item.inlined || item.source || item.inputs.empty()) return;
    const PlanResult& result = op_of(item).result;
    if (result.cheap || result.sink) return;
    if (columns[static_cast<std::size_t>(&item - m_plan.items.data())] != item.window) return;
    for (const WorkItem::Output& out : item.outputs) {
        const Stream& stream = m_plan.streams[index(out.stream)];
        if (out.wanted && stream.kind != PortKind::deep)
            m_cache_writers[index(out.stream)] =
                m_cache->writer(stream.key(), item.window, stream.desc.channel_count());
    }
}

// ------------------------------------------------------------------------------- report

RunReport Runner::report(double seconds) const
{
    RunReport r;
    r.graph = m_plan.graph_name;
    r.seconds = seconds;
    r.threads = m_schedule.threads;
    r.strips = m_schedule.strips;
    r.sweeps = static_cast<int>(m_schedule.sweeps.size());
    r.tile_width = m_schedule.tile_width;
    r.tile_height = m_schedule.tile_height;
    r.planned_peak_bytes = m_schedule.peak_bytes;
    r.peak_bytes = m_peak;
    r.notes = m_plan.notes;
    std::map<std::string, std::size_t> by_name;
    for (std::size_t o = 0; o < m_plan.ops.size(); ++o) {
        const PlannedOp& op = m_plan.ops[o];
        if (!op.needed) continue;
        const std::string name =
            op.id.substr(0, op.id.find_last_of('[') == std::string::npos || op.id.back() != ']'
                                ? std::string::npos
                                : op.id.find_last_of('['));
        const auto [it, added] = by_name.emplace(name + "\n" + op.op, r.nodes.size());
        if (added) {
            r.nodes.emplace_back();
            r.nodes.back().id = name;
            r.nodes.back().op = op.op;
        }
        NodeReport& node = r.nodes[it->second];
        const OpServices& s = m_services[o];
        const double op_seconds = static_cast<double>(s.nanoseconds.load()) * 1e-9;
        node.seconds += op_seconds;
        node.pixels += s.pixels;
        node.calls += s.calls;
        for (const auto& [reason, pixels] : s.m_skips) {
            node.skipped[reason] += pixels;
            SkipReport skip{op.id, reason, pixels, -1.0};
            // What the skipped pixels would have cost at the price of the others.
            if (s.pixels > pixels)
                skip.saved_seconds = op_seconds * static_cast<double>(pixels) /
                                     static_cast<double>(s.pixels - pixels);
            r.skips.push_back(std::move(skip));
        }
        for (const auto& [what, n] : s.m_counts) node.counts[what] += n;
        if (op.result.sink)
            r.writing += op_seconds;
        else if (op.result.access == Access::rows)
            r.reading += op_seconds;
        else
            r.computing += op_seconds;
    }
    for (const PrunedNode& p : m_plan.pruned)
        r.skips.push_back({p.id, p.reason, 0, p.saved_seconds});
    return r;
}

} // namespace

RunReport run_plan(Plan& plan, const RunOptions& options)
{
    const Schedule schedule = make_schedule(plan, options);
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                    index(schedule.threads));
    tbb::task_arena arena(schedule.threads);
    set_image_threads(schedule.threads);

    const auto start = Clock::now();
    Runner runner(plan, schedule, options);
    try {
        runner.finish_sweep({});
        arena.execute([&] { runner.run(); });
        if (options.stop.stop_requested()) throw Cancelled();
        runner.commit_sinks();
        runner.finish_cache();
    } catch (...) {
        runner.abandon_sinks();
        throw;
    }
    RunReport report = runner.report(seconds_since(start));
    for (const PlannedOutput& out : plan.outputs) {
        if (out.table_op >= 0) {
            const Table& table = plan.ops[index(out.table_op)].tables.at(out.table_port);
            report.tables[out.name].push_back(table);
            if (!out.binding.path.empty()) {
                write_text_file(out.binding.path, table.json() + "\n");
                report.written.push_back(out.binding.path);
            }
        } else if (out.in_memory && out.deep) {
            auto& sink = dynamic_cast<MemoryDeepSink&>(
                *plan.ops[index(plan.items[index(out.sink_item)].op)].node);
            report.deep[out.name].push_back(sink.take());
        } else if (out.in_memory) {
            auto& sink = dynamic_cast<MemorySink&>(
                *plan.ops[index(plan.items[index(out.sink_item)].op)].node);
            report.images[out.name].push_back(sink.take());
        } else if (!out.binding.path.empty()) {
            report.written.push_back(out.binding.path);
        }
    }
    if (options.progress) options.progress(1.0);
    return report;
}

RunReport run_graph(const Graph& graph, const RunRequest& request, const RunOptions& options)
{
    Plan plan = make_plan(graph, request, options);
    return run_plan(plan, options);
}

} // namespace rayloom
