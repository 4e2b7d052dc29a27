// SPDX-License-Identifier: Apache-2.0
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

namespace rayloom
{
namespace
{

using test::make_image;
using test::run_node;
using test::TestImage;

TEST(Bound, IsTwoHalfWidths)
{
    const Region window{0, 0, 6, 5};
    const TestImage mean = make_image(
        window, {"R", "G", "B"}, [](int c, int x, int y) { return static_cast<float>(c + x * y); });
    const TestImage variance =
        make_image(window, {"R", "G", "B"}, [](int, int x, int) { return static_cast<float>(x); });
    const auto interval = run_node("threshold.interval", {{"samples", 16.0}},
                                   {{"mean", {&mean}}, {"variance", {&variance}}});
    const auto bound =
        run_node("measure.bound", {},
                 {{"low", {&interval.image("low")}}, {"high", {&interval.image("high")}}});
    for (int y = 0; y < 5; ++y)
        for (int x = 0; x < 6; ++x)
            EXPECT_NEAR(bound.image("bound").view().at(1, x, y),
                        2.0f * interval.image("half_width").view().at(1, x, y), 1e-5f);
}

TEST(Bound, EndsMustMatch)
{
    const TestImage a =
        make_image({0, 0, 4, 4}, {"R", "G", "B"}, [](int, int, int) { return 0.0f; });
    const TestImage b = make_image({0, 0, 4, 4}, {"Y"}, [](int, int, int) { return 0.0f; });
    EXPECT_THROW(run_node("measure.bound", {}, {{"low", {&a}}, {"high", {&b}}}), NodeError);
}

} // namespace
} // namespace rayloom
