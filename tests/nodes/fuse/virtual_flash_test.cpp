// SPDX-License-Identifier: Apache-2.0
/// The whole of graphs/virtual-flash.yaml on real renders.
#include "rayloom/engine/load_image.h"
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/support/folders.h"
#include "tests/support/made_up_deep.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <filesystem>

namespace rayloom
{
namespace
{

const std::filesystem::path source = test::source_folder();

RunRequest request_for(const std::filesystem::path& scene, int samples)
{
    RunRequest request;
    InputBinding& stack = request.inputs["stack"];
    stack.is_list = true;
    for (int i = 1; i <= samples; ++i) {
        char name[16];
        std::snprintf(name, sizeof name, "s%02d.exr", i);
        stack.files.push_back({(scene / "stack" / name).string(), "Combined"});
    }
    request.inputs["partial"].files = {{(scene / "flash_16.exr").string(), "partial_d1"}};
    request.inputs["flash_unit"].files = {{(scene / "flash_16.exr").string(), "flash_unit"}};
    request.inputs["reference"].files = {{(scene / "ref.exr").string(), "Combined"}};
    return request;
}

void add_albedo(RunRequest& request, const std::filesystem::path& scene)
{
    request.inputs["albedo"].files = {{(scene / "noisy_16.exr").string(), "Denoising Albedo"}};
}

/// Figures of a table output of a study's graph.
Table figures(const RunReport& report, const char* output)
{
    return report.tables.at(output).front();
}

TEST(VirtualFlash, ErrorFallsWithSamplesBelowPlainNonLocalMeansAndLightIsKept)
{
    const Graph graph = read_graph((source / "tests/studies/virtual_flash_readings.yaml").string());
    for (const char* scene : {"caustics", "interior", "dof"}) {
        double before = 1e30;
        for (const int samples : {4, 8, 16}) {
            RunRequest request = request_for(source / "tests/data/cycles" / scene, samples);
            request.outputs["noisy"] = {};
            request.outputs["nlm"] = {};
            request.outputs["d"] = {};
            const RunReport report = run_graph(graph, request);
            const Table noisy = figures(report, "noisy"), plain = figures(report, "nlm"),
                        result = figures(report, "d");
            EXPECT_LT(result.number("relmse"), before) << scene << " " << samples;
            EXPECT_LT(result.number("relmse"), 0.25 * noisy.number("relmse"))
                << scene << " " << samples;
            // The 96×96 pixels of the caustic hold too few fireflies to say so of four samples.
            if (samples > 4) {
                EXPECT_LT(result.number("relmse"), plain.number("relmse"))
                    << scene << " " << samples;
            }
            EXPECT_NEAR(result.number("brightness_ratio") / noisy.number("brightness_ratio"), 1.0,
                        0.03)
                << scene << " " << samples;
            before = result.number("relmse");
        }
    }
}

TEST(VirtualFlash, IntervalsHoldTheTruthAsOftenAsThePaperHasIt)
{
    const Graph graph = read_graph((source / "tests/studies/virtual_flash_coverage.yaml").string());
    RunRequest request = request_for(source / "tests/data/cycles/dof", 16);
    for (const auto& [confidence, expected] :
         {std::pair{"0.95", 0.901}, std::pair{"0.98", 0.929}, std::pair{"0.99", 0.943}}) {
        request.param_texts["confidence"] = confidence;
        const Table coverage = figures(run_graph(graph, request), "coverage");
        EXPECT_NEAR(coverage.number("interval"), expected, 0.03) << confidence;
        EXPECT_GT(coverage.number("bound"), coverage.number("interval"));
    }
}

std::string error_of(const Graph& graph, const RunRequest& request)
{
    try {
        run_graph(graph, request);
    } catch (const Error& e) {
        return e.what();
    }
    return "no error";
}

TEST(VirtualFlash, WhatCannotBeDoneIsSaid)
{
    const Graph graph = read_graph((source / "graphs/virtual-flash.yaml").string());
    const auto scene = source / "tests/data/cycles/interior";
    RunRequest request = request_for(scene, 4);
    request.inputs.erase("reference");
    request.outputs["image"] = {};

    RunRequest one_render = request;
    one_render.inputs["stack"].files.resize(1);
    EXPECT_THAT(error_of(graph, one_render), testing::HasSubstr("render the frame at least twice"));

    RunRequest one_sample = request;
    one_sample.inputs["mean"].files = {request.inputs["stack"].files[0]};
    one_sample.inputs["variance"].files = {request.inputs["stack"].files[1]};
    one_sample.inputs.erase("stack");
    one_sample.param_texts["samples"] = "1";
    EXPECT_THAT(error_of(graph, one_sample),
                testing::HasSubstr("one sample has no confidence interval"));

    RunRequest no_light = request;
    no_light.inputs.erase("partial");
    EXPECT_THAT(error_of(graph, no_light),
                testing::HasSubstr("connect 'partial', or light passes to make it from"));

    RunRequest other_size = request;
    other_size.inputs["partial"].files = {
        {(source / "tests/data/cycles/cornell/ref.exr").string(), ""}};
    const std::string sizes = error_of(graph, other_size);
    EXPECT_THAT(sizes, testing::HasSubstr("288x288"));
    EXPECT_THAT(sizes, testing::HasSubstr("96x96"));

    const Graph sequence = read_graph((source / "graphs/virtual-flash-sequence.yaml").string());
    RunRequest frames;
    frames.inputs["frame"].files = {request.inputs["stack"].files[0]};
    frames.inputs["guide"].files = {{(scene / "noisy_16.exr").string(), "Denoising Albedo"}};
    frames.inputs["before"].files = other_size.inputs["partial"].files;
    frames.inputs["before"].is_list = true;
    frames.inputs["guide_before"] = frames.inputs["guide"];
    frames.inputs["guide_before"].is_list = true;
    frames.outputs["image"] = {};
    EXPECT_THAT(error_of(sequence, frames), testing::HasSubstr("288x288"));
}

TEST(VirtualFlash, OneSampleAPixelTakesItsNoiseFromTheNeighboursWhenAsked)
{
    const Graph graph = read_graph((source / "graphs/virtual-flash.yaml").string());
    const auto scene = source / "tests/data/cycles/dof";
    RunRequest request = request_for(scene, 1);
    request.inputs["mean"].files = request.inputs["stack"].files;
    request.inputs.erase("stack");
    request.inputs.erase("reference");
    request.outputs["image"] = {};
    EXPECT_THAT(error_of(graph, request), testing::HasSubstr("there is no variance"));
    request.param_texts["too_few"] = "neighbours";
    const RunReport report = run_graph(graph, request);
    const MemoryImage& image = report.images.at("image").front();
    const MemoryImage noisy = load_image((scene / "stack/s01.exr").string(), "Combined");
    const MemoryImage truth = load_image((scene / "ref.exr").string(), "Combined");
    double before = 0.0, after = 0.0;
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < 96; ++y)
            for (int x = 0; x < 96; ++x) {
                const double r = truth.pixels.view().at(c, x, y);
                const double scale = 1.0 / (r * r + 0.01);
                before += scale * std::pow(noisy.pixels.view().at(c, x, y) - r, 2);
                after += scale * std::pow(image.pixels.view().at(c, x, y) - r, 2);
            }
    EXPECT_LT(after, before / 5.0);
}

TEST(VirtualFlash, WithoutAFlashTheLightAloneGuidesAndTheReportSaysSo)
{
    const Graph graph = read_graph((source / "graphs/virtual-flash.yaml").string());
    RunRequest request = request_for(source / "tests/data/cycles/interior", 8);
    request.inputs.erase("reference");
    request.inputs.erase("flash_unit");
    request.outputs["flash"] = {};
    const RunReport report = run_graph(graph, request);
    EXPECT_THAT(report.notes,
                testing::Contains(testing::HasSubstr("F is the partial light alone")));
    EXPECT_EQ(report.images.at("flash").front().desc.data, (Region{0, 0, 96, 96}));
}

TEST(VirtualFlash, DeepSamplesGiveWhatTheirStackGives)
{
    const Graph graph = read_graph((source / "graphs/virtual-flash.yaml").string());
    const auto scene = source / "tests/data/cycles/interior";
    RunRequest request = request_for(scene, 4);
    request.inputs.erase("reference");
    request.outputs["image"] = {};
    const RunReport of_stack = run_graph(graph, request);
    std::vector<MemoryImage> renders;
    for (const InputFile& file : request.inputs.at("stack").files)
        renders.push_back(load_image(file.path, file.layer));
    const Region& window = renders.front().desc.data;
    const auto samples = [&](int, int) { return static_cast<int>(renders.size()); };
    request.inputs.erase("stack");
    request.inputs["deep"].deep = std::make_shared<const MemoryDeep>(
        test::make_deep(window, {"R", "G", "B"}, samples, [&](int c, int x, int y, int i) {
            return renders[static_cast<std::size_t>(i)].pixels.view().at(c, x, y);
        }));
    const RunReport of_deep = run_graph(graph, request);
    const ConstImageView a = of_stack.images.at("image").front().pixels.view();
    const ConstImageView b = of_deep.images.at("image").front().pixels.view();
    for (int c = 0; c < 3; ++c)
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x)
                ASSERT_EQ(a.at(c, x, y), b.at(c, x, y)) << c << " " << x << " " << y;
}

TEST(VirtualFlash, FirefliesAreSpreadWithoutAFlashAndInSequencesToo)
{
    const Graph graph = parse_graph(R"(rayloom: 1
name: fireflies
params:
  outliers: 0.2
inputs:
  stack: {kind: list, channels: RGB}
  albedo: {channels: RGB}
  reference: {channels: RGB}
nodes:
  mean: {op: transform.statistics, stack: stack}
  guided: {op: graph:nlm-guided, stack: stack, guide: albedo, outliers: $outliers}
  frame: {op: graph:virtual-flash-sequence, frame: mean.mean, guide: albedo, samples: 8, outliers: $outliers}
  of_guided: {op: measure.error, image: guided.image, reference: reference}
  of_frame: {op: measure.error, image: frame.image, reference: reference}
  kept_guided: {op: measure.error, image: guided.image, reference: mean.mean}
  kept_frame: {op: measure.error, image: frame.image, reference: mean.mean}
outputs:
  guided: of_guided.errors
  frame: of_frame.errors
  kept_guided: kept_guided.errors
  kept_frame: kept_frame.errors
)",
                                    "fireflies");
    for (const char* scene : {"interior", "caustics"}) {
        const auto folder = source / "tests/data/cycles" / scene;
        RunRequest request = request_for(folder, 8);
        request.inputs.erase("partial");
        request.inputs.erase("flash_unit");
        add_albedo(request, folder);
        const RunReport split = run_graph(graph, request);
        request.param_texts["outliers"] = "0";
        const RunReport whole = run_graph(graph, request);
        for (const char* output : {"guided", "frame"}) {
            EXPECT_LT(figures(split, output).number("relmse"),
                      0.8 * figures(whole, output).number("relmse"))
                << scene << " " << output;
            EXPECT_NEAR(
                figures(split, (std::string("kept_") + output).c_str()).number("brightness_ratio"),
                1.0, 0.03)
                << scene << " " << output;
        }
    }
}

/// The flash image of a request to virtual-flash.
MemoryImage flash_of(RunRequest request)
{
    request.inputs.erase("reference");
    request.outputs["flash"] = {};
    RunReport report =
        run_graph(read_graph((source / "graphs/virtual-flash.yaml").string()), request);
    return std::move(report.images.at("flash").front());
}

TEST(VirtualFlash, LightPassesThatTheRendererMapFindsMakeThePartialLight)
{
    for (const char* name : {"interior", "dof"}) {
        const auto scene = source / "tests/data/cycles" / name;
        RunRequest request = request_for(scene, 4);
        request.inputs["partial"].files = {{(scene / "flash_16.exr").string(), "partial"}};
        const MemoryImage given = flash_of(request);
        request.inputs.erase("partial");
        // The file alone: which layer is meant says the input's role.
        for (const char* pass :
             {"diffuse_direct", "diffuse_color", "glossy_direct", "glossy_indirect", "glossy_color",
              "transmission_direct", "transmission_indirect", "transmission_color", "emission",
              "environment"})
            request.inputs[pass].files = {{(scene / "noisy_16.exr").string(), ""}};
        const MemoryImage made = flash_of(request);
        // Without one of them it is another image.
        request.inputs.erase("emission");
        request.inputs.erase("environment");
        request.inputs.erase("glossy_indirect");
        const MemoryImage less = flash_of(request);
        const Region& window = given.desc.data;
        double sum = 0.0, off = 0.0, missing = 0.0;
        for (int c = 0; c < 3; ++c)
            for (int y = window.y0; y < window.y1; ++y)
                for (int x = window.x0; x < window.x1; ++x) {
                    const double v = given.pixels.view().at(c, x, y);
                    sum += std::abs(v);
                    off += std::abs(made.pixels.view().at(c, x, y) - v);
                    missing += std::abs(less.pixels.view().at(c, x, y) - v);
                }
        // Passes, their products and the given light are half floats.
        EXPECT_LT(off, 1e-3 * sum) << name;
        EXPECT_GT(missing, 1e-2 * sum) << name;
    }
}

TEST(VirtualFlash, AnAlbedoKeepsTextureAndLight)
{
    const Graph graph = parse_graph(R"(rayloom: 1
name: virtual-flash-error
inputs:
  stack: {kind: list, channels: RGB}
  partial: {channels: RGB}
  flash_unit: {channels: RGB}
  albedo: {channels: RGB, optional: true}
  reference: {channels: RGB}
nodes:
  result: {op: graph:virtual-flash, stack: stack, partial: partial, flash_unit: flash_unit, albedo: albedo}
  mean: {op: transform.statistics, stack: stack}
  error: {op: measure.error, image: result.image, reference: reference}
  kept: {op: measure.error, image: result.image, reference: mean.mean}
outputs:
  error: error.errors
  kept: kept.errors
)",
                                    "virtual-flash-error");
    // With samples as few as the albedo's own; more of them would show the albedo's noise on dof.
    for (const auto& [scene, share] :
         {std::pair{"interior", 0.75}, std::pair{"caustics", 1.05}, std::pair{"dof", 1.0}}) {
        const auto folder = source / "tests/data/cycles" / scene;
        RunRequest request = request_for(folder, 8);
        const RunReport without = run_graph(graph, request);
        add_albedo(request, folder);
        const RunReport with = run_graph(graph, request);
        EXPECT_LT(figures(with, "error").number("relmse"),
                  share * figures(without, "error").number("relmse"))
            << scene;
        // What the filter itself does to the light of so small a crop is not the albedo's doing.
        EXPECT_NEAR(figures(with, "kept").number("brightness_ratio") /
                        figures(without, "kept").number("brightness_ratio"),
                    1.0, 0.01)
            << scene;
    }
}

TEST(VirtualFlash, WithoutNoiseNothingChanges)
{
    const Graph graph = read_graph((source / "graphs/virtual-flash.yaml").string());
    const auto scene = source / "tests/data/cycles/interior";
    RunRequest request = request_for(scene, 2);
    request.inputs.erase("reference");
    request.inputs["stack"].files[1] = request.inputs["stack"].files[0];
    request.outputs["image"] = {};
    const MemoryImage before = load_image((scene / "stack/s01.exr").string(), "Combined");
    for (const bool albedo : {false, true}) {
        if (albedo) add_albedo(request, scene);
        const RunReport report = run_graph(graph, request);
        const MemoryImage& image = report.images.at("image").front();
        for (int c = 0; c < 3; ++c)
            for (int y = 0; y < 96; ++y)
                for (int x = 0; x < 96; ++x) {
                    const float v = before.pixels.view().at(c, x, y);
                    ASSERT_NEAR(image.pixels.view().at(c, x, y), v, 1e-6f * (1.0f + std::abs(v)));
                }
    }
}

TEST(VirtualFlash, AClampedResultLiesInItsInterval)
{
    const Graph graph = read_graph((source / "graphs/virtual-flash.yaml").string());
    RunRequest request = request_for(source / "tests/data/cycles/interior", 8);
    request.inputs.erase("reference");
    const auto outside = [&](const char* clamp) {
        request.param_texts["clamp"] = clamp;
        request.outputs["image"] = {};
        request.outputs["bound"] = {};
        const RunReport report = run_graph(graph, request);
        RunRequest plain = request;
        plain.param_texts["gate"] = "none";
        plain.param_texts["window"] = "1";
        const MemoryImage& image = report.images.at("image").front();
        const MemoryImage noisy = std::move(run_graph(graph, plain).images.at("image").front());
        const MemoryImage& bound = report.images.at("bound").front();
        std::size_t count = 0;
        const Region& window = image.desc.data;
        for (int c = 0; c < 3; ++c)
            for (int y = window.y0; y < window.y1; ++y)
                for (int x = window.x0; x < window.x1; ++x) {
                    const float off =
                        std::abs(image.pixels.view().at(c, x, y) - noisy.pixels.view().at(c, x, y));
                    const float allowed = 0.5f * bound.pixels.view().at(c, x, y);
                    if (off > allowed * 1.0001f + 1e-6f) ++count;
                }
        return count;
    };
    EXPECT_EQ(outside("interval"), 0u);
    EXPECT_GT(outside("none"), 0u);
    add_albedo(request, source / "tests/data/cycles/interior");
    EXPECT_EQ(outside("interval"), 0u);
    EXPECT_GT(outside("none"), 0u);
}

} // namespace
} // namespace rayloom
