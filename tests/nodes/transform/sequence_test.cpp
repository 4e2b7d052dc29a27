// SPDX-License-Identifier: Apache-2.0
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <utility>

namespace rayloom
{
namespace
{

using test::make_image;
using test::run_node;
using test::TestImage;

TestImage frame(float value, const Region& window = {0, 0, 9, 7})
{
    return make_image(window, {"R", "G", "B"},
                      [=](int c, int x, int y) { return value + static_cast<float>(c + x * y); });
}

TEST(Sequence, KeepsTheOrder)
{
    const TestImage a = frame(10), b = frame(20), now = frame(30), c = frame(40);
    const auto run = run_node(
        "transform.sequence", {},
        {{"before", {&a, &b}, nullptr, true}, {"frame", {&now}}, {"after", {&c}, nullptr, true}});
    ASSERT_EQ(run.outputs.at("frames").size(), 4u);
    std::size_t i = 0;
    for (const TestImage* expected : {&a, &b, &now, &c})
        EXPECT_EQ(test::differing_floats(run.image("frames", i++), *expected), 0u);
    ASSERT_EQ(run.plan.aliases.size(), 4u);
    const std::pair<const char*, std::size_t> from[] = {
        {"before", 0}, {"before", 1}, {"frame", 0}, {"after", 0}};
    for (i = 0; i < 4; ++i) {
        EXPECT_EQ(run.plan.aliases[i].input, from[i].first) << i;
        EXPECT_EQ(run.plan.aliases[i].input_element, from[i].second) << i;
    }
    EXPECT_EQ(run_node("transform.sequence", {}, {{"frame", {&now}}}).outputs.at("frames").size(),
              1u);
}

TEST(Sequence, FramesOfOtherSizesAreRefused)
{
    const TestImage a = frame(10), other = frame(20, {0, 0, 9, 8});
    EXPECT_THROW(
        run_node("transform.sequence", {}, {{"frame", {&a}}, {"after", {&other}, nullptr, true}}),
        NodeError);
}

} // namespace
} // namespace rayloom
