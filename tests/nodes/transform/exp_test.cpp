// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/log_kernel.h"
#include "tests/support/log_graphs.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

namespace rayloom::test
{
namespace
{

TEST(Exp, KernelFollowsTheLibrary)
{
    for (float y = -80.0f; y < 80.0f; y += 0.0173f)
        ASSERT_NEAR(exp_of(y) / std::exp(static_cast<double>(y)), 1.0, 2.5e-7) << y;
    EXPECT_TRUE(std::isfinite(exp_of(1e30f)));
    EXPECT_GE(exp_of(-1e30f), 0.0f);
}

TEST(Exp, UndoesTheLogarithm)
{
    const auto image = image_of({-3, 2, 40, 30}, {"R", "G", "B"}, [](int c, int x, int y) {
        return (x + y) % 7 == 0
                   ? 0.0f
                   : std::exp(0.37f * static_cast<float>((x * 5 + y * 3 + c) % 40) - 8.0f);
    });
    for (const char* opponent : {"false", "true"}) {
        const MemoryImage out = run_text(
            graph_of(std::string("  log: {op: transform.log, image: image, opponent: ") + opponent +
                         "}\n"
                         "  back: {op: transform.exp, image: log.log, figures: log.figures, "
                         "opponent: " +
                         opponent + "}\n",
                     "back"),
            {{"image", image}});
        EXPECT_EQ(out.desc.channels, image->desc.channels);
        for (int y = 2; y < 30; ++y)
            for (int c = 0; c < 3; ++c)
                for (int x = -3; x < 40; ++x) {
                    const float v = image->pixels.view().at(c, x, y);
                    ASSERT_NEAR(out.pixels.view().at(c, x, y), v, 1e-5 * v + 1e-7) << opponent;
                }
    }
}

TEST(Exp, HasTheValueAt87Beyond)
{
    const auto image = image_of({0, 0, 6, 1}, {"R"}, [](int, int x, int) {
        return std::array{86.0f, 87.0f, 88.5f, 96.0f, 1e4f, 1e30f}[static_cast<std::size_t>(x)];
    });
    const auto ones = image_of({0, 0, 6, 1}, {"R"}, [](int, int, int) { return 1.0f; });
    const MemoryImage out =
        run_text("rayloom: 1\ninputs: {image: logarithms, other: light}\nnodes:\n"
                 "  log: {op: transform.log, image: other}\n"
                 "  back: {op: transform.exp, image: image, figures: log.figures}\n"
                 "outputs: {image: back}\n",
                 {{"image", image}, {"other", ones}});
    const auto row = out.pixels.view().row_span(0, 0);
    EXPECT_NEAR(row[0] / std::exp(86.0f), 1.0f, 1e-6f);
    EXPECT_NEAR(row[1] / std::exp(87.0f), 1.0f, 1e-6f);
    for (std::size_t x = 2; x < 6; ++x) EXPECT_EQ(row[x], row[1]) << x;
}

TEST(Exp, WhatFallsBelowBlackIsBlack)
{
    // Filtered logarithms may end below ln ε, that of black.
    const auto image = image_of({0, 0, 9, 5}, {"R", "G"}, [](int c, int x, int y) {
        return 0.25f * static_cast<float>(x * y + c);
    });
    const MemoryImage out =
        run_text(graph_of("  log: {op: transform.log, image: image}\n"
                          "  less: {op: oiio.add, image: log.log, value: [-3]}\n"
                          "  back: {op: transform.exp, image: less, figures: log.figures}\n",
                          "back"),
                 {{"image", image}});
    EXPECT_EQ(out.pixels.view().at(0, 0, 0), 0.0f);
    EXPECT_GT(out.pixels.view().at(0, 8, 4), 0.0f);
    for (int y = 0; y < 5; ++y)
        for (int c = 0; c < 2; ++c)
            for (const float v : out.pixels.view().row_span(c, y)) EXPECT_GE(v, 0.0f);
}

TEST(Exp, AxesMustAgree)
{
    const auto image = image_of({0, 0, 5, 5}, {"R", "G", "B"}, [](int, int, int) { return 1.0f; });
    EXPECT_THROW(run_text(graph_of("  log: {op: transform.log, image: image}\n"
                                   "  back: {op: transform.exp, image: log.log, figures: "
                                   "log.figures, opponent: true}\n",
                                   "back"),
                          {{"image", image}}),
                 InputError);
}

} // namespace
} // namespace rayloom::test
