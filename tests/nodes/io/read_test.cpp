// SPDX-License-Identifier: Apache-2.0
#include "tests/nodes/io/io_nodes.h"

namespace rayloom
{
namespace
{
using namespace test;

TEST(IoRead, PlansFromTheHeaderAndReadsBands)
{
    const TemporaryFolder folder;
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
    const TemporaryFolder folder;
    const std::string path = folder.file("a.exr");
    write_float(path, 4, 4, {"R", "G", "B"}, ramp);
    EXPECT_NE(plan_message("io.read", {{"path", folder.file("b.exr")}}).find("b.exr"),
              std::string::npos);
    EXPECT_NE(plan_message("io.read", {{"path", path}, {"layer", std::string("Diffuse")}})
                  .find("'Diffuse'"),
              std::string::npos);
    EXPECT_NE(plan_message("io.read_deep", {{"path", path}}).find("io.read"), std::string::npos);
}

} // namespace
} // namespace rayloom
