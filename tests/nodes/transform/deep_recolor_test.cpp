// SPDX-License-Identifier: Apache-2.0
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

const char* const scale = "{op: transform.deep_recolor, deep: deep, color: color}";
const char* const spread = "{op: transform.deep_recolor, deep: deep, color: color, method: spread}";
const char* const flatten = "{op: transform.deep_flatten, deep: deep}";
constexpr float nan = std::numeric_limits<float>::quiet_NaN();

MemoryImage color_of(const Region& window, const std::function<float(int, int, int)>& value,
                     std::vector<std::string> channels = {"R", "G", "B"})
{
    MemoryImage image;
    image.desc.data = image.desc.display = window;
    image.desc.channels = std::move(channels);
    image.pixels = ImageBuffer(window, image.desc.channel_count());
    for (int c = 0; c < image.desc.channel_count(); ++c)
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x)
                image.pixels.view().at(c, x, y) = value(c, x, y);
    return image;
}

float some_color(int c, int x, int y)
{
    return 0.01f * static_cast<float>((x * 13 + y * 7 + c * 29 + 4000) % 211);
}

/// Flattened, the recoloured image has the colours asked for, in each pixel that has samples.
void expect_color(const MemoryDeep& recolored, const MemoryImage& color)
{
    const DeepRun run = run_deep(flatten, recolored);
    const MemoryImage& flat = run.image();
    const Region& r = color.desc.data;
    for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x)
            for (int c = 0; c < 3; ++c) {
                double size = 1.0;
                for (const float v : samples_at(recolored, c, x, y)) size += std::abs(v);
                const bool any = !samples_at(recolored, c, x, y).empty();
                ASSERT_NEAR(flat.pixels.view().at(c, x, y),
                            any ? color.pixels.view().at(c, x, y) : 0.0f, 1e-6 * size)
                    << c << " at " << x << "," << y;
            }
}

TEST(TransformDeepRecolor, IsWhatTheEquationsSay)
{
    const MemoryDeep deep = made_up_deep({-7, -3, 30, 25}, 5);
    const MemoryImage color = color_of(deep.desc.data, some_color);
    for (const double max_gain : {8.0, 0.0}) {
        const DeepRun run = run_deep(max_gain > 0.0 ? scale : spread, deep, &color);
        const MemoryDeep& out = run.deep();
        ASSERT_EQ(out.desc.channels, deep.desc.channels);
        const Region& r = deep.desc.data;
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x) {
                // Alpha and depth are untouched.
                ASSERT_EQ(samples_at(out, 3, x, y), samples_at(deep, 3, x, y));
                ASSERT_EQ(samples_at(out, 4, x, y), samples_at(deep, 4, x, y));
                for (int c = 0; c < 3; ++c) {
                    const auto samples = samples_of(deep, c, x, y);
                    if (samples.empty() || oracle::coverage(samples) == 0.0) continue;
                    const auto expected =
                        oracle::recolor(samples, color.pixels.view().at(c, x, y), max_gain);
                    const auto got = samples_at(out, c, x, y);
                    ASSERT_EQ(got.size(), expected.size());
                    for (std::size_t s = 0; s < got.size(); ++s)
                        ASSERT_NEAR(got[s], expected[s],
                                    2e-6 * std::max(1.0, std::abs(expected[s])))
                            << c << " at " << x << "," << y << " sample " << s;
                }
            }
        expect_color(out, color);
    }
}

TEST(TransformDeepRecolor, FlattensToTheColorOfTenThousandSamplesToo)
{
    const MemoryDeep deep = make_deep(
        {0, 0, 5, 3}, {"R", "G", "B", "A", "Z"},
        [](int x, int y) { return x == 2 ? 10000 : (x + y) % 3; },
        [](int c, int x, int, int s) {
            if (c == 3) return 0.001f * static_cast<float>((s + x) % 5);
            if (c == 4) return static_cast<float>((s * 7919) % 10007);
            return 0.01f * static_cast<float>((s * 31 + c) % 17);
        });
    const MemoryImage color = color_of(deep.desc.data, some_color);
    for (const char* const method : {scale, spread}) {
        const DeepRun run = run_deep(method, deep, &color);
        const DeepRun flat = run_deep(flatten, run.deep());
        for (int c = 0; c < 3; ++c) {
            const float wanted = color.pixels.view().at(c, 2, 1);
            EXPECT_NEAR(flat.image().pixels.view().at(c, 2, 1), wanted, 1e-5f * wanted);
        }
    }
}

TEST(TransformDeepRecolor, ScalingKeepsWhatSamplesAreAmongThemselves)
{
    // Red in front of blue, half covering: the denoised pixel is a little brighter.
    const MemoryDeep deep = make_deep(
        {0, 0, 1, 1}, {"R", "G", "B", "A", "Z"}, [](int, int) { return 2; },
        [](int c, int, int, int s) {
            if (c == 3) return s == 0 ? 0.5f : 1.0f;
            if (c == 4) return static_cast<float>(s);
            return (c == 0) == (s == 0) && c != 1 ? 0.4f : 0.0f;
        });
    const MemoryImage color = color_of({0, 0, 1, 1}, [](int c, int, int) {
        return c == 0 ? 0.5f : c == 1 ? 0.0f : 0.3f;
    });
    const DeepRun run = run_deep(scale, deep, &color);
    EXPECT_EQ(samples_at(run.deep(), 0, 0, 0), (std::vector<float>{0.5f, 0.0f}));
    EXPECT_EQ(samples_at(run.deep(), 1, 0, 0), (std::vector<float>{0.0f, 0.0f}));
    const auto blue = samples_at(run.deep(), 2, 0, 0);
    EXPECT_EQ(blue[0], 0.0f);
    EXPECT_NEAR(blue[1], 0.6f, 1e-6f);
    // Spread, both get the colour in proportion to their alpha.
    const DeepRun even = run_deep(spread, deep, &color);
    EXPECT_EQ(samples_at(even.deep(), 0, 0, 0), (std::vector<float>{0.25f, 0.5f}));
}

TEST(TransformDeepRecolor, AddsTheColorDeepOpacityLacksAndKeepsIds)
{
    const MemoryDeep made = made_up_deep({0, 0, 20, 11}, 3);
    // Ids with a remainder, as io.read_deep hands them out.
    MemoryDeep deep = make_deep(
        made.desc.data, {"A", "Z", "id"},
        [&](int x, int y) { return static_cast<int>(samples_at(made, 0, x, y).size()); },
        [&](int c, int x, int y, int s) {
            return c < 2 ? samples_at(made, 3 + c, x, y)[static_cast<std::size_t>(s)]
                         : 123456792.0f;
        });
    for (auto& row : deep.rows) {
        DeepRow with_remainder = *row;
        with_remainder.samples.push_back(std::vector<float>(row->first.back(), -3.0f));
        row = std::make_shared<const DeepRow>(std::move(with_remainder));
    }
    const MemoryImage color = color_of(deep.desc.data, some_color);
    const DeepRun run = run_deep(scale, deep, &color);
    EXPECT_EQ(run.deep().desc.channels, (std::vector<std::string>{"A", "Z", "id", "R", "G", "B"}));
    const DeepRun flat = run_deep(flatten, run.deep());
    const Region& r = deep.desc.data;
    for (int y = r.y0; y < r.y1; ++y) {
        const DeepRow& row = *run.deep().rows[static_cast<std::size_t>(y)];
        ASSERT_EQ(row.samples.size(), 7u);
        EXPECT_EQ(row.samples[2], deep.rows[static_cast<std::size_t>(y)]->samples[2]);
        EXPECT_EQ(row.samples[6], deep.rows[static_cast<std::size_t>(y)]->samples[3]);
        for (int x = r.x0; x < r.x1; ++x)
            if (!samples_at(deep, 0, x, y).empty()) {
                ASSERT_NEAR(flat.image().pixels.view().at(0, x, y), color.pixels.view().at(0, x, y),
                            1e-5f);
            }
    }
}

TEST(TransformDeepRecolor, WithoutCoverageColorGoesToTheNearest)
{
    const auto deep = [](float front, float back) {
        return make_deep(
            {0, 0, 1, 1}, {"R", "G", "B", "A", "Z"}, [](int, int) { return 2; },
            [=](int c, int, int, int s) {
                if (c == 3) return 0.0f;
                if (c == 4) return s == 0 ? 2.0f : 1.0f; // the second is nearer
                return s == 0 ? back : front;
            });
    };
    const MemoryImage color = color_of({0, 0, 1, 1}, [](int, int, int) { return 0.75f; });
    const DeepRun black = run_deep(scale, deep(0.0f, 0.0f), &color);
    EXPECT_EQ(samples_at(black.deep(), 0, 0, 0), (std::vector<float>{0.0f, 0.75f}));
    // Light that covers nothing is scaled without a limit.
    const DeepRun faint = run_deep(scale, deep(1e-4f, 0.0f), &color);
    EXPECT_EQ(samples_at(faint.deep(), 0, 0, 0), (std::vector<float>{0.0f, 0.75f}));
}

TEST(TransformDeepRecolor, BlackMakesBlackAndNaNIsReplaced)
{
    const MemoryDeep deep = with_values(made_up_deep({0, 0, 9, 9}), [](int c, int x, int, float v) {
        return c < 3 && x == 4 ? nan : v;
    });
    const MemoryImage black = color_of({0, 0, 9, 9}, [](int, int, int) { return 0.0f; });
    const DeepRun run = run_deep(scale, deep, &black);
    for (const auto& row : run.deep().rows)
        for (std::size_t c = 0; c < 3; ++c)
            for (const float v : row->samples[c]) EXPECT_EQ(v, 0.0f);
    const MemoryImage color = color_of({0, 0, 9, 9}, some_color);
    const DeepRun repaired = run_deep(scale, deep, &color);
    EXPECT_TRUE(all_finite(repaired.deep()));
    expect_color(repaired.deep(), color);
}

TEST(TransformDeepRecolor, CountsColorWithoutSamples)
{
    const MemoryDeep deep = make_deep(
        {0, 0, 6, 2}, {"A", "Z"}, [](int x, int) { return x < 4 ? 0 : 1; },
        [](int, int, int, int) { return 1.0f; });
    const MemoryImage color =
        color_of({0, 0, 6, 2}, [](int, int x, int) { return x == 0 ? 0.0f : 1.0f; });
    const DeepRun run = run_deep(scale, deep, &color);
    std::size_t counted = 0;
    for (const NodeReport& node : run.report.nodes)
        for (const auto& [what, n] : node.counts)
            if (what == "pixels with colour that have no deep sample") counted += n;
    EXPECT_EQ(counted, 6u);
}

TEST(TransformDeepRecolor, FourTimesTheLightIsFourTimesTheSamples)
{
    const MemoryDeep deep = made_up_deep({0, 0, 17, 13}, 9);
    const MemoryDeep brighter =
        with_values(deep, [](int c, int, int, float v) { return c < 3 ? 4.0f * v : v; });
    const MemoryImage color = color_of(deep.desc.data, some_color);
    const MemoryImage bright =
        color_of(deep.desc.data, [](int c, int x, int y) { return 4.0f * some_color(c, x, y); });
    const DeepRun plain = run_deep(scale, deep, &color);
    const DeepRun scaled = run_deep(scale, brighter, &bright);
    EXPECT_TRUE(same_samples(
        with_values(plain.deep(), [](int c, int, int, float v) { return c < 3 ? 4.0f * v : v; }),
        scaled.deep()));
}

TEST(TransformDeepRecolor, RefusesWhatDoesNotFit)
{
    const auto message = [](const MemoryDeep& deep, const MemoryImage& color) {
        try {
            run_deep(scale, deep, &color);
        } catch (const GraphError& e) {
            return std::string(e.what());
        }
        return std::string();
    };
    const Region window{0, 0, 8, 8};
    const auto one = [](int, int) { return 1; };
    const auto half = [](int, int, int, int) { return 0.5f; };
    const MemoryDeep deep = make_deep(window, {"R", "G", "B", "A", "Z"}, one, half);
    const MemoryDeep no_alpha = make_deep(window, {"R", "G", "B", "Z"}, one, half);
    const auto gray = [](int, int, int) { return 0.5f; };
    EXPECT_NE(message(deep, color_of({0, 0, 8, 9}, gray)).find("must cover the same pixels"),
              std::string::npos)
        << message(deep, color_of({0, 0, 8, 9}, gray));
    EXPECT_NE(message(no_alpha, color_of(window, gray)).find("no alpha channel (A)"),
              std::string::npos);
    EXPECT_NE(message(deep, color_of(window, gray, {"A", "Z"})).find("no colour channel"),
              std::string::npos);
    EXPECT_NE(message(deep, color_of(window, gray, {"Y"})).find("none of its channels"),
              std::string::npos);
}

} // namespace
} // namespace rayloom::test
