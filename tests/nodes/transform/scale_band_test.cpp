// SPDX-License-Identifier: Apache-2.0
#include "tests/support/log_graphs.h"

#include <gtest/gtest.h>

namespace rayloom::test
{
namespace
{

const Region window{-3, 5, 42, 36};

std::map<std::string, std::shared_ptr<const MemoryImage>> inputs()
{
    return {{"image", image_of(window, {"R", "G"},
                               [](int c, int x, int y) {
                                   return static_cast<float>((x * 7 + y * 5 + 3 * c + 40) % 13);
                               })},
            {"map", image_of(window, {"strength"}, [](int, int x, int y) {
                 return 1.0f + 0.01f * static_cast<float>((x + 3) * (y - 4));
             })}};
}

MemoryImage run(const std::string& nodes, const std::string& from, RunReport* report = nullptr,
                const std::string& more = "")
{
    return run_text("rayloom: 1\nname: test\ninputs:\n  image: any\n  map: any\nnodes:\n"
                    "  bands: {op: multiscale.steerable, image: image, levels: 2}\n" +
                        nodes + "outputs:\n  image: " + from + "\n" + more,
                    inputs(), {}, {}, report);
}

TEST(ScaleBand, DividesByTheMapMirroredBeyondTheImage)
{
    RunReport report;
    const MemoryImage even = run("  even: {op: transform.scale_band, band: bands, map: map}\n",
                                 "'even[7]'", &report, "  band: 'bands[7]'\n");
    const MemoryImage& band = report.images.at("band").front();
    const auto map = inputs().at("map");
    const Region& r = even.desc.data;
    ASSERT_EQ(r, band.desc.data);
    ASSERT_LT(r.x0, window.x0);
    const auto mirror = [](int i, int lo, int hi) {
        return i < lo ? 2 * lo - 1 - i : i >= hi ? 2 * hi - 1 - i : i;
    };
    for (int c = 0; c < 2; ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x)
                ASSERT_EQ(even.pixels.view().at(c, x, y),
                          band.pixels.view().at(c, x, y) /
                              map->pixels.view().at(0, mirror(x, window.x0, window.x1),
                                                    mirror(y, window.y0, window.y1)));
}

TEST(ScaleBand, MultiplyingGivesTheBandAgainAndTheLowPassIsHandedOn)
{
    for (const int i : {0, 1, 4, 8, 9}) {
        const std::string at = "[" + std::to_string(i) + "]'";
        RunReport report;
        const MemoryImage back =
            run("  even: {op: transform.scale_band, band: bands, map: map}\n"
                "  back: {op: transform.scale_band, band: even, map: map, mode: multiply}\n",
                "'back" + at, &report, "  band: 'bands" + at + "\n  even: 'even" + at + "\n");
        const Region& r = back.desc.data;
        const ConstImageView band = report.images.at("band").front().pixels.view(),
                             even = report.images.at("even").front().pixels.view();
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x) {
                ASSERT_NEAR(back.pixels.view().at(1, x, y), band.at(1, x, y), 2e-6);
                if (i == 9) {
                    ASSERT_EQ(even.at(1, x, y), band.at(1, x, y));
                }
            }
    }
}

TEST(ScaleBand, AMapOfAnotherSizeOrWithMoreChannelsIsAnError)
{
    EXPECT_THROW(run("  part: {op: oiio.crop, image: map, width: 20, height: 20}\n"
                     "  even: {op: transform.scale_band, band: bands, map: part}\n",
                     "'even[1]'"),
                 GraphError);
    EXPECT_THROW(run("  even: {op: transform.scale_band, band: bands, map: image}\n", "'even[1]'"),
                 GraphError);
}

} // namespace
} // namespace rayloom::test
