// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/reader.h"
#include "tests/support/engine_nodes_for_tests.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace rayloom::test
{
namespace
{

const char* const graph = R"(
rayloom: 1
name: coverage
params: {samples: 8.0, confidence: 0.95}
inputs:
  mean: mean
  variance: variance
  reference: truth
  image: {doc: filtered, optional: true}
nodes:
  interval: {op: threshold.interval, mean: mean, variance: variance, samples: $samples, confidence: $confidence}
  coverage: {op: measure.coverage, low: interval.low, high: interval.high, reference: reference, image: image}
outputs:
  figures: coverage.coverage
)";

std::shared_ptr<MemoryImage> filled(const Region& window, float value)
{
    auto image = noise_image(window, 3);
    image->pixels.fill(value);
    return image;
}

Table run(const std::map<std::string, std::shared_ptr<const MemoryImage>>& inputs)
{
    RunRequest request;
    for (const auto& [name, image] : inputs) request.inputs[name].images = {image};
    return run_graph(parse_graph(graph, "coverage.yaml"), request).tables.at("figures").front();
}

TEST(Coverage, IsTheConfidenceForNormalSamples)
{
    const Region window{0, 0, 200, 200};
    auto mean = filled(window, 0.0f), variance = filled(window, 0.0f), truth = filled(window, 2.0f);
    std::mt19937 random(1);
    std::normal_distribution<double> sample(2.0, 3.0);
    for (int y = 0; y < 200; ++y)
        for (int x = 0; x < 200; ++x)
            for (int c = 0; c < 3; ++c) {
                double sum = 0.0, squares = 0.0;
                std::vector<double> s(8);
                for (double& v : s) sum += v = sample(random);
                for (const double v : s) squares += (v - sum / 8.0) * (v - sum / 8.0);
                mean->pixels.view().at(c, x, y) = static_cast<float>(sum / 8.0);
                variance->pixels.view().at(c, x, y) = static_cast<float>(squares / 7.0);
            }
    const Table t =
        run({{"mean", mean}, {"variance", variance}, {"reference", truth}, {"image", mean}});
    EXPECT_NEAR(t.number("interval_G"), 0.95, 0.006);
    EXPECT_NEAR(t.number("interval"), 0.95, 0.004);
    EXPECT_GT(t.number("bound"), t.number("interval"));
    EXPECT_EQ(t.number("pixels"), 40000.0);
}

TEST(Coverage, CountsExactlyAndLeavesOutWhatIsNotFinite)
{
    const Region window{0, 0, 10, 10};
    auto mean = filled(window, 1.0f), variance = filled(window, 0.0f), truth = filled(window, 1.0f);
    for (int x = 0; x < 5; ++x) truth->pixels.view().at(0, x, 0) = 1.5f;
    truth->pixels.view().at(2, 9, 9) = std::numeric_limits<float>::infinity();
    const Table t = run({{"mean", mean}, {"variance", variance}, {"reference", truth}});
    EXPECT_DOUBLE_EQ(t.number("interval_R"), 94.0 / 99.0);
    EXPECT_DOUBLE_EQ(t.number("interval_B"), 1.0);
    EXPECT_EQ(t.number("pixels"), 99.0);
    EXPECT_FALSE(t.has("bound"));
}

} // namespace
} // namespace rayloom::test
