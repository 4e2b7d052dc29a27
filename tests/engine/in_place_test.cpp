// SPDX-License-Identifier: Apache-2.0
// Nodes that work in place on the rows a reader has just read.
#include "rayloom/graph/reader.h"
#include "tests/support/command.h"
#include "tests/support/engine_nodes_for_tests.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

namespace rayloom::test
{
namespace
{

const char* const text = R"(rayloom: 1
name: in-place
inputs:
  color: {doc: a render}
nodes:
  clean: {op: threshold.sanitize, image: color, mode: black}
  soft: {op: oiio.blur, image: clean, width: 5, height: 5}
  rest: {op: oiio.sub, image: clean, other: soft}
outputs:
  image: rest
)";

class InPlace : public ::testing::Test
{
protected:
    void SetUp() override
    {
        const auto noise = noise_image(Region{-3, 5, 200, 150}, 3);
        MemoryImage image{noise->desc, ImageBuffer(noise->desc.data, 3)};
        copy_pixels(std::as_const(*noise).pixels.view(), image.pixels.view());
        image.pixels.view().at(1, 20, 40) = std::numeric_limits<float>::quiet_NaN();
        image.pixels.view().at(0, 199, 149) = std::numeric_limits<float>::infinity();
        OIIO::ImageBuf buffer = to_image_buf(image);
        const std::string path = (folder.path() / "a.exr").string();
        ASSERT_TRUE(buffer.write(path)) << buffer.geterror();
        request.inputs["color"].files.push_back({path, ""});
    }
    MemoryImage run(const RunOptions& options, RunReport* kept = nullptr)
    {
        RunReport report = run_graph(graph, request, options);
        MemoryImage image = std::move(report.images.at("image").front());
        if (kept) *kept = std::move(report);
        return image;
    }

    const TemporaryFolder folder;
    const Graph graph = parse_graph(text, "in-place");
    RunRequest request;
};

TEST_F(InPlace, TheReadersRowsAreNotHeldTwice)
{
    const Plan plan = make_plan(graph, request);
    const auto it =
        std::ranges::find_if(plan.items, [](const WorkItem& i) { return i.in_place >= 0; });
    ASSERT_NE(it, plan.items.end());
    EXPECT_EQ(plan.ops[static_cast<std::size_t>(it->op)].op, "threshold.sanitize");
    EXPECT_EQ(plan.access_of(*it).access, Access::rows);
    RunOptions no_skip;
    no_skip.skip = false;
    for (const WorkItem& i : make_plan(graph, request, no_skip).items) EXPECT_LT(i.in_place, 0);
}

TEST_F(InPlace, SamePixelsAndCountsAsWithItsOwnMemory)
{
    RunOptions own;
    own.skip = false;
    own.threads = 1;
    RunReport expected_report;
    const MemoryImage expected = run(own, &expected_report);
    const auto repaired = [](const RunReport& r) {
        std::size_t n = 0;
        for (const NodeReport& node : r.nodes)
            for (const auto& [what, count] : node.counts) n += count;
        return n;
    };
    EXPECT_EQ(repaired(expected_report), 2u);
    for (const int threads : {1, 2, 7})
        for (const int tile : {0, 16, 37}) {
            RunOptions options;
            options.threads = threads;
            options.tile = tile;
            RunReport report;
            EXPECT_TRUE(same_bits(run(options, &report), expected));
            EXPECT_EQ(repaired(report), 2u) << threads << " threads, tile " << tile;
        }
    request.roi = Region{50, 30, 120, 90};
    const MemoryImage crop = run({});
    MemoryImage part{crop.desc, ImageBuffer(crop.desc.data, 3)};
    copy_pixels(expected.pixels.view(), part.pixels.view());
    EXPECT_TRUE(same_bits(crop, part));
}

TEST(LentPixels, ImagesOfTheCallerAreReadWhereTheyAre)
{
    const Graph graph = parse_graph(text, "lent");
    RunRequest request;
    request.inputs["color"].images = {noise_image(Region{-3, 5, 500, 1150}, 3)};
    const auto lent_items = [&](const RunOptions& options) {
        return std::ranges::count_if(make_plan(graph, request, options).items,
                                     [](const WorkItem& i) { return i.lent.has_value(); });
    };
    EXPECT_EQ(lent_items({}), 1);
    RunReport lent = run_graph(graph, request);
    RunOptions copied;
    copied.skip = false;
    EXPECT_EQ(lent_items(copied), 0);
    RunReport own = run_graph(graph, request, copied);
    EXPECT_TRUE(same_bits(lent.images.at("image").front(), own.images.at("image").front()));
    EXPECT_LE(lent.peak_bytes, lent.planned_peak_bytes);
    // The same image may be read twice, and by two inputs.
    const Graph twice = parse_graph("rayloom: 1\nname: twice\ninputs: {a: any, b: any}\nnodes:\n"
                                    "  sum: {op: oiio.add, image: a, other: b}\n"
                                    "outputs: {image: sum}\n",
                                    "twice");
    const auto image = noise_image(Region{0, 0, 70, 50}, 3);
    RunRequest both;
    both.inputs["a"].images = both.inputs["b"].images = {image};
    const RunReport sum = run_graph(twice, both);
    EXPECT_EQ(sum.images.at("image").front().pixels.view().at(2, 33, 44),
              2 * image->pixels.view().at(2, 33, 44));
}

} // namespace
} // namespace rayloom::test
