// SPDX-License-Identifier: Apache-2.0
#include "tests/support/tiled_node.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <random>

namespace rayloom::node_test
{
namespace
{

const float nan = std::numeric_limits<float>::quiet_NaN();
const float inf = std::numeric_limits<float>::infinity();

struct Damaged {
    TestImagePtr sound;
    std::shared_ptr<TestImage> image;

    Damaged() : sound(random_image({-9, -4, 32, 27}, {0, 0, 30, 30}, {"R", "G", "B", "A"}, 21))
    {
        image = std::make_shared<TestImage>();
        image->desc = sound->desc;
        image->pixels = ImageBuffer(sound->desc.data, 4);
        copy_pixels(sound->pixels.view(), image->pixels.view());
    }
    void set(int channel, int x, int y, float value)
    {
        image->pixels.view().at(channel, x, y) = value;
    }
    NodeRun run(const ParamValues& params = {}, int w = 0, int h = 0) const
    {
        return run_node("threshold.sanitize", params, {{"image", {image}}}, w, h);
    }
};

float mean_of_good(const TestImage& image, int c, int x, int y, int radius)
{
    double sum = 0.0;
    int n = 0;
    const Region window =
        Region{x - radius, y - radius, x + radius + 1, y + radius + 1}.intersect(image.desc.data);
    for (int yy = window.y0; yy < window.y1; ++yy)
        for (int xx = window.x0; xx < window.x1; ++xx)
            if (const float v = image.pixels.view().at(c, xx, yy); std::isfinite(v)) {
                sum += static_cast<double>(v);
                ++n;
            }
    return n > 0 ? static_cast<float>(sum / n) : 0.0f;
}

TEST(Sanitize, SoundImagePassesBitForBit)
{
    Damaged d;
    d.set(0, 3, 3, 3e38f); // as bright as floats get: finite, so untouched
    d.set(1, 4, 4, -1e30f);
    d.set(2, 5, 5, 1e-42f);
    d.set(3, 6, 6, -0.0f);
    const NodeRun run = d.run();
    EXPECT_EQ(difference(*run.outputs.at("image")[0], *d.image), "");
    EXPECT_TRUE(run.counts.empty());
}

TEST(Sanitize, BadValuesAreReplacedAndPixelsCountedOnce)
{
    Damaged d;
    d.set(0, -9, -4, nan); // a corner
    d.set(0, 5, 5, inf);
    d.set(1, 5, 5, nan); // the same pixel
    d.set(2, 31, 26, -inf);
    const NodeRun run = d.run();
    const TestImage& out = *run.outputs.at("image")[0];
    EXPECT_EQ(run.counts.at("NaN pixels repaired"), 3u);
    EXPECT_EQ(out.pixels.view().at(0, -9, -4), mean_of_good(*d.image, 0, -9, -4, 1));
    EXPECT_EQ(out.pixels.view().at(0, 5, 5), mean_of_good(*d.image, 0, 5, 5, 1));
    EXPECT_EQ(out.pixels.view().at(1, 5, 5), mean_of_good(*d.image, 1, 5, 5, 1));
    EXPECT_EQ(out.pixels.view().at(2, 31, 26), mean_of_good(*d.image, 2, 31, 26, 1));
    // The sound channels of a damaged pixel, and every other pixel, are as they were.
    const TestImagePtr again = [&] {
        auto copy = std::make_shared<TestImage>();
        copy->desc = out.desc;
        copy->pixels = ImageBuffer(out.desc.data, 4);
        copy_pixels(out.pixels.view(), copy->pixels.view());
        for (const auto& [c, x, y] : {std::array{0, -9, -4}, {0, 5, 5}, {1, 5, 5}, {2, 31, 26}})
            copy->pixels.view().at(c, x, y) = d.sound->pixels.view().at(c, x, y);
        return copy;
    }();
    EXPECT_EQ(difference(*again, *d.sound), "");
}

TEST(Sanitize, WindowGrowsUntilItFindsAGoodValue)
{
    Damaged d;
    for (int y = 8; y < 13; ++y)
        for (int x = 8; x < 13; ++x) d.set(1, x, y, nan);
    const auto middle = [&](const ParamValues& params) {
        return d.run(params).outputs.at("image")[0]->pixels.view().at(1, 10, 10);
    };
    EXPECT_EQ(middle({}), mean_of_good(*d.image, 1, 10, 10, 3));
    EXPECT_EQ(middle({{"reach", std::int64_t{2}}}), 0.0f);
    EXPECT_EQ(middle({{"mode", std::string("box3")}}), 0.0f);
    EXPECT_EQ(middle({{"mode", std::string("black")}}), 0.0f);
    EXPECT_EQ(d.run().outputs.at("image")[0]->pixels.view().at(1, 9, 9),
              mean_of_good(*d.image, 1, 9, 9, 2));
}

TEST(Sanitize, AllBadBecomesBlack)
{
    Damaged d;
    for (int c = 0; c < 4; ++c)
        for (int y = -4; y < 27; ++y)
            for (int x = -9; x < 32; ++x) d.set(c, x, y, nan);
    const NodeRun run = d.run();
    EXPECT_EQ(run.counts.at("NaN pixels repaired"), 41u * 31u);
    for (int c = 0; c < 4; ++c)
        for (int y = -4; y < 27; ++y)
            for (int x = -9; x < 32; ++x)
                ASSERT_EQ(run.outputs.at("image")[0]->pixels.view().at(c, x, y), 0.0f);
}

TEST(Sanitize, NegativeAndBrightColourOnlyOnRequest)
{
    Damaged d;
    for (int c = 0; c < 4; ++c)
        for (int y = -4; y < 27; ++y)
            for (int x = -9; x < 32; ++x) d.set(c, x, y, 1.0f);
    d.set(0, 2, 2, -0.5f);
    d.set(2, 25, 15, -0.25f); // twice below, once above: neither is taken for the other
    d.set(1, 7, 7, 1000.0f);
    d.set(2, 12, 12, nan);
    d.set(3, 20, 20, -7.0f); // alpha is no colour
    const NodeRun plain = d.run();
    EXPECT_EQ(plain.counts.size(), 1u);
    EXPECT_EQ(plain.outputs.at("image")[0]->pixels.view().at(1, 7, 7), 1000.0f);
    const NodeRun strict =
        d.run({{"negative", true}, {"limit", 999.0}}); // the brightest is not far above
    EXPECT_EQ(strict.counts.at("NaN pixels repaired"), 1u);
    EXPECT_EQ(strict.counts.at("negative pixels repaired"), 2u);
    EXPECT_EQ(strict.counts.at("pixels above the limit repaired"), 1u);
    const ConstImageView out = strict.outputs.at("image")[0]->pixels.view();
    EXPECT_EQ(out.at(0, 2, 2), 1.0f);
    EXPECT_EQ(out.at(1, 7, 7), 1.0f); // of its neighbours, not the limit
    EXPECT_EQ(out.at(3, 20, 20), -7.0f);
}

TEST(Sanitize, TilesEqualTheWholeAndCountOnce)
{
    Damaged d;
    std::mt19937 random(5);
    for (int i = 0; i < 300; ++i)
        d.set(static_cast<int>(random() % 4), -9 + static_cast<int>(random() % 41),
              -4 + static_cast<int>(random() % 31), i % 3 == 0 ? inf : nan);
    for (const char* mode : {"neighbours", "box3", "black"}) {
        const ParamValues params = {{"mode", std::string(mode)}, {"negative", true}};
        const NodeRun whole = d.run(params);
        for (const auto& [w, h] : {std::pair{5, 3}, {41, 1}, {1, 31}, {16, 16}}) {
            const NodeRun tiled = d.run(params, w, h);
            EXPECT_EQ(difference(*tiled.outputs.at("image")[0], *whole.outputs.at("image")[0]), "");
            EXPECT_EQ(tiled.counts, whole.counts);
        }
    }
}

} // namespace
} // namespace rayloom::node_test
