// SPDX-License-Identifier: Apache-2.0
/// What every node inherits by being registered: its example is run as a whole, in tiles, cropped,
/// on several threads and without shortcuts, and the bits are the same.
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/support/engine_nodes_for_tests.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace rayloom::test
{
namespace
{

/// Not at the origin, no multiple of any tile or vector width, with a part cut off by the display
/// window.
const Region window{-5, -3, 62, 44};

/// An image as the inputs of examples want them, chosen by the input's name:
/// `histogram` (20 bins for each of R, G, B and the sample count), `render` (Cycles' layers), else
/// RGBA radiance. One corner is black and one is constant, so that shortcuts have something to
/// skip.
std::shared_ptr<const MemoryImage> example_image(const std::string& input, unsigned seed)
{
    std::vector<std::string> channels{"R", "G", "B", "A"};
    if (input == "histogram") {
        channels.clear();
        for (int i = 0; i <= 60; ++i)
            channels.push_back((i < 10 ? "Bin_000" : "Bin_00") + std::to_string(i));
    } else if (input == "render") {
        channels.clear();
        for (const char* layer : {"Combined", "DiffDir", "DiffInd", "DiffCol"})
            for (const char* c : {".R", ".G", ".B"}) channels.push_back(layer + std::string(c));
    }
    auto image = std::make_shared<MemoryImage>();
    image->desc.data = window;
    image->desc.display = {0, 0, 62, 44};
    image->desc.channels = channels;
    image->pixels = ImageBuffer(window, image->desc.channel_count());
    std::mt19937 random(seed);
    std::lognormal_distribution<float> radiance(-1.0f, 1.5f);
    std::uniform_real_distribution<float> alpha(0.0f, 1.0f);
    std::uniform_int_distribution<int> samples(0, 3);
    const ImageView view = image->pixels.view();
    const int count = image->desc.channel("Bin_0060");
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0; x < window.x1; ++x) {
            float total = 0.0f;
            for (int c = 0; c < view.channels(); ++c) {
                float& v = view.at(c, x, y);
                if (count >= 0)
                    v = static_cast<float>(samples(random));
                else
                    v = channels[static_cast<std::size_t>(c)] == "A" ? alpha(random)
                                                                     : radiance(random);
                if (c < 20) total += v;
                if (count < 0 && x < 12 && y < 12) v = 0.0f;
                if (count < 0 && x > 48 && y > 30) v = 0.5f;
            }
            if (count < 0) continue;
            // As many samples in every colour: the rest of G and B goes to their first bin.
            for (int first = 20; first < 60; first += 20) {
                float sum = 0.0f;
                for (int c = first; c < first + 20; ++c) sum += view.at(c, x, y);
                view.at(first, x, y) += std::max(0.0f, total - sum);
            }
            view.at(count, x, y) = total;
        }
    return image;
}

RunRequest example_request(const Graph& graph)
{
    RunRequest request;
    unsigned seed = 1;
    for (const GraphInput& input : graph.inputs) {
        InputBinding& binding = request.inputs[input.name];
        binding.is_list = input.kind == PortKind::list;
        for (int i = 0; i < (binding.is_list ? 4 : 1); ++i)
            binding.images.push_back(example_image(input.name, seed++));
    }
    return request;
}

/// Nodes whose examples name files or deep images, which example_request() cannot make. They have
/// tests of their own for what is checked here.
bool has_made_inputs(const NodeInfo& info, const Graph& graph)
{
    for (const GraphInput& input : graph.inputs)
        if (input.kind == PortKind::deep) return false;
    return !info.name.starts_with("io.");
}

::testing::AssertionResult same_results(const RunReport& a, const RunReport& b)
{
    for (const auto& [name, images] : a.images) {
        const auto& others = b.images.at(name);
        if (images.size() != others.size())
            return ::testing::AssertionFailure() << name << ": lists differ in length";
        for (std::size_t i = 0; i < images.size(); ++i)
            if (const auto same = same_bits(images[i], others[i]); !same)
                return ::testing::AssertionFailure() << name << "[" << i << "]: " << same.message();
    }
    if (a.tables != b.tables) return ::testing::AssertionFailure() << "tables differ";
    return ::testing::AssertionSuccess();
}

/// Calls check(graph, request) for the example of every node.
template <class Check>
void for_each_example(const Check& check)
{
    std::size_t run = 0;
    for (const NodeInfo* info : Registry::instance().all()) {
        // Nodes the tests register themselves are tested where they are used.
        if (info->name.starts_with("engine.") || info->name.starts_with("test.")) continue;
        SCOPED_TRACE(info->name);
        if (info->example.empty()) {
            ADD_FAILURE() << "has no example graph";
            continue;
        }
        try {
            const Graph graph = parse_graph(info->example, info->name + " example");
            bool used = false;
            for (const GraphNode& node : graph.nodes) used = used || node.op == info->name;
            EXPECT_TRUE(used) << "the example does not use the node";
            if (!has_made_inputs(*info, graph)) continue;
            check(graph, example_request(graph));
            ++run;
        } catch (const Error& error) {
            ADD_FAILURE() << error.what()
                          << "\n(does the example ask for an input that example_image() in "
                             "tests/nodes/examples_test.cpp does not make?)";
        }
    }
    EXPECT_GT(run, 0u);
}

TEST(Examples, TilesThreadsAndShortcutsChangeNoBit)
{
    for_each_example([](const Graph& graph, const RunRequest& request) {
        RunOptions whole;
        whole.threads = 1;
        whole.tile = 4096;
        const RunReport expected = run_graph(graph, request, whole);
        RunOptions tiles;
        tiles.threads = 1;
        tiles.tile = 17;
        EXPECT_TRUE(same_results(expected, run_graph(graph, request, tiles))) << "tiles of 17";
        RunOptions threads;
        threads.threads = 2;
        threads.tile = 16;
        EXPECT_TRUE(same_results(expected, run_graph(graph, request, threads))) << "two threads";
        RunOptions no_skip = whole;
        no_skip.skip = false;
        EXPECT_TRUE(same_results(expected, run_graph(graph, request, no_skip))) << "no skips";
    });
}

TEST(Examples, ACropHasThePixelsOfTheWhole)
{
    for_each_example([](const Graph& graph, RunRequest request) {
        const RunReport whole = run_graph(graph, request);
        request.roi = Region{7, 5, 30, 21};
        const RunReport crop = run_graph(graph, request);
        for (const auto& [name, images] : whole.images)
            for (std::size_t i = 0; i < images.size(); ++i) {
                MemoryImage expected;
                expected.desc = images[i].desc;
                expected.desc.data = images[i].desc.data.intersect(*request.roi);
                expected.pixels = ImageBuffer(expected.desc.data, expected.desc.channel_count());
                if (!expected.desc.data.empty())
                    copy_pixels(images[i].pixels.view().crop(expected.desc.data),
                                expected.pixels.view());
                EXPECT_TRUE(same_bits(crop.images.at(name).at(i), expected))
                    << name << "[" << i << "]";
            }
    });
}

TEST(Examples, FiniteInputGivesFiniteOutput)
{
    for_each_example([](const Graph& graph, const RunRequest& request) {
        for (const auto& [name, images] : run_graph(graph, request).images)
            for (const MemoryImage& image : images)
                for (int c = 0; c < image.desc.channel_count(); ++c)
                    for (int y = image.desc.data.y0; y < image.desc.data.y1; ++y)
                        for (const float v : image.pixels.view().row_span(c, y))
                            ASSERT_TRUE(std::isfinite(v)) << name << ", channel " << c;
    });
}

} // namespace
} // namespace rayloom::test
