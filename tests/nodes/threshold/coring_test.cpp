// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/posterior_mean.h"
#include "tests/support/log_graphs.h"

#include <gtest/gtest.h>

#include <random>

namespace rayloom::test
{
namespace
{

std::string chain(const std::string& noise, const std::string& coring = "")
{
    return "  bands: {op: multiscale.steerable, image: image, levels: 3}\n"
           "  high: {op: fit.noise, band: 'bands[0]'" +
           noise +
           "}\n"
           "  noise: {op: fit.noise, band: bands, high: high.figures" +
           noise +
           "}\n"
           "  fit: {op: fit.laplacian, band: bands, noise: noise.figures}\n"
           "  cored: {op: threshold.coring, band: bands, fit: fit.figures" +
           coring +
           "}\n"
           "  joined: {op: multiscale.steerable_inverse, bands: cored.band}\n";
}

/// The whole way from radiance to radiance.
std::string whole(const std::string& noise)
{
    std::string nodes = chain(noise);
    nodes.replace(nodes.find("image: image"), 12, "image: log.log");
    return "  log: {op: transform.log, image: image}\n" + nodes +
           "  linear: {op: transform.exp, image: joined, figures: log.figures}\n"
           "  clean: {op: transform.restore_mean, image: linear, reference: image}\n";
}

TEST(Coring, ReadsThePosteriorMean)
{
    std::mt19937 random(4);
    std::normal_distribution<float> noise(0.0f, 0.2f);
    const auto image = image_of({0, 0, 80, 70}, {"R"}, [&](int, int x, int y) {
        return static_cast<float>((x / 9 + y / 11) % 3) + noise(random);
    });
    RunReport report;
    const MemoryImage cored =
        run_text(graph_of(chain(", noise: given, s: 0.1, p: 1.5"), "'cored.band[3]'",
                          "  band: 'bands[3]'\n  fit: 'fit.figures[3]'\n  curve: "
                          "'cored.curve[3]'\n"),
                 {{"image", image}}, {}, {}, &report);
    const Table fit = report.tables.at("fit").front();
    const GeneralisedLaplacian signal{fit.number("s_c"), fit.number("p_c")},
        given{fit.number("s_n"), fit.number("p_n")};
    EXPECT_EQ(given.s, 0.1);
    const MemoryImage& band = report.images.at("band").front();
    for (int x = 0; x < 80; ++x) {
        const float y = band.pixels.view().at(0, x, 33);
        EXPECT_NEAR(cored.pixels.view().at(0, x, 33), posterior_mean(y, signal, given), 1e-5);
    }
    const Table curve = report.tables.at("curve").front();
    EXPECT_EQ(curve.number("y", curve.rows.size() - 1), fit.number("greatest"));
}

TEST(Coring, EachChannelIsReadFromItsOwnFit)
{
    // Little signal in much noise beside much signal in little noise.
    std::mt19937 random(8);
    std::normal_distribution<float> noise(0.0f, 1.0f);
    const auto image = image_of({0, 0, 80, 70}, {"R", "G"}, [&](int c, int x, int y) {
        const auto steps = static_cast<float>((x / 9 + y / 11) % 3);
        return c == 0 ? 0.1f * steps + noise(random) : 3.0f * steps + 0.1f * noise(random);
    });
    RunReport report;
    const MemoryImage cored = run_text(
        graph_of(chain(""), "'cored.band[3]'", "  band: 'bands[3]'\n  fit: 'fit.figures[3]'\n"),
        {{"image", image}}, {}, {}, &report);
    const Table fit = report.tables.at("fit").front();
    const MemoryImage& band = report.images.at("band").front();
    for (int c = 0; c < 2; ++c) {
        const auto row = static_cast<std::size_t>(c);
        const GeneralisedLaplacian signal{fit.number("s_c", row), fit.number("p_c", row)},
            own{fit.number("s_n", row), fit.number("p_n", row)};
        for (int x = 0; x < 80; ++x) {
            const float y = band.pixels.view().at(c, x, 33);
            EXPECT_NEAR(cored.pixels.view().at(c, x, 33), posterior_mean(y, signal, own),
                        2e-4 * own.s)
                << c;
        }
    }
    EXPECT_GT(fit.number("s_n", 0), 1.5 * fit.number("s_n", 1));
}

TEST(Coring, WithoutNoiseTheInputComesBack)
{
    const auto image = image_of({0, 0, 53, 47}, {"R", "G"}, [](int c, int x, int y) {
        return static_cast<float>((x * 7 + y * 5 + c) % 13);
    });
    const MemoryImage out =
        run_text(graph_of(chain(", noise: given, s: 0"), "joined"), {{"image", image}});
    for (int y = 0; y < 47; ++y)
        for (int x = 0; x < 53; ++x)
            ASSERT_NEAR(out.pixels.view().at(0, x, y), image->pixels.view().at(0, x, y), 2e-5);
}

TEST(Coring, FirstLeavesTheOtherChannelsAlone)
{
    std::mt19937 random(6);
    std::normal_distribution<float> noise(0.0f, 0.3f);
    const auto image =
        image_of({0, 0, 50, 40}, {"L", "C1", "C2"}, [&](int, int, int) { return noise(random); });
    RunReport report;
    const MemoryImage cored = run_text(
        graph_of(chain("", ", channels: first"), "'cored.band[1]'", "  band: 'bands[1]'\n"),
        {{"image", image}}, {}, {}, &report);
    const MemoryImage& band = report.images.at("band").front();
    bool changed = false;
    for (int y = 0; y < 40; ++y)
        for (int x = 0; x < 50; ++x) {
            changed |= cored.pixels.view().at(0, x, y) != band.pixels.view().at(0, x, y);
            for (int c : {1, 2})
                ASSERT_EQ(cored.pixels.view().at(c, x, y), band.pixels.view().at(c, x, y));
        }
    EXPECT_TRUE(changed);
}

TEST(Coring, TakesMultiplicativeNoiseOffAndKeepsTheMean)
{
    std::mt19937 random(7);
    std::gamma_distribution<float> factor(4.0f, 0.25f);
    const auto truth = [](int x, int y) {
        return (x < 90 ? 1.0f : 6.0f) * (1.2f + std::sin(0.04f * static_cast<float>(x + y)));
    };
    const auto image = image_of({0, 0, 180, 150}, {"R"},
                                [&](int, int x, int y) { return truth(x, y) * factor(random); });
    const MemoryImage out = run_text(graph_of(whole(""), "clean"), {{"image", image}});
    double before = 0.0, after = 0.0;
    for (int y = 0; y < 150; ++y)
        for (int x = 0; x < 180; ++x) {
            before += std::pow(image->pixels.view().at(0, x, y) - truth(x, y), 2.0);
            after += std::pow(out.pixels.view().at(0, x, y) - truth(x, y), 2.0);
        }
    EXPECT_GT(std::sqrt(before / after), 4.0);
    EXPECT_NEAR(mean_of(out, 0) / mean_of(*image, 0), 1.0, 1e-5);
}

TEST(Coring, OddImagesStayFinite)
{
    for (const Region& window : {Region{0, 0, 1, 37}, Region{0, 0, 41, 1}, Region{0, 0, 1, 1},
                                 Region{-3, -3, 98, 86}, Region{0, 0, 2, 3}})
        for (int kind = 0; kind < 5; ++kind) {
            std::mt19937 random(8);
            std::exponential_distribution<float> light(1.0f);
            const auto image = image_of(window, {"R", "G", "B"}, [&](int, int x, int y) {
                const float v = light(random);
                switch (kind) {
                case 0: return 0.0f;
                case 1: return 0.7f;
                case 2: return (x + y) % 3 == 0 ? 0.0f : v;
                case 3: return x == window.x0 && y == window.y0 ? 1e6f : v;
                default: return x == window.x0 ? 1e6f : 0.0f;
                }
            });
            for (const char* noise : {"", ", noise: given, s: 0.6, p: 1.5"}) {
                const MemoryImage out =
                    run_text(graph_of(whole(noise), "clean"), {{"image", image}});
                EXPECT_TRUE(all_finite(out)) << window.text() << ", kind " << kind;
                if (mean_of(*image, 1) > 0.0) {
                    EXPECT_NEAR(mean_of(out, 1) / mean_of(*image, 1), 1.0, 0.005)
                        << window.text() << ", kind " << kind;
                }
            }
        }
}

TEST(Coring, ABrightLeftEdgeLeavesTheRightEdgeUntouched)
{
    // Given noise and no fit in between: what reaches the right edge is the filters' support.
    const auto make = [](float edge) {
        return image_of({0, 0, 96, 40}, {"R"}, [edge](int, int x, int y) {
            return x == 0 ? edge : 0.5f + 0.1f * static_cast<float>((x * 3 + y * 5) % 7);
        });
    };
    const std::string nodes = "  bands: {op: multiscale.steerable, image: image, levels: 3}\n"
                              "  joined: {op: multiscale.steerable_inverse, bands: bands}\n";
    const MemoryImage dim = run_text(graph_of(nodes, "joined"), {{"image", make(0.5f)}}),
                      bright = run_text(graph_of(nodes, "joined"), {{"image", make(1e6f)}});
    for (int y = 0; y < 40; ++y)
        for (int x = 40; x < 96; ++x)
            ASSERT_EQ(dim.pixels.view().at(0, x, y), bright.pixels.view().at(0, x, y));
}

} // namespace
} // namespace rayloom::test
