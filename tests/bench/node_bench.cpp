// SPDX-License-Identifier: Apache-2.0
/// \file
/// Every registered node and every shipped graph, run by the engine on images in memory, over sizes
/// and threads: `fuse.histogram/node/width:1920/height:1080/threads:2`. What a node takes inside a
/// run, tiles, halos and scheduling included, next to its plain version
/// (`fuse.sum/plain_node/160x100`). A new node joins by being there.
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/oracle/plain_nodes.h"
#include "tests/support/made_up_deep.h"
#include "tests/support/made_up_input.h"
#include "tests/support/subjects.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <malloc.h>
#include <span>
#include <string>

namespace rayloom
{
namespace
{

/// Position in a row of `n` pixels and its mirrored copies.
int mirrored(int x, int n)
{
    const int at = x % (2 * n);
    return at < n ? at : 2 * n - 1 - at;
}

/// Mirrored copies of an image, so that a large one costs little time to make and has no seams.
std::shared_ptr<const MemoryImage> enlarged(const MemoryImage& small, int width, int height)
{
    auto large = std::make_shared<MemoryImage>();
    large->desc = small.desc;
    large->desc.data = large->desc.display = Region{0, 0, width, height};
    const int channels = small.desc.channel_count();
    large->pixels = ImageBuffer(large->desc.data, channels);
    const Region from = small.desc.data;
    const ImageView to = large->pixels.view();
    for (int c = 0; c < channels; ++c)
        for (int y = 0; y < height; ++y) {
            const int source = mirrored(y, from.height());
            if (y != source) {
                std::copy_n(to.row(c, source), width, to.row(c, y));
                continue;
            }
            for (int x = 0; x < width; ++x)
                to.at(c, x, y) =
                    small.pixels.view().at(c, from.x0 + mirrored(x, from.width()), from.y0 + y);
        }
    return large;
}

/// The same for deep pixels: rows that come again.
std::shared_ptr<const MemoryDeep> deep_of_size(int width, int height)
{
    constexpr int made = 200;
    const MemoryDeep small = test::made_up_deep(Region{0, 0, width, made});
    auto large = std::make_shared<MemoryDeep>();
    large->desc = small.desc;
    large->desc.data = large->desc.display = Region{0, 0, width, height};
    for (int y = 0; y < height; ++y)
        large->rows.push_back(small.rows[static_cast<std::size_t>(y % made)]);
    return large;
}

void state_work(benchmark::State& state, const oracle::NodeWork& work)
{
    state.counters["flops_per_pixel"] = work.flops;
    state.counters["bytes_per_pixel"] = work.bytes;
}

void run(benchmark::State& state, const Graph& graph, const oracle::NodeWork* work)
{
    const int width = static_cast<int>(state.range(0)), height = static_cast<int>(state.range(1));
    RunRequest request = test::made_up_request(graph, Region{0, 0, 320, 200});
    for (auto& [name, input] : request.inputs) {
        for (auto& image : input.images) image = enlarged(*image, width, height);
        if (input.deep) input.deep = deep_of_size(width, height);
    }
    RunOptions options;
    options.threads = static_cast<int>(state.range(2));
    // The first runs pay for pages that the next ones find. Where a node moves more than it
    // computes, that would be most of its time; of what takes seconds it is little.
    const double pixels = static_cast<double>(width) * height;
    double warm_up = 0.0;
    for (int i = 0; i < 2 && work && work->flops * pixels < 2e9 && warm_up < 0.5; ++i)
        warm_up += run_graph(graph, request, options).seconds;
    for (auto _ : state) benchmark::DoNotOptimize(run_graph(graph, request, options));
    state.SetItemsProcessed(state.iterations() * width * height);
    if (work) state_work(state, *work);
}

void run_plain(benchmark::State& state, const Graph& graph, const oracle::NodeWork& work,
               const Region& window)
{
    oracle::PlainInput input;
    for (const auto& [name, binding] : test::made_up_request(graph, window).inputs)
        for (const auto& image : binding.images) {
            const Region& r = image->desc.data;
            oracle::Raster<double> raster(r.width(), r.height(), image->desc.channel_count());
            for (int c = 0; c < raster.channels; ++c)
                for (int y = 0; y < raster.height; ++y)
                    for (int x = 0; x < raster.width; ++x)
                        raster.at(c, x, y) = image->pixels.view().at(c, r.x0 + x, r.y0 + y);
            input.bound[name].push_back(std::move(raster));
        }
    for (auto _ : state) benchmark::DoNotOptimize(work.plain(input));
    state.SetItemsProcessed(state.iterations() * window.pixels());
    state_work(state, work);
}

void add(const std::string& name, const Graph& graph, const oracle::NodeWork* work = nullptr)
{
    auto* bench = benchmark::RegisterBenchmark(
        name.c_str(), [graph, work](benchmark::State& state) { run(state, graph, work); });
    bench->ArgNames({"width", "height", "threads"})
        ->Unit(benchmark::kMillisecond)
        ->MeasureProcessCPUTime()
        ->UseRealTime();
    // 0.26, 2.1 and 8.3 megapixels. Of whole graphs, sizes are what `./dev bench scaling` is for.
    constexpr std::array<std::array<int, 2>, 3> sizes{{{640, 400}, {1920, 1080}, {3840, 2160}}};
    for (const auto [width, height] : std::span(sizes).first(name.starts_with("graph/") ? 2 : 3))
        for (const int threads : {1, 2}) bench->Args({width, height, threads});
}

void add_plain(const Graph& graph, const oracle::NodeWork& work)
{
    static constexpr Region window{0, 0, 160, 100};
    benchmark::RegisterBenchmark(
        (work.node + "/plain_node/160x100").c_str(),
        [graph, &work](benchmark::State& state) { run_plain(state, graph, work, window); })
        ->Unit(benchmark::kMillisecond);
}

void add_all()
{
    for (const std::string& node : test::built_in_nodes()) {
        const auto& table = oracle::node_work();
        const auto work = std::ranges::find(table, node, &oracle::NodeWork::node);
        const bool listed = work != table.end();
        const Graph graph = listed && !work->graph.empty()
                                ? parse_graph(oracle::graph_text(*work), node)
                                : test::example_graph(node);
        if (test::touches_files(graph)) continue;
        add(node + "/node", graph, listed ? &*work : nullptr);
        if (listed && work->plain) add_plain(graph, *work);
    }
    for (const std::string& file : test::shipped_graphs())
        add("graph/" + std::filesystem::path(file).stem().string(), read_graph(file));
}

} // namespace
} // namespace rayloom

int main(int argc, char** argv)
{
    // What a run frees the next one takes again: kernels are measured here, not the operating
    // system's clearing of pages.
    mallopt(M_MMAP_MAX, 0);
    mallopt(M_TRIM_THRESHOLD, -1);
    rayloom::add_all();
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
    benchmark::RunSpecifiedBenchmarks();
    return 0;
}
