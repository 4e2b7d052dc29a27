// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/engine_nodes_for_tests.h"
#include "tests/support/made_up_render.h"

#include <gtest/gtest.h>

#include <cmath>

namespace rayloom::test
{
namespace
{

std::string graph(const char* split, const char* merge_split, const std::string& lobes)
{
    return std::string("rayloom: 1\ninputs: {render: all layers}\nnodes:\n"
                       "  layers: {op: transform.layers, image: render}\n"
                       "  beauty: {op: transform.pass, image: render, role: beauty}\n"
                       "  lobes: {op: transform.lobes, render: render, layers: layers, split: ") +
           split +
           "}\n"
           "  merged: {op: transform.merge_lobes, render: render, layers: layers, lobes: " +
           lobes + ", beauty: beauty, split: " + merge_split + "}\noutputs: {image: merged}\n";
}

TEST(MergeLobes, UnfilteredTheRenderComesBack)
{
    const auto render = made_up_render({"TransDir", "TransInd"}, 4);
    for (const char* split : {"true", "false"}) {
        const MemoryImage merged =
            run_text(graph(split, split, "lobes.radiance"), {{"render", render}});
        ASSERT_EQ(merged.desc.channels, render->desc.channels);
        for (int c = 0; c < merged.desc.channel_count(); ++c) {
            const std::string& name = merged.desc.channels[static_cast<std::size_t>(c)];
            const bool light =
                name.find("Dir.") != std::string::npos || name.find("Ind.") != std::string::npos;
            for (int y = 0; y < 18; ++y)
                for (int x = 0; x < 24; ++x) {
                    const float was = render->pixels.view().at(c, x, y);
                    ASSERT_NEAR(merged.pixels.view().at(c, x, y), was, light ? 1e-6f * was : 0.0f)
                        << name;
                }
        }
    }
}

TEST(MergeLobes, LightWhereBothLayersWereBlackGoesToTheFirst)
{
    const auto render = made_up_render({}, 4);
    const auto channel = [&](const std::string& name) {
        const int c = render->desc.channel("ViewLayer." + name);
        EXPECT_GE(c, 0) << name;
        return c;
    };
    const int direct = channel("DiffDir.G"), indirect = channel("DiffInd.G"),
              pivot = channel("DiffCol.G");
    for (int y = 0; y < 18; ++y)
        for (int x = 0; x < 6; ++x)
            for (const int c : {direct, indirect}) render->pixels.view().at(c, x, y) = 0.0f;
    std::string text = graph("false", "false", "brighter");
    text.insert(text.find("  merged:"),
                "  brighter: {op: oiio.add, image: lobes.radiance, value: [0.5]}\n");
    const MemoryImage merged = run_text(text, {{"render", render}});
    for (int y = 0; y < 18; ++y)
        for (int x = 0; x < 24; ++x) {
            const auto at = [&](const MemoryImage& image, int c) {
                return static_cast<double>(image.pixels.view().at(c, x, y));
            };
            const double p = at(*render, pivot);
            if (p <= 0.0) continue;
            const double light = at(*render, direct) + at(*render, indirect) + 0.5 / p;
            ASSERT_NEAR(at(merged, direct) + at(merged, indirect), light, 1e-5 * light);
            ASSERT_EQ(at(merged, indirect) == 0.0, x < 6);
        }
}

TEST(MergeLobes, RefusesAnotherSplit)
{
    EXPECT_THROW(
        run_text(graph("true", "false", "lobes.radiance"), {{"render", made_up_render({}, 4)}}),
        GraphError);
}

} // namespace
} // namespace rayloom::test
