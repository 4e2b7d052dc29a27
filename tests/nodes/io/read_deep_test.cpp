// SPDX-License-Identifier: Apache-2.0
#include "tests/nodes/io/io_nodes.h"

namespace rayloom
{
namespace
{
using namespace test;

TEST(IoReadDeep, Rows)
{
    const TemporaryFolder folder;
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
