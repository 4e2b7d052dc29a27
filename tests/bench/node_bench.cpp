// SPDX-License-Identifier: Apache-2.0
/// \file
/// The example of every registered node and every shipped graph, run by the engine on images in
/// memory, over sizes and threads: `fuse.histogram/example/width:1920/height:1080/threads:2`. What
/// a node takes inside a run, tiles, halos and scheduling included. A new node joins by being
/// there.
#include "rayloom/core/registry.h"
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/support/folders.h"
#include "tests/support/made_up_input.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <filesystem>
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

/// Mirrored copies of an image, so that a large one costs no time to make and has no seams.
std::shared_ptr<const MemoryImage> enlarged(const MemoryImage& small, int width, int height)
{
    auto large = std::make_shared<MemoryImage>();
    large->desc = small.desc;
    large->desc.data = large->desc.display = Region{0, 0, width, height};
    const int channels = small.desc.channel_count();
    large->pixels = ImageBuffer(large->desc.data, channels);
    const Region from = small.desc.data;
    for (int y = 0; y < height; ++y)
        for (int c = 0; c < channels; ++c)
            for (int x = 0; x < width; ++x)
                large->pixels.view().at(c, x, y) = small.pixels.view().at(
                    c, from.x0 + mirrored(x, from.width()), from.y0 + mirrored(y, from.height()));
    return large;
}

void run(benchmark::State& state, const Graph& graph)
{
    const int width = static_cast<int>(state.range(0)), height = static_cast<int>(state.range(1));
    RunRequest request = test::made_up_request(graph, Region{0, 0, 320, 200});
    for (auto& [name, input] : request.inputs)
        for (auto& image : input.images) image = enlarged(*image, width, height);
    RunOptions options;
    options.threads = static_cast<int>(state.range(2));
    for (auto _ : state) benchmark::DoNotOptimize(run_graph(graph, request, options));
    state.SetItemsProcessed(state.iterations() * width * height);
}

void add(const std::string& name, const Graph& graph)
{
    auto* bench = benchmark::RegisterBenchmark(
        name.c_str(), [graph](benchmark::State& state) { run(state, graph); });
    bench->ArgNames({"width", "height", "threads"})
        ->Unit(benchmark::kMillisecond)
        ->MeasureProcessCPUTime()
        ->UseRealTime();
    // Pointwise operations of OpenImageIO cost the same at any size; one tells.
    const bool one_size = name.starts_with("oiio.");
    constexpr std::array<std::array<int, 2>, 3> sizes{{{640, 400}, {1920, 1080}, {3840, 2160}}};
    for (const auto [width, height] : std::span(sizes).subspan(one_size ? 1 : 0, one_size ? 1 : 3))
        for (const int threads : {1, 2}) bench->Args({width, height, threads});
}

void add_all()
{
    for (const NodeInfo* node : Registry::instance().all()) {
        std::string text = node->example;
        const std::string config = "config: config.ocio";
        if (const std::size_t at = text.find(config); at != std::string::npos)
            text.replace(at, config.size(),
                         "config: " + test::source_folder().string() +
                             "/tests/data/ocio/config.ocio");
        const Graph graph = parse_graph(text, node->name);
        if (std::ranges::none_of(graph.nodes,
                                 [](const GraphNode& n) { return n.op.starts_with("io."); }))
            add(node->name + "/example", graph);
    }
    const std::filesystem::path folder = test::source_folder() / "graphs";
    for (const auto& entry : std::filesystem::directory_iterator(folder))
        if (entry.path().extension() == ".yaml")
            add("graph/" + entry.path().stem().string(), read_graph(entry.path().string()));
}

} // namespace
} // namespace rayloom

int main(int argc, char** argv)
{
    rayloom::add_all();
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
    benchmark::RunSpecifiedBenchmarks();
    return 0;
}
