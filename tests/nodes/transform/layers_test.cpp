// SPDX-License-Identifier: Apache-2.0
#include "tests/nodes/transform/layered_image.h"

namespace rayloom::node_test
{
namespace
{

TEST(Layers, SplitIntoAListInTheOrderAsked)
{
    const TestImagePtr image = render();
    const NodeRun run = run_node("transform.layers", {{"layers", Texts{"DiffInd", "DiffDir"}}},
                                 {{"image", {image}}}, 11, 6);
    ASSERT_EQ(run.outputs.at("layers").size(), 2u);
    EXPECT_EQ(difference(*run.outputs.at("layers")[0], *layer(image, "Hair.DiffInd")), "");
    EXPECT_EQ(difference(*run.outputs.at("layers")[1], *layer(image, "ViewLayer.DiffDir")), "");
    EXPECT_EQ(run.plan.channel_aliases.size(), 6u);
    EXPECT_EQ(run_node("transform.layers", {}, {{"image", {image}}}).outputs.at("layers").size(),
              5u);
}

} // namespace
} // namespace rayloom::node_test
