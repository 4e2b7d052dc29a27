// SPDX-License-Identifier: Apache-2.0
// graphs/pivot-lobes.yaml on real renders.
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/support/engine_nodes_for_tests.h"
#include "tests/support/folders.h"
#include "tests/support/made_up_input.h"
#include "tests/support/made_up_render.h"
#include "tests/support/render_data.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

namespace rayloom::test
{
namespace
{

const std::filesystem::path source = test::source_folder();

/// Mean of (difference² / (reference² + 0.01)) over the colours of both windows' overlap.
double relative_error(ConstImageView image, ConstImageView reference)
{
    const Region both = image.region().intersect(reference.region());
    double sum = 0.0;
    for (int c = 0; c < 3; ++c)
        for (int y = both.y0; y < both.y1; ++y)
            for (int x = both.x0; x < both.x1; ++x) {
                const double r = reference.at(c, x, y), d = image.at(c, x, y) - r;
                sum += d * d / (r * r + 0.01);
            }
    return sum / static_cast<double>(3 * both.pixels());
}

TEST(PivotGraph, InteriorLosesAtLeastFiveSixthsOfItsError)
{
    const auto folder = source / "tests/data/cycles/interior";
    RunRequest request;
    request.inputs["render"].files = {{(folder / "noisy_16.exr").string(), ""}};
    const RunReport report =
        run_graph(read_graph((source / "graphs/pivot-lobes.yaml").string()), request, {});
    const TestImage noisy = read_render(folder / "noisy_16.exr", "ViewLayer.Combined"),
                    reference = read_render(folder / "ref.exr", "ViewLayer.Combined");
    const MemoryImage& result = report.images.at("image")[0];
    const double before = relative_error(noisy.view(), reference.view());
    const double after = relative_error(result.pixels.view(), reference.view());
    EXPECT_GT(before, 0.05);
    EXPECT_LT(after, before / 6.0);
}

TEST(PivotGraph, OtherLayersStayBitForBit)
{
    const auto file = source / "tests/data/cycles/interior/noisy_16.exr";
    RunRequest request;
    request.inputs["render"].files = {{file.string(), ""}};
    request.params["max_radius"] = std::int64_t{3};
    const RunReport report =
        run_graph(read_graph((source / "graphs/pivot-lobes.yaml").string()), request, {});
    const MemoryImage& layered = report.images.at("render")[0];
    const TestImage input = read_render(file);
    ASSERT_EQ(layered.desc.channel_count(), input.desc.channel_count());
    int changed = 0;
    for (int c = 0; c < input.desc.channel_count(); ++c) {
        const std::string& name = layered.desc.channels[static_cast<std::size_t>(c)];
        const bool light = name.find("Dir.") != std::string::npos ||
                           name.find("Ind.") != std::string::npos ||
                           (name.find("Combined") != std::string::npos && !name.ends_with(".A"));
        int differing = 0;
        for (int y = input.desc.data.y0; y < input.desc.data.y1; ++y)
            for (int x = input.desc.data.x0; x < input.desc.data.x1; ++x)
                differing += layered.pixels.view().at(c, x, y) != input.view().at(c, x, y);
        EXPECT_TRUE(light || differing == 0) << name;
        changed += differing > 0;
    }
    EXPECT_GE(changed, 9);
}

Graph shipped(const char* name) { return read_graph((source / "graphs" / name).string()); }

/// Sum of the colours of channels `first` to `first` + 2.
double light(ConstImageView image, int first = 0)
{
    double sum = 0.0;
    for (int c = first; c < first + 3; ++c)
        for (int y = image.region().y0; y < image.region().y1; ++y)
            for (const float v : image.row_span(c, y)) sum += static_cast<double>(v);
    return sum;
}

/// The denoised beauty of a made-up render, finite, and as bright as the render's.
MemoryImage denoise(const std::shared_ptr<MemoryImage>& render, RunReport* report = nullptr,
                    const ParamValues& params = {})
{
    RunRequest request;
    request.inputs["render"].images = {render};
    request.params = params;
    RunReport run = run_graph(shipped("pivot-lobes.yaml"), request, {});
    MemoryImage image = std::move(run.images.at("image")[0]);
    for (int c = 0; c < 3; ++c)
        for (int y = image.desc.data.y0; y < image.desc.data.y1; ++y)
            for (const float v : image.pixels.view().row_span(c, y)) EXPECT_TRUE(std::isfinite(v));
    const int beauty = render->desc.channel("ViewLayer.Combined.R");
    EXPECT_NEAR(light(image.pixels.view()) / light(render->pixels.view(), beauty), 1.0, 0.02);
    if (report) *report = std::move(run);
    return image;
}

/// Sets the channels of a layer, `value(channel, x, y)`.
template <class F>
void set_layer(MemoryImage& render, const std::string& layer, const std::string& channels, F value)
{
    for (std::size_t i = 0; i < channels.size(); ++i) {
        const int c = render.desc.channel("ViewLayer." + layer + "." + channels[i]);
        ASSERT_GE(c, 0) << layer;
        for (int y = render.desc.data.y0; y < render.desc.data.y1; ++y)
            for (int x = render.desc.data.x0; x < render.desc.data.x1; ++x)
                render.pixels.view().at(c, x, y) = value(static_cast<int>(i), x, y);
    }
}

bool noted(const RunReport& report, const std::string& text)
{
    return std::ranges::any_of(report.notes, [&](const std::string& note) {
        return note.find(text) != std::string::npos;
    });
}

TEST(PivotGraph, LightIsNotLost)
{
    for (const char* scene : {"cornell", "interior", "dof"}) {
        const auto file = source / "tests/data/cycles" / scene / "noisy_16.exr";
        RunRequest request;
        request.inputs["render"].files = {{file.string(), ""}};
        const RunReport report = run_graph(shipped("pivot-lobes.yaml"), request, {});
        const TestImage noisy = read_render(file, "ViewLayer.Combined");
        const double ratio =
            light(report.images.at("image")[0].pixels.view()) / light(noisy.view());
        EXPECT_NEAR(ratio, 1.0, 0.01) << scene;
    }
}

TEST(PivotGraph, PivotsOfZeroAndNextToNothing)
{
    const auto render = made_up_render({}, 4);
    set_layer(*render, "DiffCol", "RGB", [](int, int x, int y) {
        return x < 6 ? 0.0f : y < 6 ? 1e-12f : 0.4f;
    });
    set_layer(*render, "GlossCol", "RGB", [](int, int, int) { return 1e-30f; });
    denoise(render);
}

TEST(PivotGraph, EveryPixelAnObjectAndObjectsOfOnePixel)
{
    const auto render = made_up_render({}, 4);
    for (const bool all : {true, false}) {
        set_layer(*render, "IndexOB", "X", [&](int, int x, int y) {
            return all || (x % 5 == 2 && y % 5 == 2) ? static_cast<float>(24 * y + x) : 0.0f;
        });
        for (std::string& name : render->desc.channels)
            if (name.find("Crypto") != std::string::npos) name = "Other" + name;
        denoise(render);
    }
}

TEST(PivotGraph, NormalsThatAreNone)
{
    const auto render = made_up_render({}, 4);
    set_layer(*render, "Normal", "XYZ", [](int, int x, int) {
        return x < 12 ? std::numeric_limits<float>::quiet_NaN() : 0.0f;
    });
    denoise(render);
}

TEST(PivotGraph, PassesThatAreNotTheBeauty)
{
    RunReport report;
    denoise(made_up_render({}, 4, 1.7f), &report);
    denoise(made_up_render({}, 4, 0.6f), &report);
}

TEST(PivotGraph, LobeWithoutPivotStaysUnfiltered)
{
    const auto render = made_up_render({}, 4);
    for (std::string& name : render->desc.channels)
        if (name.find("GlossCol") != std::string::npos)
            name = "ViewLayer.Unknown" + name.substr(18);
    RunReport report;
    denoise(render, &report);
    EXPECT_TRUE(noted(report, "glossy direct: no pivot; stays in the remainder"));
}

TEST(PivotGraph, SkippedLobesAreNamed)
{
    RunReport report;
    denoise(made_up_render({"TransDir", "TransInd"}, 4), &report);
    EXPECT_TRUE(noted(report, "transmission direct: black, skipped"));
    EXPECT_TRUE(noted(report, "transmission indirect: black, skipped"));
    EXPECT_FALSE(noted(report, "diffuse direct: black, skipped"));
}

/// What the graph gives for `image`, of an input made for it.
MemoryImage run_with_filter(const Graph& graph, RunRequest request, const std::string& filter,
                            RunReport* report = nullptr)
{
    if (!filter.empty()) request.params["filter"] = filter;
    RunReport run = run_graph(graph, request, {});
    MemoryImage image = std::move(run.images.at("image")[0]);
    if (report) *report = std::move(run);
    return image;
}

TEST(PivotGraph, AnyGraphIsTheFilter)
{
    const auto render = made_up_render({}, 4);
    const MemoryImage planes = denoise(render);
    RunReport report;
    const MemoryImage nlm = denoise(render, &report, {{"filter", std::string("graph:nlm-image")}});
    EXPECT_FALSE(same_bits(planes, nlm));
    EXPECT_TRUE(noted(report, "does without 'marked', 'normal', 'boundary', 'parts'"));
    // The default by its path, and a graph of one's own that does nothing.
    const std::string here = (source / "graphs/pivot-planes.yaml").string();
    EXPECT_TRUE(same_bits(planes, denoise(render, nullptr, {{"filter", "graph:" + here}})));

    for (const char* name : {"pivot.yaml", "rhf-lobes.yaml"}) {
        const Graph graph = shipped(name);
        const RunRequest request = made_up_request(graph, Region{0, 0, 40, 30});
        const bool stack = std::string(name) == "rhf-lobes.yaml";
        const MemoryImage usual = run_with_filter(graph, request, "");
        EXPECT_FALSE(same_bits(
            usual, run_with_filter(graph, request, stack ? "graph:nlm-guided" : "graph:nlm-image")))
            << name;
        // Fed by the wrong thing: a graph of a render where one of a stack is wanted.
        EXPECT_THROW(run_with_filter(graph, request, "graph:pivot-lobes"), GraphError) << name;
    }
}

TEST(PivotGraph, VarianceThatIsGivenCounts)
{
    const auto file = source / "tests/data/cycles/interior/noisy_16.exr";
    const Graph graph = shipped("pivot.yaml");
    const auto memory = [](TestImage image) {
        auto to = std::make_shared<MemoryImage>();
        to->desc = image.desc;
        to->pixels = std::move(image.pixels);
        return to;
    };
    const auto color = memory(read_render(file, "ViewLayer.Combined"));
    const auto run = [&](float variance) {
        RunRequest request;
        request.inputs["color"].images = {color};
        request.inputs["pivot"].images = {memory(read_render(file, "ViewLayer.DiffCol"))};
        request.inputs["variance"].images = {memory(make_image(
            color->desc.data, {"R", "G", "B"}, [&](int, int, int) { return variance; }))};
        return run_graph(graph, request, {});
    };
    // No noise: nothing to filter. Much noise: all that is there may be noise.
    const RunReport none = run(0.0f), much = run(100.0f);
    double same = 0.0, other = 0.0, all = 0.0;
    for (int c = 0; c < 3; ++c)
        for (int y = color->desc.data.y0; y < color->desc.data.y1; ++y)
            for (int x = color->desc.data.x0; x < color->desc.data.x1; ++x) {
                const float was = color->pixels.view().at(c, x, y);
                all += static_cast<double>(was);
                same += std::abs(none.images.at("image")[0].pixels.view().at(c, x, y) - was);
                other += std::abs(much.images.at("image")[0].pixels.view().at(c, x, y) - was);
            }
    EXPECT_LT(same, 1e-4 * all);
    EXPECT_GT(other, 0.1 * all);
}

} // namespace
} // namespace rayloom::test
