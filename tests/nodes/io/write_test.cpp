// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/exr_reader.h"
#include "tests/nodes/io/io_nodes.h"
#include "tests/support/folders.h"

#include <limits>

namespace rayloom
{
namespace
{
using namespace test;

// Plans and feeds an io.write node `rows` rows at a time; commits unless told not to.
struct Written {
    std::unique_ptr<Node> node;
    CountingServices services;

    Written(const ImageDesc& desc, const ImageBuffer& pixels, ParamValues params, int rows)
        : node(make("io.write", params))
    {
        PlannedInput input;
        input.connected = true;
        input.images = {desc};
        PlanContext context({{"image", input}});
        node->plan(context);
        EXPECT_EQ(context.result().sink, desc.data);
        EXPECT_EQ(context.result().access, Access::rows);
        const ConstImageView view = pixels.view();
        for (int y = desc.data.y0; y < desc.data.y1; y += rows) {
            const Region band{desc.data.x0, y, desc.data.x1, std::min(desc.data.y1, y + rows)};
            const TileContext::Input in{"image", {&view, 1}, {}, nullptr};
            node->compute(TileContext(band, 0, {&in, 1}, {}, services));
        }
    }
};

TEST(IoWrite, WritesReadsBackAndCounts)
{
    const TemporaryFolder folder;
    ImageDesc desc;
    desc.data = desc.display = {-2, 5, 30, 60};
    desc.channels = {"R", "G", "B"};
    ImageBuffer pixels(desc.data, 3);
    pixels.fill(0.5f);
    pixels.view().at(0, 3, 30) = 1e9f;
    pixels.view().at(1, 3, 30) = std::numeric_limits<float>::infinity();
    Written written(desc, pixels, {{"path", folder.file("a.exr")}}, 16);
    EXPECT_TRUE(folder.names().empty());
    written.node->commit();
    EXPECT_EQ(written.services.counts.at("NaN or infinite values written"), 1u);
    EXPECT_EQ(written.services.counts.at("values too large for half, written as 65504"), 1u);
    const auto node = make("io.read", {{"path", folder.file("a.exr")}});
    PlanContext context({});
    node->plan(context);
    const ImageDesc& back = context.result().outputs.at("image").at(0);
    EXPECT_EQ(back.data, desc.data);
    EXPECT_EQ(fill(*node, "image", back, back.data).view().at(0, 3, 30), 65504.0f);
}

TEST(IoWrite, AbandonLeavesNothing)
{
    const TemporaryFolder folder;
    ImageDesc desc;
    desc.data = desc.display = {0, 0, 8, 8};
    desc.channels = {"R"};
    ImageBuffer pixels(desc.data, 1);
    pixels.fill(0.5f);
    Written written(desc, pixels, {{"path", folder.file("a.exr")}}, 8);
    written.node->abandon();
    EXPECT_TRUE(folder.names().empty());
}

// One real multi-layer file in, its beauty replaced, every other layer the same.
TEST(IoWrite, RealFileThroughATemplate)
{
    const TemporaryFolder folder;
    const std::string path =
        test::source_folder().string() + "/tests/data/cycles/interior/noisy_16.exr";
    const auto file = ImageFile::open(path);
    const ImageReader reader(file, file->select("Combined"));
    ImageBuffer pixels(reader.desc().data, reader.desc().channel_count());
    pixels.fill(0.125f);
    Written written(reader.desc(), pixels, {{"path", folder.file("out.exr")}, {"template", path}},
                    32);
    written.node->commit();
    const auto out = ImageFile::open(folder.file("out.exr"));
    ASSERT_EQ(out->layers().size(), file->layers().size());
    for (std::size_t i = 0; i < out->layers().size(); ++i) {
        const std::string layer = out->layers()[i].address();
        const auto read = [&](const std::shared_ptr<const ImageFile>& f) {
            ImageBuffer b(f->parts()[0].data, f->desc(f->select(layer)).channel_count());
            ImageReader(f, f->select(layer)).read(b.view());
            return b;
        };
        const ImageBuffer was = read(file), is = read(out);
        const bool same = std::memcmp(was.view().data(), is.view().data(),
                                      static_cast<std::size_t>(was.view().row_stride()) * 90 *
                                          sizeof(float)) == 0;
        EXPECT_EQ(same, layer != "ViewLayer.Combined") << layer;
        if (!same) {
            EXPECT_EQ(is.view().at(0, 50, 50), 0.125f);
        }
    }
}

} // namespace
} // namespace rayloom
