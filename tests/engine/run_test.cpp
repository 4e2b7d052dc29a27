// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/run.h"

#include "rayloom/graph/reader.h"
#include "tests/support/engine_nodes_for_tests.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

namespace rayloom::test
{
namespace
{

// Halos, a pyramid, a reduction whose table another branch reads, a flip that runs against the
// sweep, a global node, lists and a mapped node: everything the schedule has to get right at once.
const char* const everything = R"(
rayloom: 1
name: everything
inputs:
  color: any image
nodes:
  smooth: {op: engine.box, image: color, radius: 3}
  bright: {op: engine.gain, image: smooth, factor: 2.5}
  levels: {op: engine.halve, image: bright, scales: 3}
  fine:   {op: engine.box, image: levels, radius: [1, 2, 4]}
  coarse: {op: engine.total, image: 'fine[2]'}
  moved:  {op: engine.shift, image: color, figures: coarse.figures}
  upside: {op: engine.flipped, image: moved}
  flat:   {op: engine.blur_all, image: smooth}
  again:  {op: engine.total, image: upside}
  whole:  {op: engine.sum, images: ['fine[0]', upside, flat, again.image]}
  last:   {op: engine.box, image: whole, radius: 5}
outputs:
  image: last
)";

class Engine : public ::testing::Test
{
protected:
    void SetUp() override { register_engine_nodes(); }
};

TEST_F(Engine, RowsStayWhileSomeoneReadsThem)
{
    // In the last sweep `kept` has its rows from the first, so `inside` is not made again and reads
    // nothing; `early` still has a reader.
    const auto image = noise_image({0, 0, 97, 601}, 2);
    const char* const graph = R"(
rayloom: 1
name: readers
inputs:
  color: any image
nodes:
  early: {op: engine.box, image: color, radius: 1}
  inside: {op: engine.gain, image: early, factor: 3}
  kept: {op: engine.sum, images: [inside, color]}
  total: {op: engine.total, image: kept}
  shifted: {op: engine.shift, image: kept, figures: total.figures}
  late: {op: engine.box, image: early, radius: 2}
  result: {op: engine.sum, images: [shifted, late]}
outputs:
  image: result
)";
    RunOptions plain;
    plain.skip = false;
    EXPECT_TRUE(
        same_bits(run_text(graph, {{"color", image}}), run_text(graph, {{"color", image}}, plain)));
}

TEST_F(Engine, PixelsDoNotDependOnHowTheyAreMade)
{
    for (const Region window :
         {Region{0, 0, 97, 301}, Region{-13, -7, 50, 90}, Region{5, 900, 6, 1000},
          Region{0, 0, 200, 1}, Region{2, 3, 3, 4}}) {
        const auto image = noise_image(window, 3);
        RunOptions plain;
        plain.threads = 1;
        plain.tile = 4096;
        const MemoryImage expected = run_text(everything, {{"color", image}}, plain);
        for (const int threads : {1, 2, 7})
            for (const int tile : {0, 16, 37}) {
                RunOptions options;
                options.threads = threads;
                options.tile = tile;
                EXPECT_TRUE(same_bits(run_text(everything, {{"color", image}}, options), expected))
                    << window.text() << ", " << threads << " threads, tile " << tile;
            }
        RunOptions no_skip;
        no_skip.skip = false;
        EXPECT_TRUE(same_bits(run_text(everything, {{"color", image}}, no_skip), expected))
            << window.text();
    }
}

TEST_F(Engine, ACropHasThePixelsOfTheWhole)
{
    const Region window{-13, -7, 150, 290};
    const auto image = noise_image(window, 3);
    const MemoryImage whole = run_text(everything, {{"color", image}});
    for (const Region roi :
         {Region{0, 100, 40, 130}, Region{-100, -100, 0, 0}, Region{149, 289, 500, 500}}) {
        MemoryImage crop = run_text(everything, {{"color", image}}, {}, roi);
        MemoryImage expected;
        expected.desc = whole.desc;
        expected.desc.data = roi.intersect(window);
        expected.pixels = ImageBuffer(expected.desc.data, 3);
        copy_pixels(whole.pixels.view(), expected.pixels.view());
        EXPECT_TRUE(same_bits(crop, expected)) << roi.text();
    }
}

TEST_F(Engine, TheMemoryBudgetIsKeptAndChangesNoPixel)
{
    const char* const chain = R"(
rayloom: 1
name: chain
inputs: {color: any image}
nodes:
  a: {op: engine.box, image: color, radius: 3}
  b: {op: engine.total, image: a}
  c: {op: engine.box, image: b.image, radius: 4}
outputs: {image: c}
)";
    const auto image = noise_image({0, 0, 256, 2048}, 3);
    RunReport free_report, tight_report;
    const MemoryImage expected = run_text(chain, {{"color", image}}, {}, {}, &free_report);
    RunOptions tight;
    tight.memory = 1'500'000;
    EXPECT_TRUE(same_bits(run_text(chain, {{"color", image}}, tight, {}, &tight_report), expected));
    EXPECT_GT(free_report.peak_bytes, tight.memory);
    EXPECT_LE(tight_report.peak_bytes, tight.memory);
    EXPECT_LE(tight_report.peak_bytes, tight_report.planned_peak_bytes);
    EXPECT_GT(tight_report.strips, free_report.strips);
    tight.memory = 10'000;
    EXPECT_THROW(run_text(chain, {{"color", image}}, tight), MemoryError);
}

TEST_F(Engine, RowsThatNobodyNeedsAgainAreDropped)
{
    // Ten filters in a row over a tall image: two or three bands alive at a time, never ten images.
    std::string chain = "rayloom: 1\nname: chain\ninputs: {color: any}\nnodes:\n";
    for (int i = 0; i < 10; ++i)
        chain += "  n" + std::to_string(i) + ": {op: engine.box, image: " +
                 (i == 0 ? std::string("color") : "n" + std::to_string(i - 1)) + ", radius: 1}\n";
    chain += "outputs: {image: n9}\n";
    const auto image = noise_image({0, 0, 128, 4096}, 1);
    RunReport report;
    run_text(chain, {{"color", image}}, {}, {}, &report);
    EXPECT_LT(report.peak_bytes, image->pixels.bytes());
}

TEST_F(Engine, WhatALaterSweepReadsIsKeptOnce)
{
    // The mean is taken of a blurred image first; then the blurred image is read again. Its rows
    // are kept for that; those they were made from are not.
    const std::string text = "rayloom: 1\nname: kept\ninputs:\n  a: {}\nnodes:\n"
                             "  soft: {op: engine.box, image: a, radius: 2}\n"
                             "  level: {op: engine.total, image: soft}\n"
                             "  end: {op: engine.box, image: level.image, radius: 1}\n"
                             "outputs:\n  image: end\n";
    const auto image = noise_image({0, 0, 64, 4000}, 3);
    const Graph graph = parse_graph(text, "kept.yaml");
    RunRequest request;
    request.inputs["a"].images = {image};
    RunReport whole = run_graph(graph, request);
    EXPECT_LT(whole.peak_bytes, image->pixels.bytes() * 4 / 3);
    EXPECT_LE(whole.peak_bytes, whole.planned_peak_bytes);

    // A crop wants little of it: it is made again rather than kept with all that lies between.
    request.roi = Region{0, 100, 64, 400};
    RunReport crop = run_graph(graph, request);
    EXPECT_LT(crop.peak_bytes, image->pixels.bytes() / 3);
    const MemoryImage& all = whole.images.at("image").front();
    MemoryImage part{crop.images.at("image").front().desc, ImageBuffer(*request.roi, 3)};
    copy_pixels(all.pixels.view(), part.pixels.view());
    EXPECT_TRUE(same_bits(crop.images.at("image").front(), part));
}

TEST_F(Engine, PassThroughHandsOnTheContentKey)
{
    const Graph graph = parse_graph(R"(
rayloom: 1
name: neutral
inputs: {color: any}
nodes:
  same: {op: engine.gain, image: color, factor: 1.0}
  other: {op: engine.gain, image: color, factor: 2.0}
outputs: {a: same, b: other, c: color}
)",
                                    "neutral.yaml");
    RunRequest request;
    request.inputs["color"].images = {noise_image({0, 0, 8, 8}, 3)};
    const Plan plan = make_plan(graph, request);
    const auto key = [&](int output) {
        const WorkItem& sink = plan.items[static_cast<std::size_t>(
            plan.outputs[static_cast<std::size_t>(output)].sink_item)];
        return plan.streams[static_cast<std::size_t>(sink.inputs[0].streams[0])].key();
    };
    EXPECT_EQ(key(0), key(2));
    EXPECT_NE(key(1), key(2));
    EXPECT_THAT(plan.pruned, ::testing::Contains(::testing::Field(&PrunedNode::id, "same")));
}

TEST_F(Engine, WhatNoOutputNeedsDoesNotRun)
{
    const std::string graph = R"(
rayloom: 1
name: pruned
inputs: {color: any}
nodes:
  good: {op: engine.gain, image: color, factor: 2.0}
  bad: {op: engine.fails, image: color}
outputs: {image: good, other: bad}
)";
    const Graph g = parse_graph(graph, "pruned.yaml");
    RunRequest request;
    request.inputs["color"].images = {noise_image({0, 0, 64, 64}, 3)};
    request.outputs["image"] = {};
    EXPECT_NO_THROW(run_graph(g, request));
    request.outputs["other"] = {};
    try {
        run_graph(g, request);
        FAIL() << "the bad node ran";
    } catch (const InputError& e) {
        EXPECT_STREQ(e.what(), "pruned.yaml:7:3: node 'bad' (engine.fails): row 40 is bad");
    }
}

TEST_F(Engine, AStopEndsTheRun)
{
    const auto image = noise_image({0, 0, 512, 2048}, 3);
    std::stop_source stop;
    RunOptions options;
    options.stop = stop.get_token();
    options.progress = [&](double share) {
        if (share > 0.2) stop.request_stop();
    };
    EXPECT_THROW(run_text(everything, {{"color", image}}, options), Cancelled);
}

TEST_F(Engine, WrongRequestsAreExplained)
{
    const Graph graph = parse_graph(everything, "everything.yaml");
    const auto error_of = [&](const RunRequest& request) {
        try {
            make_plan(graph, request);
        } catch (const Error& e) {
            return std::string(e.what());
        }
        return std::string("no error");
    };
    RunRequest request;
    EXPECT_EQ(error_of(request),
              "graph 'everything' needs input 'color'; give it with -i color=FILE");
    request.inputs["colour"].images = {noise_image({0, 0, 8, 8}, 3)};
    EXPECT_EQ(error_of(request), "graph 'everything' has no input 'colour'; did you mean 'color'?");
    request.inputs.clear();
    request.inputs["color"].images = {noise_image({0, 0, 8, 8}, 3)};
    request.outputs["imge"] = {};
    EXPECT_EQ(error_of(request), "graph 'everything' has no output 'imge'; did you mean 'image'?");
    request.outputs.clear();
    request.param_texts["kappa"] = "1";
    EXPECT_EQ(error_of(request), "graph 'everything' has no parameter 'kappa'; there is none");
    request.param_texts.clear();
    request.roi = Region{100, 100, 110, 110};
    EXPECT_EQ(error_of(request),
              "the region of interest 10x10+100+100 lies outside output 'image' (8x8+0+0)");
}

TEST_F(Engine, TheCacheRunsOnlyWhatChanged)
{
    namespace fs = std::filesystem;
    const fs::path folder = fs::path(::testing::TempDir()) / "rayloom_cache_test";
    fs::remove_all(folder);
    const std::string text = R"(
rayloom: 1
name: cached
inputs: {color: any}
nodes:
  slow: {op: engine.box, image: color, radius: 6}
  mean: {op: engine.total, image: slow}
  last: {op: engine.gain, image: mean.image, factor: FACTOR}
  edge: {op: engine.box, image: last, radius: 1}
outputs: {image: edge}
)";
    const auto with_factor = [&](const char* factor) {
        std::string t = text;
        return t.replace(t.find("FACTOR"), 6, factor);
    };
    const auto image = noise_image({0, 0, 90, 700}, 3);
    RunOptions cached;
    cached.cache_folder = folder.string();
    RunReport first, second, third;
    const MemoryImage a = run_text(with_factor("2.0"), {{"color", image}}, cached, {}, &first);
    const MemoryImage b = run_text(with_factor("2.0"), {{"color", image}}, cached, {}, &second);
    const MemoryImage c = run_text(with_factor("3.0"), {{"color", image}}, cached, {}, &third);
    EXPECT_TRUE(same_bits(a, run_text(with_factor("2.0"), {{"color", image}})));
    EXPECT_TRUE(same_bits(a, b));
    EXPECT_TRUE(same_bits(c, run_text(with_factor("3.0"), {{"color", image}})));
    const auto ran = [](const RunReport& r, const std::string& id) {
        for (const NodeReport& n : r.nodes)
            if (n.id == id && n.calls > 0) return true;
        return false;
    };
    EXPECT_TRUE(ran(first, "slow") && ran(first, "edge"));
    EXPECT_FALSE(ran(second, "slow") || ran(second, "mean") || ran(second, "edge"));
    EXPECT_FALSE(ran(third, "slow"));
    EXPECT_TRUE(ran(third, "edge"));

    // Damage counts as absence.
    for (const auto& entry : fs::directory_iterator(folder)) fs::resize_file(entry.path(), 70);
    RunReport damaged;
    EXPECT_TRUE(
        same_bits(run_text(with_factor("2.0"), {{"color", image}}, cached, {}, &damaged), a));
    EXPECT_TRUE(ran(damaged, "slow"));
    for (const auto& entry : fs::directory_iterator(folder)) {
        std::fstream file(entry.path(), std::ios::in | std::ios::out | std::ios::binary);
        file.seekp(-1, std::ios::end);
        file.put('\x7f');
    }
    EXPECT_TRUE(same_bits(run_text(with_factor("2.0"), {{"color", image}}, cached), a));
    fs::remove_all(folder);
}

} // namespace
} // namespace rayloom::test
