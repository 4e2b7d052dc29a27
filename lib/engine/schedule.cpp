// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/schedule.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"
#include "rayloom/engine/band.h"
#include "rayloom/image/deep_rows.h"
#include "rayloom/image/exr_reader.h"

#include <tbb/info.h>

#include <algorithm>
#include <functional>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <utility>

namespace rayloom
{

namespace
{

/// Rows a strip has when memory is not the question: tall enough that the rows at its seams do not
/// matter to the tiles, low enough that intermediates of a large frame stay small.
constexpr int comfortable_strip = 256;
/// Deep rows of a strip hold about this much where that leaves enough rows for all threads.
constexpr std::size_t comfortable_deep_bytes = std::size_t{64} << 20;
constexpr int least_deep_rows = 16;

std::size_t index(int i) { return static_cast<std::size_t>(i); }

/// Region clipped to what exists, with whole rows or the whole window where the item wants them.
Region shaped(const Plan& plan, const WorkItem& item, Region r)
{
    r = r.intersect(item.window);
    if (r.empty()) return {};
    const auto [access, a, whole_rows] = plan.access_of(item);
    if (access == Access::whole) return item.window;
    if (whole_rows) {
        const int y0 = item.window.y0;
        return Region{item.window.x0, y0 + (r.y0 - y0) / a * a, item.window.x1,
                      y0 + (r.y1 - y0 + a - 1) / a * a}
            .intersect(item.window);
    }
    return r;
}

std::size_t bytes_of_deep_row(const Stream& stream)
{
    return deep_row_bytes(stream.desc.data.width(), stream.desc.channel_count(),
                          stream.row_samples);
}

class Demand
{
public:
    explicit Demand(const Plan& plan) : m_plan(plan), m_regions(plan.items.size()) {}

    void add_root(const SweepRoot& root, const Region& rows)
    {
        if (rows.empty()) return;
        if (root.item >= 0) {
            m_regions[index(root.item)] = m_regions[index(root.item)].hull(rows);
            return;
        }
        const PlannedOp& op = m_plan.ops[index(root.reduction_op)];
        const auto& inputs = m_plan.op_inputs.at(root.reduction_op);
        for (const auto& [port, needs] : op.result.reduce_needs) {
            const auto& streams = inputs.at(port);
            for (std::size_t e = 0; e < streams.size(); ++e) ask(streams[e], needs({e, 0, rows}));
        }
    }
    /// Hands demands on from consumers to producers. `held` (may be null): rows an item has
    /// already; a demand apart from them is grown until it touches, so that bands stay one
    /// interval.
    /// `available` (may be null): rows an item will have in memory by then; what it holds it need
    /// not make again, so its producers are not asked.
    void propagate(const std::vector<Region>* held = nullptr,
                   const std::vector<Region>* available = nullptr)
    {
        for (std::size_t i = m_plan.items.size(); i-- > 0;) {
            const WorkItem& item = m_plan.items[i];
            Region r = shaped(m_plan, item, m_regions[i]);
            if (!r.empty() && held && !(*held)[i].empty()) {
                const Region& h = (*held)[i];
                if (r.y0 > h.y1) r.y0 = h.y1;
                if (r.y1 < h.y0) r.y1 = h.y0;
            }
            m_regions[i] = r;
            if (!item.inlined && available && (*available)[i].contains(r)) continue;
            if (r.empty() || item.source) continue;
            const PlanResult& result = m_plan.ops[index(item.op)].result;
            for (const WorkItem::Input& in : item.inputs) {
                const auto needs = result.needs.find(in.port);
                for (std::size_t e = 0; e < in.streams.size(); ++e)
                    ask(in.streams[e],
                        needs == result.needs.end() ? r : needs->second({e, item.element, r}));
            }
        }
    }
    const std::vector<Region>& regions() const { return m_regions; }

private:
    void ask(int stream, const Region& r)
    {
        const Stream& s = m_plan.streams[index(stream)];
        Region& region = m_regions[index(s.item)];
        region = region.hull(r.intersect(m_plan.items[index(s.item)].window));
    }

    const Plan& m_plan;
    std::vector<Region> m_regions;
};

Region strip_rows(const SweepRoot& root, int strip, int strips)
{
    const auto cut = [&](int k) {
        const auto rows = static_cast<std::int64_t>(root.domain.height()) * k / strips;
        const int aligned =
            k == strips ? root.domain.height()
                        : static_cast<int>((rows + root.align - 1) / root.align) * root.align;
        return root.domain.y0 + std::min(aligned, root.domain.height());
    };
    return {root.domain.x0, cut(strip), root.domain.x1, cut(strip + 1)};
}

/// Sweeps in the order they must run: reductions after the reductions they stand on.
std::vector<Sweep> make_sweeps(const Plan& plan)
{
    // The layer of an op: how many reductions must be done before it can compute.
    std::vector<int> layer(plan.ops.size(), 0), own(plan.ops.size(), -1);
    std::vector<std::vector<int>> producers(plan.ops.size());
    for (const WorkItem& item : plan.items) {
        if (!item.needed || item.source) continue;
        for (const WorkItem::Input& in : item.inputs)
            for (const int s : in.streams)
                if (!plan.items[index(plan.streams[index(s)].item)].source)
                    producers[index(item.op)].push_back(
                        plan.items[index(plan.streams[index(s)].item)].op);
    }
    int layers = 0;
    for (std::size_t o = 0; o < plan.ops.size(); ++o) {
        const PlannedOp& op = plan.ops[o];
        if (!op.needed) continue;
        int before = 0;
        for (const int p : producers[o]) before = std::max(before, layer[index(p)]);
        for (const auto& t : op.table_inputs) before = std::max(before, layer[index(t.op)]);
        if (op.result.reduction) {
            for (const auto& [port, needs] : op.result.reduce_needs)
                for (const int s : plan.op_inputs.at(static_cast<int>(o)).at(port)) {
                    const WorkItem& maker = plan.items[index(plan.streams[index(s)].item)];
                    if (!maker.source) before = std::max(before, layer[index(maker.op)]);
                }
            own[o] = before;
            if (!op.cached_totals) ++before;
        }
        layer[o] = before;
        layers = std::max(layers, before);
    }
    std::vector<Sweep> sweeps(static_cast<std::size_t>(layers));
    for (std::size_t o = 0; o < plan.ops.size(); ++o) {
        const PlannedOp& op = plan.ops[o];
        if (!op.needed || !op.result.reduction || op.cached_totals) continue;
        SweepRoot root;
        root.reduction_op = static_cast<int>(o);
        root.domain = op.result.reduction->domain;
        root.align = op.result.reduction->block_rows;
        sweeps[index(own[o])].push_back(root);
    }
    Sweep last;
    for (std::size_t i = 0; i < plan.items.size(); ++i) {
        const WorkItem& item = plan.items[i];
        if (!item.needed) continue;
        const bool sink = plan.ops[index(item.op)].result.sink.has_value();
        if (!sink && plan.skip) continue;
        SweepRoot root;
        root.item = static_cast<int>(i);
        root.domain = item.window;
        if (!sink && item.inlined) continue;
        last.push_back(root);
    }
    if (!last.empty()) sweeps.push_back(std::move(last));
    return sweeps;
}

/// Layers of a file one sweep reads and later ones want: read along, so that the file is unpacked
/// once. Nothing where there are none.
std::optional<std::vector<Sweep>> read_ahead(const Plan& plan, std::vector<Sweep> sweeps)
{
    bool any = false;
    std::vector<std::vector<Region>> demand;
    demand.reserve(sweeps.size());
    for (const Sweep& sweep : sweeps) demand.push_back(total_demand(plan, {sweep}));
    for (std::size_t p = 0; p + 1 < sweeps.size(); ++p) {
        std::set<int> files;
        for (std::size_t i = 0; i < plan.items.size(); ++i)
            if (!demand[p][i].empty()) files.insert(plan.items[i].file);
        for (std::size_t i = 0; i < plan.items.size(); ++i) {
            const WorkItem& item = plan.items[i];
            if (item.file < 0 || !files.contains(item.file)) continue;
            // Rows that are worked on in place must wait for nothing but the file.
            if (item.inputs.size() > 1 || !plan.ops[index(item.op)].table_inputs.empty()) continue;
            Region before, after;
            for (std::size_t q = 0; q < sweeps.size(); ++q) {
                Region& when = q <= p ? before : after;
                when = when.hull(demand[q][i]);
            }
            if (!before.empty() || after.empty()) continue;
            SweepRoot root;
            root.item = static_cast<int>(i);
            root.domain = after;
            sweeps[p].push_back(root);
            demand[p][i] = after;
            any = true;
        }
    }
    if (!any) return std::nullopt;
    return sweeps;
}

/// Follows the walk in bytes.
class MemoryVisitor final : public SweepVisitor
{
public:
    MemoryVisitor(const Plan& plan, const std::vector<Region>& columns)
        : m_plan(plan), m_columns(columns), m_capacity(plan.items.size(), 0),
          m_lo(plan.items.size(), 0), m_hi(plan.items.size(), 0), m_most_rows(plan.items.size(), 0)
    {
    }
    void extend(int i, int lo, int hi, int reserve) override
    {
        auto &l = m_lo[index(i)], &h = m_hi[index(i)];
        const bool fresh = h <= l;
        l = fresh ? lo : std::min(l, lo);
        h = fresh ? hi : std::max(h, hi);
        const int rows = std::max(h - l, m_capacity[index(i)] > 0 ? 0 : reserve);
        m_most_rows[index(i)] = std::max(m_most_rows[index(i)], rows);
        int& capacity = m_capacity[index(i)];
        if (rows > capacity) {
            // While a band of pixels grows, old and new exist side by side.
            if (!m_plan.items[index(i)].deep)
                m_peak = std::max(m_peak, m_bytes + item_bytes(i, rows));
            m_bytes += item_bytes(i, rows) - item_bytes(i, capacity);
            capacity = rows;
        }
        m_peak = std::max(m_peak, m_bytes);
    }
    void compute(const std::vector<RowTask>&) override {}
    void keep(int i, int lo, int hi) override
    {
        auto &l = m_lo[index(i)], &h = m_hi[index(i)];
        l = std::max(l, lo);
        h = std::min(h, hi);
        if (h <= l) {
            l = h = 0;
            m_bytes -= item_bytes(i, m_capacity[index(i)]);
            m_capacity[index(i)] = 0;
        }
    }
    void finish_strip(const SweepRoot&, const Region&) override {}
    void finish_sweep(const Sweep&) override {}
    std::size_t peak() const { return m_peak; }
    const std::vector<int>& most_rows() const { return m_most_rows; }

private:
    std::size_t item_bytes(int i, int rows) const
    {
        std::size_t n = 0;
        if (m_plan.items[index(i)].lent) return 0;
        for (const WorkItem::Output& out : m_plan.items[index(i)].outputs) {
            if (!out.wanted) continue;
            const Stream& stream = m_plan.streams[index(out.stream)];
            n += stream.kind == PortKind::deep
                     ? bytes_of_deep_row(stream) * static_cast<std::size_t>(rows)
                     : Band::bytes_for(stream.desc.channel_count(), m_columns[index(i)].width(),
                                       rows);
        }
        return n;
    }

    const Plan& m_plan;
    const std::vector<Region>& m_columns;
    std::vector<int> m_capacity, m_lo, m_hi, m_most_rows;
    std::size_t m_bytes = 0, m_peak = 0;
};

/// Decoded rows of files that several items read together, of as many as are read at a time.
std::size_t shared_rows(const Plan& plan, int threads)
{
    std::map<int, std::vector<const ImageReader*>> files;
    for (const WorkItem& item : plan.items)
        if (item.needed && item.file >= 0) files[item.file].push_back(plan.file_reader(item));
    std::vector<std::size_t> bytes;
    for (const auto& [file, readers] : files)
        if (readers.size() > 1) bytes.push_back(ImageReader::shared_bytes(readers));
    std::ranges::sort(bytes, std::greater<>());
    const std::size_t n = std::min(bytes.size(), index(threads));
    return std::accumulate(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n),
                           std::size_t{0});
}

/// Scratch one thread may hold while it computes a tile of the item, inlined producers included.
std::size_t tile_scratch(const Plan& plan, const WorkItem& item, const Schedule& schedule)
{
    std::size_t n = plan.ops[index(item.op)].result.scratch_bytes;
    if (item.source) return 0;
    for (const WorkItem::Input& in : item.inputs)
        for (const int s : in.streams) {
            const WorkItem& producer = plan.items[index(plan.streams[index(s)].item)];
            if (producer.inlined && item.in_place != s)
                n += Band::bytes_for(plan.streams[index(s)].desc.channel_count(),
                                     item.deep ? item.window.width() : schedule.tile_width,
                                     schedule.tile_height) +
                     tile_scratch(plan, producer, schedule);
        }
    return n;
}

} // namespace

std::vector<Region> total_demand(const Plan& plan, const std::vector<Sweep>& sweeps)
{
    std::vector<Region> total(plan.items.size());
    for (const Sweep& sweep : sweeps) {
        Demand demand(plan);
        for (const SweepRoot& root : sweep) demand.add_root(root, root.domain);
        demand.propagate();
        for (std::size_t i = 0; i < total.size(); ++i)
            total[i] = total[i].hull(demand.regions()[i]);
    }
    return total;
}

namespace
{

/// Rows that stay in memory after sweep `p` for the sweeps that follow. What an item keeps it need
/// not make again, so its producers keep nothing for it. A band is one interval of rows: where
/// later sweeps want little of what this one makes (a crop of an image that is summed as a whole),
/// keeping it would keep the rest too, and it is made again.
std::vector<Region> kept_for_later(const Plan& plan, const Schedule& schedule, std::size_t p)
{
    const auto split = schedule.sweeps.begin() + static_cast<std::ptrdiff_t>(p) + 1;
    std::vector<Region> made = total_demand(plan, {schedule.sweeps.begin(), split});
    const std::vector<Region> wanted = total_demand(plan, {split, schedule.sweeps.end()});
    for (std::size_t i = 0; i < made.size(); ++i)
        if (4 * wanted[i].height() < 3 * made[i].height()) made[i] = {};
    std::vector<Region> later(made.size());
    for (auto sweep = split; sweep != schedule.sweeps.end(); ++sweep) {
        Demand demand(plan);
        for (const SweepRoot& root : *sweep) demand.add_root(root, root.domain);
        demand.propagate(nullptr, &made);
        for (std::size_t i = 0; i < later.size(); ++i)
            if (!made[i].empty()) later[i] = later[i].hull(demand.regions()[i]);
    }
    return later;
}

} // namespace

void walk(const Plan& plan, const Schedule& schedule, SweepVisitor& visitor)
{
    const std::size_t n = plan.items.size();
    std::vector<Region> held(n);
    for (std::size_t p = 0; p < schedule.sweeps.size(); ++p) {
        const Sweep& sweep = schedule.sweeps[p];
        std::vector<Region> later(n);
        if (schedule.retain && p + 1 < schedule.sweeps.size())
            later = kept_for_later(plan, schedule, p);
        for (int strip = 0; strip < schedule.strips; ++strip) {
            Demand now(plan), rest(plan);
            for (const SweepRoot& root : sweep) {
                now.add_root(root, strip_rows(root, strip, schedule.strips));
                Region after = root.domain;
                after.y0 = strip_rows(root, strip, schedule.strips).y1;
                rest.add_root(root, after);
            }
            now.propagate(&held, &held);
            rest.propagate();
            const std::vector<Region>& demand = now.regions();

            // Readers of each item in this strip; when the last is done, rows go.
            std::vector<int> readers(n, 0);
            const auto each_producer = [&](std::size_t i, const auto& visit) {
                const WorkItem& item = plan.items[i];
                if (item.source) return;
                for (const WorkItem::Input& in : item.inputs)
                    for (const int s : in.streams) visit(index(plan.streams[index(s)].item));
            };
            for (std::size_t i = 0; i < n; ++i)
                if (!demand[i].empty())
                    each_producer(i, [&](std::size_t producer) { ++readers[producer]; });
            std::vector<bool> rooted(n, false);
            for (const SweepRoot& root : sweep) {
                if (root.item >= 0) {
                    rooted[index(root.item)] = true;
                } else {
                    for (const auto& [port, needs] :
                         plan.ops[index(root.reduction_op)].result.reduce_needs)
                        for (const int s : plan.op_inputs.at(root.reduction_op).at(port))
                            rooted[index(plan.streams[index(s)].item)] = true;
                }
            }
            const auto release = [&](std::size_t i) {
                if (held[i].empty()) return;
                const Region keep = rest.regions()[i].hull(later[i]);
                held[i].y0 = std::max(held[i].y0, keep.y0);
                held[i].y1 = std::min(held[i].y1, keep.y1);
                visitor.keep(static_cast<int>(i), keep.y0, keep.y1);
                if (held[i].empty()) held[i] = {};
            };
            std::function<void(std::size_t)> done_reading = [&](std::size_t i) {
                // An inlined item whose reader has its rows already was not counted as a reader.
                if (demand[i].empty()) return;
                each_producer(i, [&](std::size_t producer) {
                    if (--readers[producer] > 0) return;
                    if (plan.items[producer].inlined)
                        done_reading(producer);
                    else if (!rooted[producer])
                        release(producer);
                });
            };

            // Neighbouring items that do not wait for one another run together.
            std::vector<RowTask> batch;
            std::set<std::size_t> in_batch;
            const auto flush = [&] {
                if (!batch.empty()) visitor.compute(batch);
                for (const std::size_t i : in_batch) done_reading(i);
                batch.clear();
                in_batch.clear();
            };
            std::function<bool(std::size_t)> waits = [&](std::size_t i) {
                bool found = false;
                each_producer(i, [&](std::size_t producer) {
                    found |= in_batch.contains(producer) ||
                             (plan.items[producer].inlined && waits(producer));
                });
                return found;
            };
            for (std::size_t i = 0; i < n; ++i) {
                const WorkItem& item = plan.items[i];
                if (demand[i].empty() || item.inlined) continue;
                if (plan.ops[index(item.op)].result.sink) continue;
                if (waits(i)) flush();
                const Region h = held[i];
                Region d = demand[i];
                const int id = static_cast<int>(i);
                // Rows kept for a later sweep pile up to all that sweep reads.
                int reserve = later[i].empty() ? 0 : later[i].hull(d).height();
                if (!schedule.most_rows.empty()) reserve = std::max(reserve, schedule.most_rows[i]);
                if (h.empty()) {
                    visitor.extend(id, d.y0, d.y1, reserve);
                    batch.push_back({id, d.y0, d.y1});
                    held[i] = d;
                } else {
                    if (d.y0 < h.y0 || d.y1 > h.y1)
                        visitor.extend(id, std::min(d.y0, h.y0), std::max(d.y1, h.y1), reserve);
                    if (d.y0 < h.y0) batch.push_back({id, d.y0, h.y0});
                    if (d.y1 > h.y1) batch.push_back({id, h.y1, d.y1});
                    held[i].y0 = std::min(d.y0, h.y0);
                    held[i].y1 = std::max(d.y1, h.y1);
                }
                in_batch.insert(i);
            }
            flush();
            for (const SweepRoot& root : sweep) {
                const Region rows = strip_rows(root, strip, schedule.strips);
                if (!rows.empty()) visitor.finish_strip(root, rows);
                if (root.item >= 0 &&
                    plan.ops[index(plan.items[index(root.item)].op)].result.sink && !rows.empty())
                    done_reading(index(root.item));
            }
            for (std::size_t i = 0; i < n; ++i)
                if (!demand[i].empty() || !held[i].empty()) release(i);
        }
        visitor.finish_sweep(sweep);
        if (!schedule.retain)
            for (std::size_t i = 0; i < n; ++i)
                if (!held[i].empty()) {
                    visitor.keep(static_cast<int>(i), 0, 0);
                    held[i] = {};
                }
    }
}

Schedule make_schedule(const Plan& plan, const RunOptions& options)
{
    Schedule schedule;
    schedule.sweeps = make_sweeps(plan);
    schedule.threads = options.threads > 0 ? options.threads : tbb::info::default_concurrency();
    if (options.tile > 0) schedule.tile_width = schedule.tile_height = options.tile;
    const std::vector<Region> columns = total_demand(plan, schedule.sweeps);

    std::size_t scratch = 0;
    for (const WorkItem& item : plan.items)
        if (item.needed) scratch = std::max(scratch, tile_scratch(plan, item, schedule));
    scratch *= static_cast<std::size_t>(schedule.threads);
    scratch += shared_rows(plan, schedule.threads);

    int height = 1;
    for (const Sweep& sweep : schedule.sweeps)
        for (const SweepRoot& root : sweep) height = std::max(height, root.domain.height());
    const auto estimate = [&](int strips, bool retain) {
        schedule.strips = strips;
        schedule.retain = retain;
        // Once to see how many rows an item comes to hold, once with memory set aside for them.
        schedule.most_rows.clear();
        MemoryVisitor first(plan, columns);
        walk(plan, schedule, first);
        schedule.most_rows = first.most_rows();
        MemoryVisitor visitor(plan, columns);
        walk(plan, schedule, visitor);
        schedule.peak_bytes = visitor.peak() + scratch;
        return schedule.peak_bytes;
    };

    int comfortable = std::max(1, (height + comfortable_strip - 1) / comfortable_strip);
    int most = std::max(height / 8, comfortable);
    std::size_t deep_row = 0;
    for (const Stream& stream : plan.streams) {
        const WorkItem& item = plan.items[index(stream.item)];
        if (stream.kind == PortKind::deep && item.needed &&
            item.outputs[index(stream.output)].wanted)
            deep_row += bytes_of_deep_row(stream);
    }
    if (deep_row > 0) {
        const std::size_t rows = std::clamp<std::size_t>(comfortable_deep_bytes / deep_row,
                                                         least_deep_rows, comfortable_strip);
        comfortable = std::max(comfortable, height / static_cast<int>(rows));
        most = height;
    }
    std::size_t least = estimate(comfortable, true);
    // What is read ahead is kept in memory: it must not be much.
    if (std::optional<std::vector<Sweep>> sweeps = read_ahead(plan, schedule.sweeps)) {
        std::swap(*sweeps, schedule.sweeps);
        const std::size_t bytes = estimate(comfortable, true);
        if (bytes <= least + least / 4 && (options.memory == 0 || bytes <= options.memory))
            return schedule;
        std::swap(*sweeps, schedule.sweeps);
        least = estimate(comfortable, true);
    }
    if (options.memory == 0 || least <= options.memory) return schedule;
    for (const bool retain : {true, false})
        for (int strips = comfortable; strips <= most; strips *= 2) {
            const std::size_t bytes = estimate(strips, retain);
            if (bytes <= options.memory) return schedule;
            least = std::min(least, bytes);
        }
    throw MemoryError("the run needs at least " + format_bytes(least) +
                      " for its pixels; the budget is " + format_bytes(options.memory));
}

} // namespace rayloom
