// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/engine_nodes_for_tests.h"
#include "tests/support/made_up_render.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

namespace rayloom::test
{
namespace
{

MemoryImage parts(const std::string& source)
{
    return run_text("rayloom: 1\ninputs: {render: r}\nnodes:\n  parts: {op: transform.parts, "
                    "render: render, source: " +
                        source + "}\noutputs: {image: parts}\n",
                    {{"render", made_up_render({}, 3)}});
}

TEST(Parts, IdsTellObjectsAndMaterialsApart)
{
    const MemoryImage p = parts("ids");
    EXPECT_EQ(p.desc.channels, (std::vector<std::string>{"id0", "coverage0"}));
    const auto id = [&](int x, int y) { return p.pixels.view().at(0, x, y); };
    EXPECT_EQ(id(2, 2), 1.0f * 4096.0f + 3.0f);
    EXPECT_EQ(id(2, 12), 1.0f * 4096.0f + 4.0f);
    EXPECT_EQ(id(20, 2), 2.0f * 4096.0f + 3.0f);
    EXPECT_EQ(p.pixels.view().at(1, 20, 2), 1.0f);
}

TEST(Parts, AnIdThatIsNoNumberIsAnObjectOfItsOwn)
{
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const float infinity = std::numeric_limits<float>::infinity();
    auto render = std::make_shared<MemoryImage>();
    render->desc.data = render->desc.display = {0, 0, 4, 1};
    render->desc.channels = {"IndexOB.X", "IndexMA.X"};
    render->pixels = ImageBuffer(render->desc.data, 2);
    const float objects[] = {2.0f, nan, infinity, 2.0f}, materials[] = {1.0f, 1.0f, 1.0f, nan};
    std::ranges::copy(objects, render->pixels.view().row(0, 0));
    std::ranges::copy(materials, render->pixels.view().row(1, 0));
    const MemoryImage p =
        run_text("rayloom: 1\ninputs: {render: r}\nnodes:\n  parts: {op: transform.parts, "
                 "render: render, source: ids}\noutputs: {image: parts}\n",
                 {{"render", render}});
    const float* id = p.pixels.view().row(0, 0);
    EXPECT_EQ(id[0], 2.0f * 4096.0f + 1.0f);
    EXPECT_EQ(id[1], 4095.0f * 4096.0f + 1.0f);
    EXPECT_EQ(id[2], id[1]);
    EXPECT_EQ(id[3], 2.0f * 4096.0f + 4095.0f);
}

TEST(Parts, CryptomatteKeepsItsRanks)
{
    const MemoryImage p = parts("auto");
    ASSERT_EQ(p.desc.channel_count(), 4);
    EXPECT_EQ(p.pixels.view().at(0, 12, 4), -3.25f);
    EXPECT_EQ(p.pixels.view().at(1, 12, 4), 0.75f);
    EXPECT_EQ(p.pixels.view().at(2, 12, 4), 11.5f);
    EXPECT_EQ(p.pixels.view().at(3, 12, 4), 0.25f);
}

TEST(Parts, WithoutIdsAllIsOnePart)
{
    const MemoryImage p = parts("none");
    EXPECT_EQ(p.pixels.view().at(0, 2, 2), p.pixels.view().at(0, 20, 12));
    EXPECT_EQ(p.pixels.view().at(1, 2, 2), 1.0f);
}

} // namespace
} // namespace rayloom::test
