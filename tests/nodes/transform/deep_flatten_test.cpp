// SPDX-License-Identifier: Apache-2.0
#include "tests/nodes/oiio/oiiotool.h"
#include "tests/oracle/deep.h"
#include "tests/support/made_up_deep.h"
#include "tests/support/run_deep_node.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace rayloom::test
{
namespace
{

const char* const flatten = "{op: transform.deep_flatten, deep: deep}";

TEST(TransformDeepFlatten, IsWhatTheEquationsSay)
{
    const MemoryDeep deep = made_up_deep({-7, -3, 30, 25}, 5);
    const DeepRun run = run_deep(flatten, deep);
    const MemoryImage& flat = run.image();
    EXPECT_EQ(flat.desc.channels, (std::vector<std::string>{"R", "G", "B", "A"}));
    EXPECT_EQ(flat.desc.data, deep.desc.data);
    EXPECT_EQ(flat.desc.display, deep.desc.display);
    const Region& r = flat.desc.data;
    for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x)
            for (int c = 0; c < 4; ++c) {
                const double expected = oracle::flatten(samples_of(deep, c, x, y));
                ASSERT_NEAR(flat.pixels.view().at(c, x, y), expected,
                            1e-6 * std::max(1.0, std::abs(expected)))
                    << c << " at " << x << "," << y;
            }
}

TEST(TransformDeepFlatten, IsWhatOiiotoolMakesOfSortedSamples)
{
    if (!node_test::have_oiiotool()) GTEST_SKIP() << "no oiiotool";
    // oiiotool takes samples as they are stored, so they are stored in order.
    const MemoryDeep made = made_up_deep({3, -9, 40, 21}, 8);
    const MemoryDeep deep = make_deep(
        made.desc.data, made.desc.channels,
        [&](int x, int y) { return static_cast<int>(samples_at(made, 0, x, y).size()); },
        [&](int c, int x, int y, int s) {
            return c == 4 ? 1.0f + static_cast<float>(s)
                          : samples_at(made, c, x, y)[static_cast<std::size_t>(s)];
        });
    const TemporaryFolder folder;
    write_deep_exr(folder.file("deep.exr"), deep, {"float", "float", "float", "float", "float"});
    const auto theirs =
        node_test::oiiotool(folder.file("deep.exr") + " --flatten --ch R,G,B,A", {});
    const DeepRun run = run_deep(flatten, deep);
    const Region& r = deep.desc.data;
    ASSERT_EQ(theirs->desc.data, r);
    for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x)
            for (int c = 0; c < 4; ++c) {
                const float v = theirs->pixels.view().at(c, x, y);
                ASSERT_NEAR(run.image().pixels.view().at(c, x, y), v,
                            2e-6f * std::max(1.0f, std::abs(v)))
                    << c << " at " << x << "," << y;
            }
}

TEST(TransformDeepFlatten, TenThousandSamplesAndNone)
{
    const MemoryDeep deep = make_deep(
        {0, 0, 3, 1}, {"R", "G", "B", "A", "Z"}, [](int x, int) { return x == 1 ? 10000 : x; },
        [](int c, int, int, int s) {
            return c == 3 ? 1e-4f : c == 4 ? static_cast<float>((s * 7919) % 10007) : 0.5f * 1e-4f;
        });
    const MemoryImage flat = std::move(run_deep(flatten, deep).report.images.at("out").front());
    const double alpha = static_cast<double>(1e-4f);
    const double covered = 1.0 - std::pow(1.0 - alpha, 10000.0);
    EXPECT_NEAR(flat.pixels.view().at(3, 1, 0), covered, 1e-6);
    EXPECT_NEAR(flat.pixels.view().at(0, 1, 0), 0.5 * covered, 1e-6);
    for (int c = 0; c < 4; ++c) EXPECT_EQ(flat.pixels.view().at(c, 0, 0), 0.0f);
}

TEST(TransformDeepFlatten, WhatIsHiddenCountsForNothing)
{
    const float nan = std::numeric_limits<float>::quiet_NaN();
    // The sample in front covers all; one behind, stored first, is NaN, and so is a depth.
    const MemoryDeep deep = make_deep(
        {0, 0, 1, 1}, {"R", "G", "B", "A", "Z"}, [](int, int) { return 3; },
        [&](int c, int, int, int s) {
            if (c == 4) return s == 0 ? 5.0f : s == 1 ? 1.0f : nan;
            if (c == 3) return s == 1 ? 1.0f : 0.5f;
            return s == 1 ? 0.25f : nan;
        });
    const MemoryImage flat = std::move(run_deep(flatten, deep).report.images.at("out").front());
    EXPECT_EQ(flat.pixels.view().at(0, 0, 0), 0.25f);
    EXPECT_EQ(flat.pixels.view().at(3, 0, 0), 1.0f);
}

TEST(TransformDeepFlatten, RefusesWhatHasNoAlphaOrNoColour)
{
    const auto message = [](std::vector<std::string> channels) {
        try {
            run_deep(flatten, make_deep(
                                  {0, 0, 2, 2}, std::move(channels), [](int, int) { return 1; },
                                  [](int, int, int, int) { return 0.5f; }));
        } catch (const Error& e) {
            return std::string(e.what());
        }
        return std::string();
    };
    EXPECT_NE(message({"R", "G", "B", "Z"}).find("no alpha channel (A)"), std::string::npos);
    EXPECT_NE(message({"A", "Z"}).find("no colour channel"), std::string::npos);
}

} // namespace
} // namespace rayloom::test
