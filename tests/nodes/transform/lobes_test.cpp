// SPDX-License-Identifier: Apache-2.0
// The whole way through the passes of a render: roles, lobes, remainder and sum.
#include "rayloom/core/error.h"
#include "tests/support/engine_nodes_for_tests.h"
#include "tests/support/made_up_render.h"

#include <gtest/gtest.h>

#include <cmath>

namespace rayloom::test
{
namespace
{

const std::string apart = "rayloom: 1\n"
                          "inputs: {render: all layers}\n"
                          "nodes:\n"
                          "  layers: {op: transform.layers, image: render}\n"
                          "  beauty: {op: transform.pass, image: render, role: beauty}\n"
                          "  lobes: {op: transform.lobes, render: render, layers: layers}\n";

const std::string together =
    apart + "  rest: {op: transform.remainder, image: beauty, parts: lobes.radiance}\n"
            "  sum: {op: fuse.sum, images: lobes.radiance, base: rest}\n"
            "outputs: {image: sum}\n";

void expect_beauty(const MemoryImage& sum, const MemoryImage& render)
{
    ASSERT_EQ(sum.desc.channels, (std::vector<std::string>{"R", "G", "B", "A"}));
    for (int c = 0; c < 4; ++c)
        for (int y = 0; y < sum.desc.data.y1; ++y)
            for (int x = 0; x < sum.desc.data.x1; ++x) {
                const float beauty = render.pixels.view().at(c, x, y);
                ASSERT_NEAR(sum.pixels.view().at(c, x, y), beauty, 1e-6f * (1.0f + beauty));
            }
}

TEST(Lobes, UnfilteredTheySumToTheBeauty)
{
    const auto render = made_up_render({}, 5);
    expect_beauty(run_text(together, {{"render", render}}), *render);
}

TEST(Lobes, LightThatThePassesMissIsNotLost)
{
    const auto render = made_up_render({}, 5, 1.7f);
    expect_beauty(run_text(together, {{"render", render}}), *render);
}

TEST(Lobes, BlackLobesVanish)
{
    const auto render = made_up_render({"TransDir", "TransInd", "GlossInd"}, 6);
    RunReport report;
    const std::string count = apart + "  one: {op: transform.modulate, image: lobes.radiance, "
                                      "pivot: lobes.pivot}\n"
                                      "  sum: {op: fuse.sum, images: one}\n"
                                      "outputs: {image: sum}\n";
    RunOptions no_skip;
    no_skip.skip = false;
    const MemoryImage fast = run_text(count, {{"render", render}}, {}, {}, &report);
    EXPECT_TRUE(same_bits(fast, run_text(count, {{"render", render}}, no_skip)));
    std::string notes;
    for (const std::string& note : report.notes) notes += note + "\n";
    EXPECT_NE(notes.find("transmission: black, skipped"), std::string::npos) << notes;
    EXPECT_EQ(notes.find("glossy: black"), std::string::npos) << notes;
}

TEST(Lobes, LightDividedByABlackColourIsBlack)
{
    const auto render = made_up_render({"DiffCol"}, 6);
    RunReport report;
    expect_beauty(run_text(together, {{"render", render}}, {}, {}, &report), *render);
    std::string notes;
    for (const std::string& note : report.notes) notes += note + "\n";
    EXPECT_NE(notes.find("diffuse: black, skipped"), std::string::npos) << notes;
}

TEST(Lobes, ARenderWithoutLightPassesOnItsBeauty)
{
    const auto render = made_up_render({"Dir", "Ind"}, 6);
    expect_beauty(run_text(together, {{"render", render}}), *render);
    // One lobe stays, so that what works on all of them has something to work on.
    const MemoryImage first =
        run_text(apart + "outputs: {image: 'lobes.radiance[0]'}\n", {{"render", render}});
    EXPECT_EQ(first.pixels.view().at(1, 4, 3), 0.0f);
}

TEST(Lobes, AlbedoIsThePivotOfDiffuseLightAlone)
{
    auto render = std::make_shared<MemoryImage>();
    render->desc.data = render->desc.display = Region{0, 0, 24, 18};
    for (const std::string layer : {"", "diffuse.", "specular.", "albedo."})
        for (const char* c : {"R", "G", "B"}) render->desc.channels.push_back(layer + c);
    render->pixels = ImageBuffer(render->desc.data, 12);
    render->pixels.fill(0.5f);
    const std::string text =
        "rayloom: 1\ninputs: {render: all layers}\nnodes:\n"
        "  layers: {op: transform.layers, image: render}\n"
        "  lobes: {op: transform.lobes, render: render, layers: layers, renderer: generic}\n"
        "outputs: {image: 'lobes.radiance[0]'}\n";
    RunReport report;
    run_text(text, {{"render", render}}, {}, {}, &report);
    std::string notes;
    for (const std::string& note : report.notes) notes += note + "\n";
    EXPECT_EQ(notes.find("diffuse: no pivot"), std::string::npos) << notes;
    EXPECT_NE(notes.find("glossy: no pivot"), std::string::npos) << notes;
}

TEST(Lobes, RadianceIsColourTimesLight)
{
    const auto render = made_up_render({}, 7);
    const MemoryImage diffuse =
        run_text(apart + "outputs: {image: 'lobes.radiance[0]'}\n", {{"render", render}});
    const auto at = [&](const char* channel, int x, int y) {
        const int c = render->desc.channel("ViewLayer." + std::string(channel));
        return render->pixels.view().at(c, x, y);
    };
    EXPECT_FLOAT_EQ(diffuse.pixels.view().at(1, 4, 3),
                    at("DiffCol.G", 4, 3) * (at("DiffDir.G", 4, 3) + at("DiffInd.G", 4, 3)));
    std::string split = apart;
    split.replace(split.rfind('}'), 1, ", split: true}");
    for (const auto& [lobe, light] : {std::pair{"[0]", "DiffDir.G"}, {"[1]", "DiffInd.G"}}) {
        const MemoryImage one = run_text(split + "outputs: {image: 'lobes.radiance" + lobe + "'}\n",
                                         {{"render", render}});
        EXPECT_FLOAT_EQ(one.pixels.view().at(1, 4, 3), at("DiffCol.G", 4, 3) * at(light, 4, 3));
    }
}

TEST(Lobes, RefusesLayersOfSomethingElse)
{
    const auto render = made_up_render({}, 7);
    EXPECT_THROW(run_text("rayloom: 1\ninputs: {render: r}\nnodes:\n"
                          "  lobes: {op: transform.lobes, render: render, layers: [render]}\n"
                          "outputs: {image: 'lobes.radiance[0]'}\n",
                          {{"render", render}}),
                 GraphError);
}

} // namespace
} // namespace rayloom::test
