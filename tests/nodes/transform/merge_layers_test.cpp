// SPDX-License-Identifier: Apache-2.0
#include "tests/nodes/transform/layered_image.h"

namespace rayloom::node_test
{
namespace
{

TEST(MergeLayers, PrefixesChannels)
{
    const TestImagePtr image = render();
    const TestImagePtr a = layer(image, "DiffDir"), b = layer(image, "Depth");
    const NodeRun run = run_node("transform.merge_layers", {{"names", Texts{"diffuse", ""}}},
                                 {{"layers", {a, b}}}, 8, 8);
    const TestImage& out = *run.outputs.at("image")[0];
    EXPECT_EQ(out.desc.channels, (Texts{"diffuse.R", "diffuse.G", "diffuse.B", "Z"}));
    EXPECT_EQ(out.pixels.view().at(3, 0, 0), b->pixels.view().at(0, 0, 0));
    EXPECT_EQ(run.plan.channel_aliases.size(), 4u);
}

TEST(MergeLayers, SplitThenMergedIsTheSameImage)
{
    const TestImagePtr image = render();
    const NodeRun split = run_node("transform.layers", {}, {{"image", {image}}});
    const NodeRun merged = run_node("transform.merge_layers",
                                    {{"names", Texts{"ViewLayer.Combined", "ViewLayer.DiffDir",
                                                     "ViewLayer.Depth", "Hair.DiffInd", ""}}},
                                    {{"layers", split.outputs.at("layers")}});
    EXPECT_EQ(difference(*merged.outputs.at("image")[0], *image), "");
}

TEST(MergeLayers, ReplacesInPlaceAndKeepsTheRest)
{
    const TestImagePtr image = render();
    const TestImagePtr filtered =
        random_image(image->desc.data, image->desc.display, {"R", "G", "B"}, 77);
    const NodeRun run = run_node("transform.merge_layers", {{"names", Texts{"DiffDir"}}},
                                 {{"layers", {filtered}}, {"into", {image}}}, 13, 5);
    const TestImage& out = *run.outputs.at("image")[0];
    EXPECT_EQ(out.desc.channels, image->desc.channels);
    for (int c = 0; c < 14; ++c)
        for (int x = -5; x < 40; ++x) {
            const bool replaced = c >= 4 && c < 7;
            ASSERT_EQ(out.pixels.view().at(c, x, 4),
                      (replaced ? filtered : image)->pixels.view().at(replaced ? c - 4 : c, x, 4));
        }
    ASSERT_EQ(run.plan.channel_aliases.size(), 14u);
    EXPECT_EQ(run.plan.channel_aliases[4].input, "layers");
    EXPECT_EQ(run.plan.channel_aliases[7].input, "into");
}

TEST(MergeLayers, LayersCanBeNamedByTheirRole)
{
    const TestImagePtr image = render();
    const TestImagePtr filtered =
        random_image(image->desc.data, image->desc.display, {"R", "G", "B"}, 77);
    const auto merged = [&](const char* param, const char* name) {
        return run_node("transform.merge_layers",
                        {{param, Texts{name}}, {"renderer", std::string("cycles")}},
                        {{"layers", {filtered}}, {"into", {image}}})
            .outputs.at("image")[0];
    };
    EXPECT_EQ(difference(*merged("roles", "diffuse_direct"), *merged("names", "DiffDir")), "");
    EXPECT_EQ(difference(*merged("roles", "diffuse_indirect"), *merged("names", "DiffInd")), "");
}

TEST(MergeLayers, WiderWindowAddsZerosAndIsNoPassThrough)
{
    const TestImagePtr small = random_image({2, 2, 6, 5}, {0, 0, 8, 8}, {"R"}, 3);
    const TestImagePtr large = random_image({0, 0, 8, 8}, {0, 0, 8, 8}, {"R"}, 4);
    const NodeRun run = run_node("transform.merge_layers", {{"names", Texts{"s", "l"}}},
                                 {{"layers", {small, large}}}, 3, 3);
    const ConstImageView out = run.outputs.at("image")[0]->pixels.view();
    EXPECT_EQ(out.region(), (Region{0, 0, 8, 8}));
    EXPECT_EQ(out.at(0, 1, 1), 0.0f);
    EXPECT_EQ(out.at(0, 5, 4), small->pixels.view().at(0, 5, 4));
    EXPECT_EQ(out.at(1, 7, 7), large->pixels.view().at(0, 7, 7));
    ASSERT_EQ(run.plan.channel_aliases.size(), 1u);
    EXPECT_EQ(run.plan.channel_aliases[0].output_channel, 1);
    const NodeRun other = run_node("transform.merge_layers", {{"names", Texts{"l", "s"}}},
                                   {{"layers", {large, small}}}, 3, 3);
    EXPECT_EQ(other.outputs.at("image")[0]->desc.data, (Region{0, 0, 8, 8}));
}

TEST(MergeLayers, ErrorsSayWhatToDo)
{
    const TestImagePtr one = random_image({0, 0, 4, 4}, {0, 0, 4, 4}, {"R"}, 1);
    expect_error("transform.merge_layers", {{"names", Texts{"a"}}}, {{"layers", {one, one}}},
                 "one name an image");
    expect_error("transform.merge_layers", {{"names", Texts{"a", "a"}}}, {{"layers", {one, one}}},
                 "different names");
}

} // namespace
} // namespace rayloom::node_test
