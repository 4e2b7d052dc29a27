// SPDX-License-Identifier: Apache-2.0
#include "tests/nodes/transform/layered_image.h"

namespace rayloom::node_test
{
namespace
{

TEST(Layer, IsFoundByItsFullOrLastName)
{
    const TestImagePtr image = render();
    for (const std::string name : {"ViewLayer.DiffDir", "DiffDir"}) {
        const TestImagePtr out = layer(image, name);
        EXPECT_EQ(out->desc.channels, (Texts{"R", "G", "B"}));
        EXPECT_EQ(out->desc.data, image->desc.data);
        for (int c = 0; c < 3; ++c)
            EXPECT_EQ(out->pixels.view().at(c, -5, 21), image->pixels.view().at(4 + c, -5, 21));
    }
    const TestImagePtr plain = layer(image, "");
    EXPECT_EQ(plain->pixels.view().at(2, 7, 7), image->pixels.view().at(13, 7, 7));
}

TEST(Layer, ChannelsCanBePickedRenamedAndMade)
{
    const TestImagePtr image = render();
    const NodeRun run =
        run_node("transform.layer",
                 {{"layer", std::string("Combined")}, {"channels", Texts{"B", "Y=G", "A=0.5"}}},
                 {{"image", {image}}}, 9, 4);
    const TestImage& out = *run.outputs.at("image")[0];
    EXPECT_EQ(out.desc.channels, (Texts{"B", "Y", "A"}));
    EXPECT_EQ(out.pixels.view().at(0, 3, 3), image->pixels.view().at(2, 3, 3));
    EXPECT_EQ(out.pixels.view().at(1, 3, 3), image->pixels.view().at(1, 3, 3));
    EXPECT_EQ(out.pixels.view().at(2, 3, 3), 0.5f);
    ASSERT_EQ(run.plan.channel_aliases.size(), 2u);
    EXPECT_EQ(run.plan.channel_aliases[0].input_channel, 2);
    EXPECT_EQ(run.plan.channel_aliases[1].input_channel, 1);
}

TEST(Layer, ErrorsNameWhatThereIs)
{
    const TestInputs in = {{"image", {render()}}};
    expect_error("transform.layer", {{"layer", std::string("DifDir")}}, in, "DiffDir");
    expect_error("transform.layer", {{"layer", std::string("Depth")}, {"channels", Texts{"R"}}}, in,
                 "Z");
    const TestImagePtr two = random_image({0, 0, 4, 4}, {0, 0, 4, 4}, {"A.Diff.R", "B.Diff.R"}, 1);
    expect_error("transform.layer", {{"layer", std::string("Diff")}}, {{"image", {two}}},
                 "'A.Diff' and 'B.Diff'");
}

} // namespace
} // namespace rayloom::node_test
