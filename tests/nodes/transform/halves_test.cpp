// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

namespace rayloom
{
namespace
{

using test::make_image;
using test::NodeInput;
using test::NodeRun;
using test::run_node;
using test::TestImage;

std::vector<TestImage> stack(int n)
{
    std::vector<TestImage> images;
    for (int i = 0; i < n; ++i)
        images.push_back(make_image({0, 0, 6, 4}, {"R", "G"}, [i](int c, int x, int y) {
            return static_cast<float>((i + 1) * (i + 2) + c * 7 + x - y);
        }));
    return images;
}

NodeRun halves(const std::vector<TestImage>& images)
{
    NodeInput input{"stack", {}, nullptr, true};
    for (const TestImage& image : images) input.images.push_back(&image);
    return run_node("transform.halves", {}, {input});
}

TEST(Halves, ShareNoSample)
{
    const auto images = stack(4);
    const NodeRun run = halves(images);
    for (int x = 0; x < 6; ++x) {
        const auto value = [&](std::size_t i) { return images[i].view().at(1, x, 2); };
        EXPECT_FLOAT_EQ(run.image("a").view().at(1, x, 2), 0.5f * (value(0) + value(2)));
        EXPECT_FLOAT_EQ(run.image("b").view().at(1, x, 2), 0.5f * (value(1) + value(3)));
        EXPECT_FLOAT_EQ(run.image("mean").view().at(1, x, 2),
                        0.25f * (value(0) + value(1) + value(2) + value(3)));
    }
}

TEST(Halves, AnOddStackIsSplitEvenly)
{
    const auto images = stack(3);
    const NodeRun run = halves(images);
    for (int x = 0; x < 6; ++x) {
        const auto value = [&](std::size_t i) { return images[i].view().at(0, x, 1); };
        const float a = run.image("a").view().at(0, x, 1), b = run.image("b").view().at(0, x, 1);
        EXPECT_FLOAT_EQ(a, (value(0) + 0.5f * value(2)) / 1.5f);
        EXPECT_FLOAT_EQ(0.5f * (a + b), run.image("mean").view().at(0, x, 1));
        EXPECT_FLOAT_EQ(0.5f * (a + b), (value(0) + value(1) + value(2)) / 3.0f);
    }
}

TEST(Halves, OneImageIsPassedThroughWithANote)
{
    const auto images = stack(1);
    const NodeRun run = halves(images);
    EXPECT_EQ(run.plan.aliases.size(), 3u);
    ASSERT_EQ(run.plan.notes.size(), 1u);
}

TEST(Halves, ImagesMustBeAlike)
{
    auto images = stack(2);
    images.push_back(make_image({0, 0, 7, 4}, {"R", "G"}, [](int, int, int) { return 0.0f; }));
    EXPECT_THROW(halves(images), NodeError);
    images.pop_back();
    images.push_back(make_image({0, 0, 6, 4}, {"R", "B"}, [](int, int, int) { return 0.0f; }));
    EXPECT_THROW(halves(images), NodeError);
}

} // namespace
} // namespace rayloom
