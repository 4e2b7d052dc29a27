// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/quantiles.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <cmath>

namespace rayloom
{
namespace
{

using test::make_image;
using test::NodeRun;
using test::run_node;
using test::TestImage;

const std::vector<std::string> rgb{"R", "G", "B"};
const Region window{-2, 1, 9, 8};

TestImage ramp()
{
    return make_image(window, rgb,
                      [](int c, int x, int y) { return 0.1f * static_cast<float>(c + x * x + y); });
}
TestImage spread()
{
    return make_image(window, rgb, [](int c, int x, int y) {
        return 0.01f * static_cast<float>(1 + c + x + 2 + y);
    });
}

std::string error_of(const ParamValues& p, const std::vector<test::NodeInput>& inputs)
{
    try {
        run_node("threshold.interval", p, inputs);
    } catch (const Error& e) {
        return e.what();
    }
    return "no error";
}

TEST(Interval, IsStudents)
{
    const TestImage mean = ramp(), variance = spread();
    const TestImage count = make_image(
        window, {"count"}, [](int, int x, int) { return static_cast<float>(x + 4) + 0.5f; });
    for (const double confidence : {0.95, 0.99, 0.998}) {
        const NodeRun run =
            run_node("threshold.interval", {{"confidence", confidence}},
                     {{"mean", {&mean}}, {"variance", {&variance}}, {"count", {&count}}});
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x)
                for (int c = 0; c < 3; ++c) {
                    const double n = x + 4.5;
                    const double h =
                        student_t_factor(std::floor(n), 1.0 - confidence) *
                        std::sqrt(static_cast<double>(variance.view().at(c, x, y)) / n);
                    ASSERT_NEAR(run.image("half_width").view().at(c, x, y), h, 1e-5 * h);
                    ASSERT_NEAR(run.image("low").view().at(c, x, y),
                                static_cast<double>(mean.view().at(c, x, y)) - h, 1e-5);
                    ASSERT_NEAR(run.image("high").view().at(c, x, y),
                                static_cast<double>(mean.view().at(c, x, y)) + h, 1e-5);
                }
    }
}

TEST(Interval, TakesTheVarianceOfTheMean)
{
    const TestImage mean = ramp(), variance = spread();
    const NodeRun run =
        run_node("threshold.interval", {{"samples", 2.0}, {"variance_of", std::string("mean")}},
                 {{"mean", {&mean}}, {"variance", {&variance}}});
    EXPECT_NEAR(run.image("half_width").view().at(1, 3, 4),
                63.6567 * std::sqrt(0.01 * (1 + 1 + 5 + 4)), 1e-3);
}

TEST(Interval, HandsOnTheVarianceOfTheMean)
{
    const TestImage mean = ramp(), variance = spread();
    const std::vector<test::NodeInput> inputs{{"mean", {&mean}}, {"variance", {&variance}}};
    const NodeRun of_sample = run_node("threshold.interval", {{"samples", 8.0}}, inputs);
    const NodeRun of_mean = run_node(
        "threshold.interval", {{"samples", 8.0}, {"variance_of", std::string("mean")}}, inputs);
    const float v = variance.view().at(2, 4, 4);
    EXPECT_EQ(of_sample.image("variance").view().at(2, 4, 4), v / 8.0f);
    EXPECT_EQ(of_mean.image("variance").view().at(2, 4, 4), v);
}

TEST(Interval, NoVarianceMakesNoWidth)
{
    const TestImage mean = ramp();
    const TestImage none = make_image(window, rgb, [](int, int, int) { return 0.0f; });
    const NodeRun run = run_node("threshold.interval", {{"samples", 8.0}},
                                 {{"mean", {&mean}}, {"variance", {&none}}});
    EXPECT_EQ(test::differing_floats(run.image("low"), mean), 0u);
    EXPECT_EQ(test::differing_floats(run.image("high"), mean), 0u);
}

TEST(Interval, OneSampleHasNone)
{
    const TestImage mean = ramp(), variance = spread();
    const TestImage count = make_image(window, {"count"}, [](int, int x, int y) {
        return x == 3 && y == 5 ? 1.0f : x == 4 ? 0.0f : 4.0f;
    });
    const std::vector<test::NodeInput> inputs{
        {"mean", {&mean}}, {"variance", {&variance}}, {"count", {&count}}};
    const std::string why =
        "one sample has no confidence interval; render at least two samples a pixel (or the frame "
        "twice with different seeds), or set too_few: neighbours";
    EXPECT_EQ(error_of({}, inputs), "pixel (3, 5): " + why);
    EXPECT_EQ(error_of({{"samples", 1.0}}, {{"mean", {&mean}}, {"variance", {&variance}}}), why);
    EXPECT_NE(error_of({}, {{"mean", {&mean}}, {"variance", {&variance}}}).find("set `samples`"),
              std::string::npos);

    const NodeRun run =
        run_node("threshold.interval", {{"too_few", std::string("neighbours")}}, inputs);
    double average = 0.0, squares = 0.0;
    for (int y = 3; y < 8; ++y)
        for (int x = 1; x < 6; ++x) average += static_cast<double>(mean.view().at(0, x, y)) / 25.0;
    for (int y = 3; y < 8; ++y)
        for (int x = 1; x < 6; ++x)
            squares += std::pow(static_cast<double>(mean.view().at(0, x, y)) - average, 2);
    EXPECT_NEAR(run.image("half_width").view().at(0, 3, 5),
                student_t_factor(25, 0.01) * std::sqrt(squares / 24.0), 1e-4);
    EXPECT_EQ(run.image("half_width").view().at(0, 4, 5), 0.0f);
    EXPECT_EQ(run.counted.at("pixels with one sample, width from their neighbours"), 1u);
}

TEST(Interval, WithoutVarianceThereAreTheNeighboursOrAnError)
{
    const TestImage mean = ramp(), variance = spread();
    EXPECT_EQ(error_of({{"samples", 16.0}}, {{"mean", {&mean}}}),
              "there is no variance; connect one, or a stack of renders to take it from, or set "
              "too_few: neighbours");
    const ParamValues neighbours{{"samples", 1.0}, {"too_few", std::string("neighbours")}};
    const NodeRun one =
        run_node("threshold.interval", neighbours, {{"mean", {&mean}}, {"variance", {&variance}}});
    const NodeRun none =
        run_node("threshold.interval", {{"samples", 16.0}, {"too_few", std::string("neighbours")}},
                 {{"mean", {&mean}}});
    EXPECT_EQ(test::differing_floats(one.image("low"), none.image("low")), 0u);
    EXPECT_EQ(none.counted.at("pixels with one sample, width from their neighbours"),
              window.pixels());
}

} // namespace
} // namespace rayloom
