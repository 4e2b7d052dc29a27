// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/engine_nodes_for_tests.h"
#include "tests/support/made_up_render.h"

#include <gtest/gtest.h>

namespace rayloom::test
{
namespace
{

MemoryImage take(const std::string& params)
{
    return run_text("rayloom: 1\ninputs: {render: r}\nnodes:\n  pass: {op: transform.pass, image: "
                    "render, " +
                        params + "}\noutputs: {image: pass}\n",
                    {{"render", made_up_render({}, 3)}});
}

TEST(Pass, TakesTheLayerThatPlaysTheRole)
{
    const auto render = made_up_render({}, 3);
    const MemoryImage normal = take("role: normal"), beauty = take("role: beauty");
    EXPECT_EQ(normal.desc.channels, (std::vector<std::string>{"X", "Y", "Z"}));
    EXPECT_EQ(beauty.desc.channels, (std::vector<std::string>{"R", "G", "B", "A"}));
    for (int c = 0; c < 4; ++c)
        EXPECT_EQ(beauty.pixels.view().at(c, 7, 5), render->pixels.view().at(c, 7, 5));
}

TEST(Pass, AbsentIsBlankOrAnError)
{
    const MemoryImage blank = take("role: motion, required: false, blank: [U, V]");
    EXPECT_EQ(blank.desc.channels, (std::vector<std::string>{"U", "V"}));
    EXPECT_EQ(blank.pixels.view().at(1, 3, 3), 0.0f);
    EXPECT_THROW(take("role: motion"), GraphError);
    EXPECT_THROW(take("role: beuty"), GraphError);
    EXPECT_THROW(take("role: beauty, renderer: cycels"), GraphError);
}

} // namespace
} // namespace rayloom::test
