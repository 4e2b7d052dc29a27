// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "rayloom/image/exr_reader.h"
#include "tests/nodes/io/io_nodes.h"
#include "tests/support/made_up_deep.h"

#include <limits>

namespace rayloom
{
namespace
{
using namespace test;

RunReport write_in_graph(const MemoryDeep& deep, const std::string& path,
                         const std::string& more = "")
{
    RunRequest request;
    request.inputs["deep"].deep = std::make_shared<MemoryDeep>(deep);
    request.outputs["deep"].path = path;
    request.outputs["deep"].layer = more;
    return run_graph(parse_graph("rayloom: 1\nname: same\ninputs: {deep: {kind: deep}}\n"
                                 "outputs: {deep: deep}\n",
                                 "same"),
                     request);
}

TEST(IoWriteDeep, WritesWhatItIsGivenAndCounts)
{
    const TemporaryFolder folder;
    const MemoryDeep made = made_up_deep({-2, 5, 30, 40});
    const MemoryDeep deep = with_values(made, [](int c, int x, int y, float v) {
        if (c == 0 && x == 4 && y == 30) return 1e9f;
        return c == 4 && x == 4 && y == 30 ? std::numeric_limits<float>::infinity() : v;
    });
    const std::size_t there = samples_at(deep, 0, 4, 30).size();
    ASSERT_GT(there, 0u);
    const RunReport report = write_in_graph(deep, folder.file("a.exr"));
    EXPECT_EQ(report.written, std::vector<std::string>{folder.file("a.exr")});
    std::map<std::string, std::size_t> counts;
    for (const NodeReport& node : report.nodes)
        for (const auto& [what, n] : node.counts) counts[what] += n;
    EXPECT_EQ(counts.at("NaN or infinite values written"), there);
    EXPECT_EQ(counts.at("values too large for half, written as 65504"), there);
    // Colour and alpha came from nowhere and are half, depth is float.
    const auto file = ImageFile::open(folder.file("a.exr"));
    const PartInfo& part = file->parts().at(0);
    EXPECT_TRUE(part.deep);
    EXPECT_EQ(part.data, deep.desc.data);
    EXPECT_EQ(part.display, deep.desc.display);
    const auto type_of = [&](const std::string& name) {
        for (int c = 0; c < part.spec->nchannels; ++c)
            if (part.spec->channelnames[static_cast<std::size_t>(c)] == name)
                return part.spec->channelformat(c);
        return OIIO::TypeUnknown;
    };
    EXPECT_EQ(type_of("R"), OIIO::TypeHalf);
    EXPECT_EQ(type_of("A"), OIIO::TypeHalf);
    EXPECT_EQ(type_of("Z"), OIIO::TypeFloat);
    const ImageReader reader(file, file->select(""));
    const DeepRow row = reader.read_deep_row(30);
    EXPECT_EQ(row.pixel(reader.desc().channel("R"), 6)[0], 65504.0f);
    EXPECT_EQ(row.pixel(reader.desc().channel("Z"), 6)[0], std::numeric_limits<float>::infinity());
    EXPECT_EQ(samples_at(deep, 4, 4, 30).size(), row.pixel(0, 6).size());
}

TEST(IoWriteDeep, SamplesInTheFullestRowAreKnownBeforehand)
{
    const TemporaryFolder folder;
    const MemoryDeep deep = make_deep(
        {0, 0, 7, 9}, {"A", "Z"}, [](int x, int y) { return y == 4 ? 100 + x : y % 2; },
        [](int, int, int, int) { return 0.5f; });
    write_in_graph(deep, folder.file("a.exr"));
    const auto file = ImageFile::open(folder.file("a.exr"));
    EXPECT_EQ(ImageReader(file, file->select("")).deep_row_samples(), 721u);
    // Tiles: the mean of the rows of the fullest row of tiles.
    write_deep_exr(folder.file("tiled.exr"), deep, {"half", "float"}, true);
    const auto tiled = ImageFile::open(folder.file("tiled.exr"));
    EXPECT_EQ(ImageReader(tiled, tiled->select("")).deep_row_samples(), (721u + 4 * 7) / 8);
}

TEST(IoWriteDeep, NoSamplesAtAllAndALayer)
{
    const TemporaryFolder folder;
    const MemoryDeep deep = make_deep(
        {0, 0, 5, 40}, {"A", "Z"}, [](int, int) { return 0; },
        [](int, int, int, int) { return 0.0f; });
    write_in_graph(deep, folder.file("a.exr"), "smoke");
    const auto file = ImageFile::open(folder.file("a.exr"));
    ASSERT_EQ(file->layers().size(), 1u);
    EXPECT_EQ(file->layers()[0].name, "smoke");
    EXPECT_EQ(ImageReader(file, file->select("smoke")).read_deep_row(39).first.back(), 0u);
}

} // namespace
} // namespace rayloom
