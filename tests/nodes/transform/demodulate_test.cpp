// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/raster.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace rayloom
{
namespace
{

using test::make_image;
using test::NodeRun;
using test::random_image;
using test::run_node;
using test::TestImage;

const Region window{-4, 3, 29, 24};

TEST(Demodulate, DividesAndMarksTinyPivots)
{
    const TestImage image = random_image(window, {"R", "G", "B", "A"}, 1);
    TestImage pivot = random_image(window, {"R", "G", "B"}, 2);
    pivot.view().at(0, 0, 5) = 0.0f;
    pivot.view().at(1, 1, 5) = 1e-5f;
    pivot.view().at(2, 2, 5) = std::numeric_limits<float>::quiet_NaN();
    pivot.view().at(2, 3, 5) = -1.0f;
    const NodeRun run =
        run_node("transform.demodulate", {}, {{"image", {&image}}, {"pivot", {&pivot}}});
    double sum = 0.0;
    int n = 0;
    for (int c = 0; c < 3; ++c)
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x)
                if (const float p = pivot.view().at(c, x, y); p > 0.0f) {
                    sum += p;
                    ++n;
                }
    const double limit = 0.001 * sum / n;
    int marks = 0;
    for (int c = 0; c < 3; ++c)
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x) {
                const float l = image.view().at(c, x, y), p = pivot.view().at(c, x, y);
                const bool divided = p > limit;
                marks += divided ? 0 : 1;
                EXPECT_EQ(run.image("marked").view().at(c, x, y), divided ? 0.0f : 1.0f);
                EXPECT_EQ(run.image("image").view().at(c, x, y), divided ? l / p : l);
                EXPECT_EQ(run.image("image").view().at(3, x, y), image.view().at(3, x, y));
            }
    EXPECT_GE(marks, 4);
    EXPECT_LT(marks, 60);
}

TEST(Demodulate, SameFactorOnBothLeavesZ)
{
    const TestImage image = random_image(window, {"R", "G", "B"}, 1),
                    pivot = random_image(window, {"R", "G", "B"}, 2);
    const auto scaled = [&](const TestImage& from) {
        return make_image(window, {"R", "G", "B"}, [&](int c, int x, int y) {
            return from.view().at(c, x, y) * (0.5f + 0.1f * static_cast<float>((x + 2 * y) & 7));
        });
    };
    const TestImage image2 = scaled(image), pivot2 = scaled(pivot);
    const ParamValues all{{"threshold", 0.0}};
    const NodeRun a = run_node("transform.demodulate", all,
                               {{"image", {&image}}, {"pivot", {&pivot}}}),
                  b = run_node("transform.demodulate", all,
                               {{"image", {&image2}}, {"pivot", {&pivot2}}});
    for (int c = 0; c < 3; ++c)
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x) {
                const float z = a.image("image").view().at(c, x, y);
                EXPECT_NEAR(b.image("image").view().at(c, x, y), z, 3e-7f * z);
            }
}

TEST(Demodulate, VarianceByTheSquare)
{
    const TestImage image = random_image(window, {"R", "G", "B"}, 1),
                    variance = random_image(window, {"R", "G", "B"}, 3);
    const TestImage half = make_image(window, {"Y"}, [](int, int, int) { return 0.5f; });
    const NodeRun run =
        run_node("transform.demodulate", {},
                 {{"image", {&image}}, {"pivot", {&half}}, {"variance", {&variance}}});
    EXPECT_EQ(run.image("variance").view().at(1, 3, 7), 4.0f * variance.view().at(1, 3, 7));
    EXPECT_EQ(run.image("image").view().at(2, 3, 7), 2.0f * image.view().at(2, 3, 7));
}

TEST(Demodulate, RefusesOtherChannels)
{
    const TestImage image = random_image(window, {"R", "G", "B"}, 1),
                    two = random_image(window, {"U", "V"}, 3);
    EXPECT_THROW(run_node("transform.demodulate", {}, {{"image", {&image}}, {"pivot", {&two}}}),
                 NodeError);
}

} // namespace
} // namespace rayloom
