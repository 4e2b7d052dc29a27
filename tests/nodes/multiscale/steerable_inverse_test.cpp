// SPDX-License-Identifier: Apache-2.0
#include "nodes/multiscale/steerable_kernel.h"
#include "rayloom/core/error.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace rayloom
{
namespace
{

using test::make_image;
using test::NodeInput;
using test::NodeRun;
using test::run_node;
using test::TestImage;

NodeInput list_of(const NodeRun& run)
{
    NodeInput input{"bands", {}, nullptr, true};
    for (const TestImage& band : run.outputs.at("bands")) input.images.push_back(&band);
    return input;
}

TEST(SteerableInverse, GivesBackTheImage)
{
    for (const Region& window : {Region{0, 0, 97, 61}, Region{-7, 5, 4, 36}, Region{0, 0, 1, 53},
                                 Region{3, 0, 40, 1}, Region{9, 9, 10, 10}})
        for (const int levels : {1, 3, 5})
            for (const float range : {1.0f, 1e6f}) {
                std::mt19937 random(9);
                std::uniform_real_distribution<float> value(0.0f, range);
                const TestImage image =
                    make_image(window, {"R", "G"}, [&](int, int, int) { return value(random); });
                const NodeRun bands =
                    run_node("multiscale.steerable", {{"levels", std::int64_t{levels}}},
                             {{"image", {&image}}});
                const NodeRun again =
                    run_node("multiscale.steerable_inverse", {}, {list_of(bands)});
                EXPECT_EQ(again.image().desc.channels, image.desc.channels);
                ASSERT_EQ(again.image().desc.data, window);
                for (int y = window.y0; y < window.y1; ++y)
                    for (int c = 0; c < 2; ++c)
                        for (int x = window.x0; x < window.x1; ++x)
                            ASSERT_NEAR(again.image().view().at(c, x, y), image.view().at(c, x, y),
                                        1e-6f * range)
                                << window.text() << ", " << levels << " levels";
            }
}

TEST(SteerableInverse, IsTheAdjointOfTheOrientedAnalysis)
{
    // <analysis x, w> = <x, synthesis w> with the bands' scale taken out, for bands that are zero
    // near the edges: what makes the frame tight.
    const Region window{0, 0, 48, 48};
    const auto bump = [&](int seed) {
        return make_image(window, {"Y"}, [&](int, int x, int y) {
            const bool inside = x > 18 && x < 30 && y > 18 && y < 30;
            return inside ? std::sin(static_cast<float>(seed + x * 31 + y * 17)) : 0.0f;
        });
    };
    const TestImage image = bump(1), other = bump(2);
    const NodeRun bands =
        run_node("multiscale.steerable", {{"levels", std::int64_t{2}}}, {{"image", {&image}}});
    for (std::size_t b = 1; b < 9; ++b) {
        // One band holds `other`, the rest nothing.
        std::vector<TestImage> held;
        for (const TestImage& band : bands.outputs.at("bands"))
            held.push_back(
                make_image(band.desc.data, band.desc.channels, [](int, int, int) { return 0.0f; }));
        const Region& r = window;
        double left = 0.0, right = 0.0;
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x) {
                held[b].view().at(0, x, y) = other.view().at(0, x, y);
                left += bands.image("bands", b).view().at(0, x, y) * other.view().at(0, x, y);
            }
        NodeInput input{"bands", {}, nullptr, true};
        for (const TestImage& band : held) input.images.push_back(&band);
        const NodeRun made = run_node("multiscale.steerable_inverse", {}, {input});
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x)
                right += made.image().view().at(0, x, y) * image.view().at(0, x, y);
        const double scale = 2.0 * std::pow(4.0, steerable_band(static_cast<int>(b), 2).level - 1);
        EXPECT_NEAR(left, scale * right, 1e-4 * (1.0 + std::fabs(left))) << b;
    }
}

TEST(SteerableInverse, RefusesWhatIsNotAPyramid)
{
    const TestImage image =
        make_image({0, 0, 20, 20}, {"Y"}, [](int, int x, int) { return static_cast<float>(x); });
    const NodeRun bands =
        run_node("multiscale.steerable", {{"levels", std::int64_t{2}}}, {{"image", {&image}}});
    NodeInput missing = list_of(bands), swapped = list_of(bands);
    missing.images.pop_back();
    std::swap(swapped.images[1], swapped.images[2]);
    EXPECT_THROW(run_node("multiscale.steerable_inverse", {}, {missing}), NodeError);
    EXPECT_THROW(run_node("multiscale.steerable_inverse", {}, {swapped}), NodeError);
}

} // namespace
} // namespace rayloom
