// SPDX-License-Identifier: Apache-2.0
/// \file
/// The whole method, node by node, on real renders.
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/support/folders.h"
#include "tests/support/render_data.h"

#include <gtest/gtest.h>

#include <ostream>

#include <algorithm>
#include <cmath>

namespace rayloom
{
namespace
{

using test::NodeRun;
using test::run_node;
using test::TestImage;

/// κ and the least number of patches per level, the last one repeating.
struct Settings {
    int scales = 2;
    std::vector<double> kappa{1.0};
    std::vector<int> min_patches{2, 0};
    std::string limit = "none"; ///< as published
};

TestImage ray_histogram_fusion(const TestImage& image, const TestImage& histogram,
                               const Settings& settings)
{
    const auto at = [](const auto& list, std::size_t i) {
        return list[std::min(i, list.size() - 1)];
    };
    const ParamValue scales = std::int64_t{settings.scales};
    const NodeRun levels =
        run_node("multiscale.pyramid", {{"scales", scales}}, {{"image", {&image}}});
    const NodeRun histograms = run_node(
        "multiscale.pyramid", {{"scales", scales}, {"conserve", ParamValue(std::string("sum"))}},
        {{"image", {&histogram}}});
    std::vector<NodeRun> fused;
    std::vector<const TestImage*> list;
    for (std::size_t s = 0; s < static_cast<std::size_t>(settings.scales); ++s)
        fused.push_back(run_node("fuse.histogram",
                                 {{"kappa", at(settings.kappa, s)},
                                  {"min_patches", std::int64_t{at(settings.min_patches, s)}}},
                                 {{"image", {&levels.image("levels", s)}},
                                  {"histogram", {&histograms.image("levels", s)}}}));
    for (const NodeRun& run : fused) list.push_back(&run.image());
    NodeRun result =
        run_node("multiscale.recombine", {{"limit", settings.limit}}, {{"levels", list}});
    return std::move(result.outputs.find("image")->second[0]);
}

/// 10·log₁₀(1/MSE) over R, G, B.
double psnr(const TestImage& a, const TestImage& b, bool clamped)
{
    double sum = 0.0;
    std::size_t n = 0;
    const Region& r = a.desc.data;
    for (int c = 0; c < 3; ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x, ++n) {
                double u = a.view().at(c, x, y), v = b.view().at(c, x, y);
                if (clamped) u = std::clamp(u, 0.0, 1.0), v = std::clamp(v, 0.0, 1.0);
                sum += (u - v) * (u - v);
            }
    return -10.0 * std::log10(sum / static_cast<double>(n));
}

double relmse(const TestImage& image, const TestImage& reference)
{
    double sum = 0.0;
    std::size_t n = 0;
    const Region& r = image.desc.data;
    for (int c = 0; c < 3; ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x, ++n) {
                const double v = reference.view().at(c, x, y), d = image.view().at(c, x, y) - v;
                sum += d * d / (v * v + 0.01);
            }
    return sum / static_cast<double>(n);
}

TestImage rgb(const TestImage& image)
{
    return test::make_image(image.desc.data, {"R", "G", "B"},
                            [&](int c, int x, int y) { return image.view().at(c, x, y); });
}

struct PublishedOutput {
    const char* spp;
    const char* kappa;
    int scales;
};

void PrintTo(const PublishedOutput& output, std::ostream* out)
{
    *out << output.spp << " spp, kappa " << output.kappa << ", " << output.scales << " scales";
}

class Published : public testing::TestWithParam<PublishedOutput>
{
};

TEST_P(Published, OutputIsReproduced)
{
    const auto data = test::large_data();
    if (!data || !exists(*data / "rhf")) GTEST_SKIP() << "no rhf data: set RAYLOOM_DATA";
    const auto [spp, kappa, scales] = GetParam();
    const auto folder = *data / "rhf" / "cornell";
    const std::string name = std::string("cornell_") + spp;
    const TestImage image = rgb(test::read_render(folder / (name + ".exr")));
    const TestImage histogram = test::read_render(folder / (name + "_hist.exr"));
    const TestImage reference = test::read_render(folder / "cornell_ref.exr");
    const TestImage theirs = test::read_render(
        folder / ("rhf_out_" + name + "_d" + kappa + "_s" + std::to_string(scales) + ".exr"));
    Settings settings;
    settings.scales = scales;
    settings.kappa = {std::stod(kappa)};
    const TestImage ours = ray_histogram_fusion(image, histogram, settings);

    const double difference = psnr(ours, theirs, false);
    const double our_error = psnr(ours, reference, true),
                 their_error = psnr(theirs, reference, true);
    RecordProperty("difference_db", std::to_string(difference));
    std::printf("%s spp, kappa %s, %d scales: difference %.2f dB; against the reference %.3f dB, "
                "published %.3f dB, noisy %.3f dB\n",
                spp, kappa, scales, difference, our_error, their_error,
                psnr(image, reference, true));
    // What is left is the half-float rounding of the published files.
    EXPECT_GE(difference, 70.0);
    EXPECT_NEAR(our_error, their_error, 0.01);
    if (std::string(spp) == "256") {
        EXPECT_GE(our_error - psnr(image, reference, true), 11.5);
    }
}

INSTANTIATE_TEST_SUITE_P(
    Cornell, Published,
    testing::Values(PublishedOutput{"16", "1.0", 2}, PublishedOutput{"16", "1.0", 3},
                    PublishedOutput{"64", "0.8", 2}, PublishedOutput{"64", "1.0", 2},
                    PublishedOutput{"64", "1.0", 3}, PublishedOutput{"256", "1.0", 2}));

/// Mean and histogram of the stack, then the method.
TestImage from_stack(const std::vector<const TestImage*>& stack, const Settings& settings)
{
    const NodeRun statistics = run_node("transform.statistics", {}, {{"stack", stack}},
                                        {1 << 20, 1 << 20, true, {"mean"}});
    const NodeRun histogram = run_node("transform.histogram", {}, {{"stack", stack}});
    return ray_histogram_fusion(statistics.image("mean"), histogram.image("histogram"), settings);
}

std::vector<const TestImage*> pointers(const std::vector<TestImage>& images)
{
    std::vector<const TestImage*> list;
    for (const TestImage& image : images) list.push_back(&image);
    return list;
}

TEST(RayHistogramFusion, CyclesStacks)
{
    const auto data = test::large_data();
    if (!data || !exists(*data / "cycles")) GTEST_SKIP() << "no cycles data: set RAYLOOM_DATA";
    const std::pair<const char*, double> scenes[] = {
        {"cornell", .0155}, {"caustics", .262}, {"interior", .0365}, {"dof", .0390}};
    for (const auto& [scene, plain] : scenes) {
        const auto stack = test::read_stack(*data / "cycles" / scene, 16);
        const TestImage reference =
            test::read_render(*data / "cycles" / scene / "ref.exr", "ViewLayer.Combined");
        for (const char* limit : {"none", "share"}) {
            Settings settings;
            settings.limit = limit;
            const double error = relmse(from_stack(pointers(stack), settings), reference);
            std::printf("%s, limit %s: relMSE %.5f, plain trial %.4f\n", scene, limit, error,
                        plain);
            EXPECT_LE(error, 1.05 * plain) << scene << " " << limit;
        }
    }
}

/// Beside the lamp of the Cornell box the published recursion leaves the ceiling black.
TEST(RayHistogramFusion, LampDoesNotSpoilTheCeiling)
{
    const std::filesystem::path folder = test::source_folder() / "tests/data/cycles/cornell";
    const auto stack = test::read_stack(folder, 16);
    const TestImage reference = test::read_render(folder / "ref.exr", "ViewLayer.Combined");
    Settings settings;
    settings.kappa = {1.0, 0.3};
    const auto black_or_bright = [&](const char* limit) {
        settings.limit = limit;
        const TestImage fused = from_stack(pointers(stack), settings);
        const bool limited = settings.limit != "none";
        float least = 0.0f;
        for (int c = 0; c < 3; ++c)
            for (int y = 0; y < 288; ++y)
                for (int x = 0; x < 288; ++x) least = std::min(least, fused.view().at(c, x, y));
        EXPECT_EQ(least < 0.0f, !limited) << least;
        // Pixels of the ceiling that are less than half or more than twice what they should be.
        int count = 0;
        for (int y = 8; y < 65; ++y)
            for (int x = 80; x < 210; ++x) {
                const float expected = reference.view().at(1, x, y);
                if (expected > 0.3f) continue;
                const float got = fused.view().at(1, x, y);
                count += got < 0.5f * expected || got > 2.0f * expected;
            }
        return count;
    };
    const int none = black_or_bright("none"), share = black_or_bright("share");
    std::printf("ceiling pixels off by a factor of 2: published %d, limited %d\n", none, share);
    EXPECT_GE(none, 20);
    EXPECT_LE(share, none / 5);
}

TEST(RayHistogramFusion, CornellStackGetsNineTimesBetter)
{
    const std::filesystem::path folder = test::source_folder() / "tests/data/cycles/cornell";
    const auto stack = test::read_stack(folder, 16);
    const TestImage reference = test::read_render(folder / "ref.exr", "ViewLayer.Combined");
    auto order = pointers(stack);
    const TestImage fused = from_stack(order, {});
    const NodeRun mean = run_node("transform.statistics", {}, {{"stack", order}});
    EXPECT_LE(relmse(fused, reference), relmse(mean.image("mean"), reference) / 9.0);

    // The order of the frames does not matter beyond rounding.
    std::reverse(order.begin(), order.end());
    EXPECT_GE(psnr(from_stack(order, {}), fused, false), 85.0);
}

/// The graph files do what the nodes do one by one, with their own defaults and with parameters.
TEST(RayHistogramFusion, GraphsAreTheNodesInOrder)
{
    const std::filesystem::path source = test::source_folder();
    const auto stack = test::read_stack(source / "tests/data/cycles/dof", 8);
    const auto memory = [](const TestImage& image) {
        auto copy = std::make_shared<MemoryImage>();
        copy->desc = image.desc;
        copy->pixels = ImageBuffer(image.desc.data, image.desc.channel_count());
        copy_pixels(image.view(), copy->pixels.view());
        return copy;
    };
    const auto same = [](const RunReport& report, const TestImage& expected) {
        const ConstImageView image = report.images.at("image").at(0).pixels.view();
        const Region& r = expected.desc.data;
        double largest = 0.0;
        for (int c = 0; c < 3; ++c)
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1; ++x)
                    largest = std::max<double>(
                        largest, std::abs(image.at(c, x, y) - expected.view().at(c, x, y)));
        return largest;
    };
    RunRequest request;
    request.inputs["stack"].is_list = true;
    for (const TestImage& image : stack) request.inputs["stack"].images.push_back(memory(image));
    const Graph from_stack_graph =
        read_graph((source / "graphs/ray-histogram-fusion-stack.yaml").string());
    Settings settings;
    settings.kappa = {1.0, 0.3};
    settings.limit = "share";
    // The totals that scale the coarse histograms are added in another order.
    const RunReport by_default = run_graph(from_stack_graph, request);
    EXPECT_LE(same(by_default, from_stack(pointers(stack), settings)), 1e-5);
    request.params["kappa"] = std::vector<double>{0.8};
    request.params["scales"] = std::int64_t{3};
    request.params["limit"] = std::string("none");
    settings.kappa = {0.8};
    settings.scales = 3;
    settings.limit = "none";
    EXPECT_LE(same(run_graph(from_stack_graph, request), from_stack(pointers(stack), settings)),
              1e-5);

    RunRequest pair;
    pair.inputs["color"].images = {
        memory(run_node("transform.statistics", {}, {{"stack", pointers(stack)}}).image("mean"))};
    pair.inputs["histogram"].images = {memory(
        run_node("transform.histogram", {}, {{"stack", pointers(stack)}}).image("histogram"))};
    const RunReport from_pair =
        run_graph(read_graph((source / "graphs/ray-histogram-fusion.yaml").string()), pair);
    settings = {};
    settings.kappa = {1.0, 0.3};
    settings.limit = "share";
    EXPECT_LE(same(from_pair, from_stack(pointers(stack), settings)), 1e-5);
}

} // namespace
} // namespace rayloom
