// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/raster.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

namespace rayloom
{
namespace
{

using test::NodeRun;
using test::random_image;
using test::run_node;
using test::TestImage;

const Region window{-4, 3, 29, 24};

TEST(Modulate, TakesDemodulateBack)
{
    const TestImage image = random_image(window, {"R", "G", "B", "A"}, 1);
    TestImage pivot = random_image(window, {"R", "G", "B"}, 2);
    for (int x = 0; x < 10; ++x) pivot.view().at(x % 3, x, 9) = 0.0f;
    const NodeRun z =
        run_node("transform.demodulate", {}, {{"image", {&image}}, {"pivot", {&pivot}}});
    const NodeRun back = run_node(
        "transform.modulate", {},
        {{"image", {&z.image("image")}}, {"pivot", {&pivot}}, {"marked", {&z.image("marked")}}});
    for (int c = 0; c < 4; ++c)
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x)
                EXPECT_NEAR(back.image().view().at(c, x, y), image.view().at(c, x, y),
                            1.2e-7f * image.view().at(c, x, y));
    EXPECT_EQ(back.image().view().at(0, 0, 9), image.view().at(0, 0, 9));
}

TEST(Modulate, WithoutMarksEveryColourIsMultiplied)
{
    const TestImage image = random_image(window, {"R", "G", "B", "A"}, 1),
                    pivot = random_image(window, {"R", "G", "B"}, 2);
    const NodeRun run =
        run_node("transform.modulate", {}, {{"image", {&image}}, {"pivot", {&pivot}}});
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0; x < window.x1; ++x) {
            for (int c = 0; c < 3; ++c)
                ASSERT_EQ(run.image().view().at(c, x, y),
                          image.view().at(c, x, y) * pivot.view().at(c, x, y));
            ASSERT_EQ(run.image().view().at(3, x, y), image.view().at(3, x, y));
        }
}

TEST(Modulate, KeepsTheOriginalWhereMarked)
{
    const TestImage filtered = random_image(window, {"R", "G", "B"}, 1),
                    pivot = random_image(window, {"R", "G", "B"}, 2),
                    original = random_image(window, {"R", "G", "B"}, 3);
    const TestImage marked = test::make_image(window, {"R", "G", "B"}, [](int c, int x, int y) {
        return (x + y + c) % 3 == 0 ? 1.0f : 0.0f;
    });
    const NodeRun run = run_node("transform.modulate", {},
                                 {{"image", {&filtered}},
                                  {"pivot", {&pivot}},
                                  {"marked", {&marked}},
                                  {"original", {&original}}});
    for (int c = 0; c < 3; ++c)
        for (int x = window.x0; x < window.x1; ++x)
            EXPECT_EQ(run.image().view().at(c, x, 6),
                      marked.view().at(c, x, 6) != 0.0f
                          ? original.view().at(c, x, 6)
                          : filtered.view().at(c, x, 6) * pivot.view().at(c, x, 6));
}

TEST(Modulate, RefusesAnOriginalWithoutMarks)
{
    const TestImage image = random_image(window, {"R", "G", "B"}, 1);
    EXPECT_THROW(run_node("transform.modulate", {},
                          {{"image", {&image}}, {"pivot", {&image}}, {"original", {&image}}}),
                 NodeError);
}

} // namespace
} // namespace rayloom
