// SPDX-License-Identifier: Apache-2.0
// Layers of one file are unpacked together.
#include "rayloom/engine/plan.h"
#include "rayloom/engine/run.h"

#include "rayloom/graph/reader.h"
#include "rayloom/image/exr_reader.h"
#include "tests/support/command.h"
#include "tests/support/engine_nodes_for_tests.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

namespace rayloom::test
{
namespace
{

constexpr Region window{-3, 5, 200, 405};

class OneFile : public ::testing::Test
{
protected:
    void SetUp() override { register_engine_nodes(); }

    /// A file with layers color, pivot and normal, of three channels each.
    std::string write(const std::string& name)
    {
        auto image = noise_image(window, 9);
        image->desc.channels = {"color.R", "color.G",  "color.B",  "pivot.R", "pivot.G",
                                "pivot.B", "normal.X", "normal.Y", "normal.Z"};
        OIIO::ImageBuf buffer = to_image_buf(*image);
        std::string path = (folder.path() / name).string();
        EXPECT_TRUE(buffer.write(path)) << buffer.geterror();
        return path;
    }
    MemoryImage run(const char* text, const RunOptions& options)
    {
        RunReport report = run_graph(parse_graph(text, "one-file"), request, options);
        return std::move(report.images.at("image").front());
    }
    /// How often the rows of a file were unpacked, the most of all files.
    double times_unpacked(const char* text, const RunOptions& options = {})
    {
        Plan plan = make_plan(parse_graph(text, "one-file"), request, options);
        run_plan(plan, options);
        std::set<const ImageReader*> readers;
        for (const WorkItem& item : plan.items)
            if (const ImageReader* reader = plan.file_reader(item)) readers.insert(reader);
        std::map<std::string, std::size_t> rows;
        for (const ImageReader* reader : readers)
            rows[reader->file().path()] += reader->rows_decoded();
        std::size_t most = 0;
        for (const auto& [file, unpacked] : rows) most = std::max(most, unpacked);
        return static_cast<double>(most) / window.height();
    }

    const TemporaryFolder folder;
    RunRequest request;
};

const char* const layers = R"(rayloom: 1
name: layers
inputs:
  color: {doc: a render}
  pivot: {doc: its albedo}
  normal: {doc: its normals}
nodes:
  clean: {op: threshold.sanitize, image: color}
  light: {op: transform.demodulate, image: clean, pivot: pivot}
  soft: {op: oiio.blur, image: normal, width: 5, height: 5}
  result: {op: oiio.add, image: light.image, other: soft}
outputs:
  image: result
)";

TEST_F(OneFile, LayersAreUnpackedOnceThoughAReductionReadsOneOfThemFirst)
{
    const std::string path = write("a.exr");
    for (const char* layer : {"color", "pivot", "normal"})
        request.inputs[layer].files.push_back({path, layer});
    EXPECT_EQ(times_unpacked(layers), 1.0);
    // They are of one file, unless each is to be read on its own.
    const Plan plan = make_plan(parse_graph(layers, "one-file"), request);
    std::set<int> files;
    for (const WorkItem& item : plan.items)
        if (item.file >= 0) files.insert(item.file);
    EXPECT_EQ(files.size(), 1u);
    RunOptions own;
    own.skip = false;
    for (const WorkItem& item : make_plan(parse_graph(layers, "one-file"), request, own).items)
        EXPECT_LT(item.file, 0);
}

TEST_F(OneFile, SamePixelsAsOneByOne)
{
    const std::string path = write("a.exr");
    for (const char* layer : {"color", "pivot", "normal"})
        request.inputs[layer].files.push_back({path, layer});
    RunOptions own;
    own.skip = false;
    own.threads = 1;
    const MemoryImage expected = run(layers, own);
    for (const int threads : {1, 2, 7})
        for (const int tile : {0, 16}) {
            RunOptions options;
            options.threads = threads;
            options.tile = tile;
            EXPECT_TRUE(same_bits(run(layers, options), expected)) << threads << " " << tile;
        }
    // So little memory that nothing can be read ahead.
    RunOptions tight;
    tight.threads = 1;
    tight.tile = 16;
    for (std::size_t memory = std::size_t{1} << 17;; memory += memory / 64) {
        tight.memory = memory;
        try {
            EXPECT_TRUE(same_bits(run(layers, tight), expected)) << memory;
            EXPECT_GE(times_unpacked(layers, tight), 2.0); // the pivot, then all three
            break;
        } catch (const MemoryError&) {
            ASSERT_LT(memory, std::size_t{1} << 30);
        }
    }
}

TEST_F(OneFile, StacksOfTheSameFilesShareEachOfThem)
{
    const char* const text = R"(rayloom: 1
name: stacks
inputs:
  color: {kind: list, doc: renders}
  normal: {kind: list, doc: their normals}
nodes:
  one: {op: engine.sum, images: color}
  other: {op: engine.sum, images: normal}
  result: {op: oiio.add, image: one, other: other}
outputs:
  image: result
)";
    for (const char* name : {"a.exr", "b.exr", "c.exr"}) {
        const std::string path = write(name);
        request.inputs["color"].files.push_back({path, "color"});
        request.inputs["normal"].files.push_back({path, "normal"});
    }
    request.inputs["color"].is_list = request.inputs["normal"].is_list = true;
    EXPECT_EQ(times_unpacked(text), 1.0);
    RunOptions many; // so many threads that all rows are read at a time
    many.threads = 32;
    EXPECT_EQ(times_unpacked(text, many), 1.0);
    RunOptions own;
    own.skip = false;
    EXPECT_TRUE(same_bits(run(text, {}), run(text, own)));
}

} // namespace
} // namespace rayloom::test
