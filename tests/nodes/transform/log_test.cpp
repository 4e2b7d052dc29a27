// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/log_kernel.h"
#include "tests/support/log_graphs.h"

#include <gtest/gtest.h>

#include <cmath>

namespace rayloom::test
{
namespace
{

TEST(Log, KernelFollowsTheLibrary)
{
    for (float x = 1e-37f; x < 1e38f; x *= 1.0137f)
        ASSERT_NEAR(log_of(x), std::log(static_cast<double>(x)),
                    1e-7 * (1.0 + std::fabs(std::log(static_cast<double>(x)))))
            << x;
}

TEST(Log, EpsilonIsAShareOfTheMedian)
{
    const auto image = image_of({0, 0, 10, 10}, {"R", "G", "B", "A"}, [](int c, int x, int y) {
        if (c == 3) return 1.0f;
        return y == 0 ? 0.0f : y == 1 ? -2.0f : 0.5f + 0.01f * static_cast<float>(x);
    });
    RunReport report;
    const MemoryImage out =
        run_text(graph_of("  log: {op: transform.log, image: image, epsilon: 0.01}\n", "log.log",
                          "  figures: log.figures\n"),
                 {{"image", image}}, {}, {}, &report);
    const Table& figures = report.tables.at("figures").front();
    EXPECT_NEAR(figures.number("epsilon"), 0.01 * 0.545, 0.01 * 0.545 * 0.03);
    EXPECT_EQ(figures.number("zero"), 30.0);
    EXPECT_EQ(figures.number("negative"), 30.0);
    EXPECT_EQ(figures.number("positive"), 240.0);
    EXPECT_EQ(out.desc.channels, (std::vector<std::string>{"R", "G", "B"}));
    const double epsilon = figures.number("epsilon");
    EXPECT_NEAR(out.pixels.view().at(1, 4, 5), std::log(0.54 + epsilon), 1e-6);
    EXPECT_NEAR(out.pixels.view().at(1, 4, 0), std::log(epsilon), 1e-6);
    EXPECT_NEAR(out.pixels.view().at(1, 4, 1), std::log(epsilon), 1e-6);
}

TEST(Log, ScalingTheImageShiftsTheLogarithm)
{
    const auto make = [](float factor) {
        return image_of({0, 0, 20, 20}, {"Y"}, [factor](int, int x, int y) {
            return factor * static_cast<float>((x * 13 + y * 7) % 11);
        });
    };
    const std::string graph = graph_of("  log: {op: transform.log, image: image}\n", "log.log");
    const MemoryImage one = run_text(graph, {{"image", make(1.0f)}}),
                      eight = run_text(graph, {{"image", make(8.0f)}});
    for (int y = 0; y < 20; ++y)
        for (int x = 0; x < 20; ++x)
            EXPECT_NEAR(eight.pixels.view().at(0, x, y) - one.pixels.view().at(0, x, y),
                        std::log(8.0), 2e-6);
}

TEST(Log, BlackAndHugeImagesStayFinite)
{
    for (const float value : {0.0f, -1.0f, 1e-30f, 1e38f}) {
        const auto image =
            image_of({0, 0, 5, 5}, {"R", "G", "B"}, [&](int, int, int) { return value; });
        EXPECT_TRUE(all_finite(run_text(
            graph_of("  log: {op: transform.log, image: image, opponent: true}\n", "log.log"),
            {{"image", image}})));
    }
}

TEST(Log, OpponentAxesNeedThreeChannels)
{
    const auto image = image_of({0, 0, 5, 5}, {"Y"}, [](int, int, int) { return 1.0f; });
    EXPECT_THROW(
        run_text(graph_of("  log: {op: transform.log, image: image, opponent: true}\n", "log.log"),
                 {{"image", image}}),
        GraphError);
}

} // namespace
} // namespace rayloom::test
