// SPDX-License-Identifier: Apache-2.0
#include "tests/nodes/io/io_nodes.h"

namespace rayloom
{
namespace
{
using namespace test;

TEST(IoStack, ReadsElementsOfMatchingFiles)
{
    const TemporaryFolder folder;
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
    const TemporaryFolder folder;
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

} // namespace
} // namespace rayloom
