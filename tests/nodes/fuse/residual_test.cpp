// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace rayloom::test
{
namespace
{

constexpr Region window{-3, 2, 38, 31};

struct Case {
    TestImage image, original, variance;

    std::vector<NodeInput> inputs() const
    {
        return {{"image", {&image}}, {"original", {&original}}, {"variance", {&variance}}};
    }
};

/// A filter that did well on the left and blurred an edge on the right.
Case noisy_case(float noise)
{
    std::mt19937 random(7);
    std::normal_distribution<float> normal(0.0f, 1.0f);
    const auto truth = [](int x) { return x < 28 ? 1.0f : 3.0f; };
    Case k;
    k.image = make_image(window, {"R", "G", "B"}, [&](int c, int x, int) {
        return (std::abs(x - 28) < 4 ? 2.0f : truth(x)) + 0.1f * static_cast<float>(c);
    });
    k.original = make_image(window, {"R", "G", "B"}, [&](int c, int x, int) {
        return truth(x) + 0.1f * static_cast<float>(c) + noise * normal(random);
    });
    k.variance = make_image(window, {"R", "G", "B"}, [&](int, int, int) { return noise * noise; });
    return k;
}

double share(const Case& k, int radius, double factor, int x, int y)
{
    double b = 0.0, v = 0.0;
    for (int j = std::max(window.y0, y - radius); j < std::min(window.y1, y + radius + 1); ++j)
        for (int i = std::max(window.x0, x - radius); i < std::min(window.x1, x + radius + 1); ++i)
            for (int n = 0; n < 3; ++n) {
                const double z = k.original.view().at(n, i, j), f = k.image.view().at(n, i, j);
                b += (z - f) * (z - f);
                v += k.variance.view().at(n, i, j);
            }
    return factor * v > 0.0 ? std::max(0.0, 1.0 - factor * v / b) : 1.0;
}

double expected(const Case& k, int radius, double factor, double support, int support_radius, int c,
                int x, int y)
{
    double s = share(k, radius, factor, x, y);
    if (support > 0.0) {
        double sum = 0.0;
        int count = 0;
        for (int j = y - support_radius; j <= y + support_radius; ++j)
            for (int i = x - support_radius; i <= x + support_radius; ++i) {
                if (!window.contains(i, j)) continue;
                sum += share(k, radius, factor, i, j);
                ++count;
            }
        s *= std::min(1.0, sum / count / support);
    }
    const double z = k.original.view().at(c, x, y), f = k.image.view().at(c, x, y);
    return f + s * (z - f);
}

TEST(Residual, Oracle)
{
    const Case k = noisy_case(0.2f);
    struct Setting {
        int radius;
        double support;
        int support_radius;
    };
    for (const auto& [radius, support, around] :
         {Setting{0, 0.0, 2}, {1, 0.5, 2}, {3, 0.0, 0}, {1, 1.0, 1}, {2, 0.3, 5}, {0, 0.7, 0}}) {
        const NodeRun run = run_node("fuse.residual",
                                     {{"radius", std::int64_t{radius}},
                                      {"factor", 1.5},
                                      {"support", support},
                                      {"support_radius", std::int64_t{around}}},
                                     k.inputs());
        for (int c = 0; c < 3; ++c)
            for (int y = window.y0; y < window.y1; ++y)
                for (int x = window.x0; x < window.x1; ++x)
                    ASSERT_NEAR(run.image("image").view().at(c, x, y),
                                expected(k, radius, 1.5, support, around, c, x, y), 3e-5)
                        << c << " " << x << " " << y;
    }
}

TEST(Residual, EdgesComeBackAndNoiseDoesNot)
{
    const Case k = noisy_case(0.1f);
    const NodeRun run = run_node("fuse.residual", {}, k.inputs());
    double left = 0.0, noise = 0.0;
    for (int y = window.y0; y < window.y1; ++y) {
        for (int x = window.x0; x < 20; ++x) {
            left += std::pow(run.image("image").view().at(0, x, y) - 1.0f, 2);
            noise += std::pow(k.original.view().at(0, x, y) - 1.0f, 2);
        }
        EXPECT_NEAR(run.image("image").view().at(0, 27, y), 1.0f, 0.4f);
        EXPECT_NEAR(run.image("image").view().at(0, 28, y), 3.0f, 0.4f);
    }
    EXPECT_LT(left, 0.05 * noise);
}

TEST(Residual, GapsBetweenFirefliesStayFiltered)
{
    // One bright pixel in four; what lies between them has no noise to be seen.
    Case k = noisy_case(0.1f);
    std::mt19937 random(3);
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0; x < window.x1; ++x) {
            const bool bright = random() % 4 == 0;
            for (int c = 0; c < 3; ++c) {
                k.image.view().at(c, x, y) = 1.0f;
                k.original.view().at(c, x, y) = bright ? 4.0f : 0.0f;
                k.variance.view().at(c, x, y) = bright ? 12.0f : 0.001f;
            }
        }
    const auto dark = [&](double support) {
        const NodeRun run = run_node("fuse.residual", {{"support", support}}, k.inputs());
        int count = 0;
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x)
                count += run.image("image").view().at(0, x, y) < 0.5f;
        return count;
    };
    EXPECT_GT(dark(0.0), 30);
    EXPECT_LT(dark(0.5), dark(0.0) / 2);
}

TEST(Residual, WithoutNoiseTheOriginalComesBack)
{
    const Case k = noisy_case(0.0f);
    const NodeRun run = run_node("fuse.residual", {{"radius", std::int64_t{2}}}, k.inputs());
    EXPECT_EQ(differing_floats(run.image("image"), k.original), 0u);
}

TEST(Residual, FactorZeroGivesTheOriginal)
{
    const Case k = noisy_case(0.3f);
    const NodeRun run = run_node("fuse.residual", {{"factor", 0.0}}, k.inputs());
    EXPECT_EQ(differing_floats(run.image("image"), k.original), 0u);
}

TEST(Residual, LeavesMarkedAndBrokenPixelsAsFiltered)
{
    Case k = noisy_case(0.1f);
    k.original.view().at(1, 5, 5) = std::numeric_limits<float>::quiet_NaN();
    k.original.view().at(0, 9, 9) = std::numeric_limits<float>::infinity();
    k.variance.view().at(2, 12, 12) = std::numeric_limits<float>::quiet_NaN();
    const TestImage marked =
        make_image(window, {"R", "G", "B"}, [](int, int x, int) { return x >= 26 ? 1.0f : 0.0f; });
    std::vector<NodeInput> inputs = k.inputs();
    inputs.push_back({"marked", {&marked}});
    const NodeRun run = run_node("fuse.residual", {}, inputs);
    for (int c = 0; c < 3; ++c)
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x) {
                ASSERT_TRUE(std::isfinite(run.image("image").view().at(c, x, y)));
                if (x < 26) continue;
                ASSERT_EQ(run.image("image").view().at(c, x, y), k.image.view().at(c, x, y));
            }
}

TEST(Residual, RefusesOtherColours)
{
    const Case k = noisy_case(0.1f);
    const TestImage one = make_image(window, {"Y"}, [](int, int, int) { return 1.0f; });
    EXPECT_THROW(run_node("fuse.residual", {},
                          {{"image", {&k.image}}, {"original", {&one}}, {"variance", {&one}}}),
                 NodeError);
}

} // namespace
} // namespace rayloom::test
