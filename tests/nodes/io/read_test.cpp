// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/registry.h"
#include "rayloom/image/exr_reader.h"
#include "tests/image/image_files.h"

namespace rayloom
{
namespace
{
using namespace test;

struct QuietServices final : RunServices {
    bool cancelled() const noexcept override { return false; }
    bool may_skip() const noexcept override { return true; }
    void count_skip(std::string_view, std::size_t) override {}
    void count(std::string_view, std::size_t) override {}
};

std::unique_ptr<Node> make(const char* op, const ParamValues& params)
{
    const NodeInfo* info = Registry::instance().find(op);
    return info == nullptr ? nullptr : info->create(params);
}

ImageBuffer fill(const Node& node, const char* port, const ImageDesc& desc, const Region& region,
                 std::size_t element = 0)
{
    ImageBuffer pixels(region, desc.channel_count());
    const TileContext::Output output{port, pixels.view()};
    QuietServices services;
    node.compute(TileContext(region, element, {}, {&output, 1}, services));
    return pixels;
}

std::string plan_message(const char* op, const ParamValues& params)
{
    const auto node = make(op, params);
    PlanContext context({});
    return message_of([&] { node->plan(context); });
}

float ramp(int x, int y, int c) { return static_cast<float>(x + 100 * y + 10000 * c); }

TEST(IoRead, PlansFromTheHeaderAndReadsBands)
{
    const TempFolder folder;
    const std::string path = folder.file("a.exr");
    write_float(path, 33, 50, {"R", "G", "B", "A"}, ramp, -5, -6);
    const auto node = make("io.read", {{"path", path}, {"channels", std::string("RGB")}});
    PlanContext context({});
    node->plan(context);
    const PlanResult& plan = context.result();
    const ImageDesc& desc = plan.outputs.at("image").at(0);
    EXPECT_EQ(desc.data, (Region{-5, -6, 28, 44}));
    EXPECT_EQ(desc.channels, (std::vector<std::string>{"R", "G", "B", "A"}));
    EXPECT_EQ(plan.access, Access::rows);
    EXPECT_EQ(plan.row_alignment, 16) << "OpenImageIO writes ZIP by default";
    ASSERT_TRUE(desc.header);
    for (const Region& band : {desc.data, Region{-5, -6, 28, 10}, Region{-5, 42, 28, 44}}) {
        const ImageBuffer pixels = fill(*node, "image", desc, band);
        for (int y = band.y0; y < band.y1; ++y) EXPECT_EQ(pixels.view().at(2, 3, y), ramp(3, y, 2));
    }
    EXPECT_NE(node->content_key(true), "");
}

TEST(IoRead, ErrorsComeFromThePlan)
{
    const TempFolder folder;
    const std::string path = folder.file("a.exr");
    write_float(path, 4, 4, {"R", "G", "B"}, ramp);
    EXPECT_NE(plan_message("io.read", {{"path", folder.file("b.exr")}}).find("b.exr"),
              std::string::npos);
    EXPECT_NE(plan_message("io.read", {{"path", path}, {"layer", std::string("Diffuse")}})
                  .find("'Diffuse'"),
              std::string::npos);
    EXPECT_NE(plan_message("io.read_deep", {{"path", path}}).find("io.read"), std::string::npos);
}

TEST(IoStack, ReadsElementsOfMatchingFiles)
{
    const TempFolder folder;
    std::vector<std::string> paths;
    for (int i = 0; i < 140; ++i) { // more than are kept open at once
        paths.push_back(folder.file("s" + std::to_string(i) + ".exr"));
        write_float(paths.back(), 6, 40, {"R", "G", "B"}, [i](int x, int y, int c) {
            return ramp(x, y, c) + 1e6f * static_cast<float>(i);
        });
    }
    const auto node = make("io.stack", {{"paths", paths}});
    PlanContext context({});
    node->plan(context);
    const auto& descs = context.result().outputs.at("stack");
    ASSERT_EQ(descs.size(), 140u);
    for (const Region& band : {Region{0, 0, 6, 16}, Region{0, 16, 6, 40}})
        for (const std::size_t e : {std::size_t{0}, std::size_t{139}, std::size_t{7}}) {
            const ImageBuffer pixels = fill(*node, "stack", descs[e], band, e);
            EXPECT_EQ(pixels.view().at(1, 5, band.y1 - 1),
                      ramp(5, band.y1 - 1, 1) + 1e6f * static_cast<float>(e));
        }
}

TEST(IoStack, ErrorsNameTheTwoFiles)
{
    const TempFolder folder;
    write_float(folder.file("a.exr"), 6, 4, {"R", "G", "B"}, ramp);
    write_float(folder.file("b.exr"), 6, 5, {"R", "G", "B"}, ramp);
    write_float(folder.file("c.exr"), 6, 4, {"R", "G", "B", "A"}, ramp);
    write_float(folder.file("d.exr"), 6, 4, {"R", "G", "B"}, ramp, 1, 0);
    for (const char* other : {"b.exr", "c.exr", "d.exr"}) {
        const std::string message = plan_message(
            "io.stack",
            {{"paths", std::vector<std::string>{folder.file("a.exr"), folder.file(other)}}});
        EXPECT_NE(message.find("a.exr"), std::string::npos) << message;
        EXPECT_NE(message.find(other), std::string::npos) << message;
    }
    EXPECT_NE(plan_message("io.stack", {{"paths", std::vector<std::string>{}}}), "");
}

TEST(IoReadDeep, Rows)
{
    const TempFolder folder;
    OIIO::ImageSpec spec(5, 4, 2, OIIO::TypeFloat);
    spec.channelnames = {"A", "Z"};
    spec.deep = true;
    OIIO::DeepData deep(spec);
    for (int p = 0; p < 20; ++p) deep.set_samples(p, p % 3);
    for (int p = 0; p < 20; ++p)
        for (int s = 0; s < p % 3; ++s) deep.set_deep_value(p, 1, s, static_cast<float>(p + s));
    const std::string path = folder.file("deep.exr");
    auto out = OIIO::ImageOutput::create(path);
    ASSERT_TRUE(out && out->open(path, spec) && out->write_deep_image(deep) && out->close());
    const auto node = make("io.read_deep", {{"path", path}, {"channels", std::string("Z")}});
    PlanContext context({});
    node->plan(context);
    const DeepRow row = node->read_deep_row(1);
    ASSERT_EQ(row.first.size(), 6u);
    EXPECT_EQ(row.pixel(0, 3).size(), 2u);
    EXPECT_EQ(row.pixel(0, 3)[1], 9.0f);
    EXPECT_NE(plan_message("io.read", {{"path", path}}).find("io.read_deep"), std::string::npos);
}

} // namespace
} // namespace rayloom
