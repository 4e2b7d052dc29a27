// SPDX-License-Identifier: Apache-2.0
// graphs/bayesian-wavelet.yaml and graphs/bayesian-wavelet-stack.yaml, on files as Cycles writes
// them and on images that are hard to take.
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/support/command.h"
#include "tests/support/folders.h"
#include "tests/support/log_graphs.h"
#include "tests/support/render_data.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <random>

namespace rayloom::test
{
namespace
{

const std::filesystem::path source = test::source_folder();

Graph graph(const std::string& name)
{
    return read_graph((source / "graphs" / (name + ".yaml")).string());
}

double rmse(ConstImageView image, ConstImageView reference)
{
    double sum = 0.0;
    for (int c = 0; c < 3; ++c)
        for (int y = image.region().y0; y < image.region().y1; ++y)
            for (int x = image.region().x0; x < image.region().x1; ++x)
                sum += std::pow(image.at(c, x, y) - reference.at(c, x, y), 2.0);
    return std::sqrt(sum / static_cast<double>(3 * image.region().pixels()));
}

TEST(BayesianWavelet, RendersOfCyclesKeepTheirAlphaAndLoseNoise)
{
    for (const char* scene : {"cornell", "interior", "dof"}) {
        const auto folder = source / "tests/data/cycles" / scene;
        RunRequest request;
        for (const char* input : {"beauty", "diffuse_indirect", "diffuse_color"})
            request.inputs[input].files = {{(folder / "noisy_16.exr").string(), ""}};
        const RunReport report = run_graph(graph("bayesian-wavelet"), request, {});
        const MemoryImage& result = report.images.at("image")[0];
        const TestImage noisy = read_render(folder / "noisy_16.exr", "ViewLayer.Combined"),
                        reference = read_render(folder / "ref.exr", "ViewLayer.Combined");
        ASSERT_EQ(result.desc.channels, (std::vector<std::string>{"R", "G", "B", "A"})) << scene;
        const Region& r = result.desc.data;
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x)
                ASSERT_EQ(result.pixels.view().at(3, x, y), noisy.view().at(3, x, y)) << scene;
        EXPECT_LT(rmse(result.pixels.view(), reference.view()),
                  rmse(noisy.view(), reference.view()))
            << scene;
        for (int c = 0; c < 3; ++c) {
            double before = 0.0;
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1; ++x) before += noisy.view().at(c, x, y);
            EXPECT_NEAR(mean_of(result, c) * static_cast<double>(r.pixels()) / before, 1.0, 1e-4)
                << scene;
        }
    }
}

TEST(BayesianWavelet, PassedThroughLayersStayBitForBit)
{
    const TemporaryFolder folder;
    const auto file = source / "tests/data/cycles/interior/noisy_16.exr";
    const auto written = folder.path() / "out.exr";
    RunRequest request;
    for (const char* input : {"beauty", "diffuse_indirect", "diffuse_color"})
        request.inputs[input].files = {{file.string(), ""}};
    request.outputs["image"].path = written.string();
    request.outputs["image"].pass_through_from = file.string();
    run_graph(graph("bayesian-wavelet"), request, {});
    for (const char* pass : {"Combined", "DiffInd", "DiffCol", "DiffDir", "GlossInd",
                             "Denoising Normal", "Denoising Depth"}) {
        const std::string layer = std::string("ViewLayer.") + pass;
        const TestImage before = read_render(file, layer), after = read_render(written, layer);
        ASSERT_EQ(after.desc.channels, before.desc.channels);
        const Region& r = before.desc.data;
        for (int c = 0; c < before.desc.channel_count(); ++c) {
            std::size_t changed = 0;
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1; ++x)
                    changed += before.view().at(c, x, y) != after.view().at(c, x, y);
            if (layer == "ViewLayer.Combined" && c < 3) {
                EXPECT_GT(changed, static_cast<std::size_t>(r.pixels()) / 2) << layer;
            } else {
                EXPECT_EQ(changed, 0u) << layer;
            }
        }
    }
}

TEST(BayesianWavelet, LayersOfAWholeRenderStillAddUp)
{
    const auto file = source / "tests/data/cycles/interior/noisy_16.exr";
    RunRequest request;
    request.inputs["render"].files = {{file.string(), ""}};
    const RunReport report = run_graph(graph("bayesian-wavelet-render"), request, {});
    const MemoryImage& render = report.images.at("render")[0];
    const auto after = [&](const std::string& layer, int c, int x, int y) {
        const int channel = render.desc.channel("ViewLayer." + layer + "." + "RGB"[c]);
        return static_cast<double>(render.pixels.view().at(channel, x, y));
    };
    const TestImage beauty = read_render(file, "ViewLayer.Combined"),
                    light = read_render(file, "ViewLayer.DiffInd"),
                    direct = read_render(file, "ViewLayer.DiffDir");
    const Region& r = beauty.desc.data;
    std::size_t changed = 0;
    for (int c = 0; c < 3; ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x) {
                const double was = light.view().at(c, x, y), is = after("DiffInd", c, x, y);
                changed += was != is;
                EXPECT_EQ(after("DiffDir", c, x, y), direct.view().at(c, x, y));
                // The beauty changes by what its indirect light does.
                EXPECT_NEAR(after("Combined", c, x, y) - beauty.view().at(c, x, y),
                            (is - was) * after("DiffCol", c, x, y), 1e-5 * (1.0 + was + is));
            }
    EXPECT_GT(changed, r.pixels());
}

/// Light and colour of a small scene with noise that grows with the light.
RunRequest stack(const Region& window, int count,
                 const std::function<float(int x, int y, float noise)>& light)
{
    RunRequest request;
    for (int i = 0; i < count; ++i) {
        std::mt19937 random(static_cast<unsigned>(i) + 1);
        std::gamma_distribution<float> factor(2.0f, 0.5f);
        const auto indirect = image_of(window, {"R", "G", "B"}, [&](int, int x, int y) {
            return light(x, y, factor(random));
        });
        const auto colour = image_of(window, {"R", "G", "B"}, [](int c, int x, int y) {
            return 0.2f + 0.1f * static_cast<float>((x / 3 + y / 5 + c) % 5);
        });
        const auto beauty = image_of(window, {"R", "G", "B", "A"}, [&](int c, int x, int y) {
            return c == 3 ? 0.5f
                          : 0.25f + indirect->pixels.view().at(c, x, y) *
                                        colour->pixels.view().at(c, x, y);
        });
        request.inputs["beauty"].images.push_back(beauty);
        request.inputs["diffuse_indirect"].images.push_back(indirect);
        request.inputs["diffuse_color"].images.push_back(colour);
    }
    return request;
}

TEST(BayesianWavelet, AnImageWithoutNoiseStays)
{
    // Smooth light with shadows and lines of a pixel; as one render and as three alike.
    const Region window{0, 0, 160, 120};
    const auto light = [](int x, int y, float) {
        const float shade = 1.0f + 0.5f * std::sin(0.05f * static_cast<float>(x + 2 * y));
        return (x + y / 3) % 50 < 20 ? 0.2f * shade : x == 130 ? 5.0f : shade;
    };
    for (const int count : {1, 3}) {
        const RunRequest request = stack(window, count, light);
        const RunReport report = run_graph(graph("bayesian-wavelet-stack"), request, {});
        const MemoryImage& indirect = report.images.at("indirect")[0];
        for (int y = 0; y < 120; ++y)
            for (int x = 0; x < 160; ++x)
                EXPECT_NEAR(indirect.pixels.view().at(0, x, y), light(x, y, 1.0f), 0.01)
                    << count << ' ' << x << ' ' << y;
    }
}

TEST(BayesianWavelet, NoiseOfOneHalfDoesNotBlurTheOther)
{
    // Strong noise on the left, a fifth of it and a chequerboard on the right.
    const Region window{0, 0, 240, 120};
    const auto truth = [](int x, int y) { return x < 120 || (x / 20 + y / 20) % 2 ? 1.0f : 1.5f; };
    for (const int count : {1, 4}) {
        const RunRequest request = stack(window, count, [&](int x, int y, float noise) {
            return truth(x, y) * (x < 120 ? noise : 0.8f + 0.2f * noise);
        });
        const RunReport report = run_graph(graph("bayesian-wavelet-stack"), request, {});
        const ConstImageView light = report.images.at("indirect")[0].pixels.view();
        double left = 0.0, right = 0.0;
        for (int y = 10; y < 110; ++y)
            for (int x = 10; x < 80; ++x) {
                left += std::pow(light.at(1, x, y) - truth(x, y), 2.0) / 7000.0;
                right += std::pow(light.at(1, 239 - x, y) - truth(239 - x, y), 2.0) / 7000.0;
            }
        // One strength for both sides would leave the chequerboard off by more than its noise.
        const double noise = std::sqrt(0.5 / count);
        EXPECT_LT(std::sqrt(left), 0.25 * noise) << count;
        EXPECT_LT(std::sqrt(right), 0.2 * noise) << count;
    }
}

TEST(BayesianWavelet, StacksOfAnySizeAreTaken)
{
    const Region window{-2, 3, 91, 86};
    const auto light = [](int x, int, float noise) { return (x < 40 ? 0.5f : 2.0f) * noise; };
    for (const int count : {1, 2, 5})
        for (const char* noise : {"auto", "given"}) {
            RunRequest request = stack(window, count, light);
            request.params["noise"] = std::string(noise);
            const RunReport report = run_graph(graph("bayesian-wavelet-stack"), request, {});
            const MemoryImage& result = report.images.at("image")[0];
            const MemoryImage& indirect = report.images.at("indirect")[0];
            ASSERT_EQ(result.desc.channel_count(), 4);
            EXPECT_EQ(result.pixels.view().at(3, 7, 9), 0.5f);
            EXPECT_TRUE(all_finite(result));
            // Inside the two halves nothing is left but light.
            double sum = 0.0, square = 0.0;
            int n = 0;
            for (int y = 10; y < 80; ++y)
                for (int x = 50; x < 80; ++x, ++n) {
                    const double v = indirect.pixels.view().at(1, x, y);
                    sum += v;
                    square += v * v;
                }
            const double mean = sum / n, deviation = std::sqrt(square / n - mean * mean);
            EXPECT_NEAR(mean, 2.0, 0.15) << count << ' ' << noise;
            EXPECT_LT(deviation, 0.35 * 2.0 / std::sqrt(2.0 * count)) << count << ' ' << noise;
        }
}

TEST(BayesianWavelet, HardImagesGiveFinitePixelsAndSaneFigures)
{
    struct Case {
        const char* name;
        Region window;
        std::function<float(int x, int y, float noise)> light;
    };
    const Region prime{0, 0, 97, 61};
    const std::vector<Case> cases{
        {"black", prime, [](int, int, float) { return 0.0f; }},
        {"constant", prime, [](int, int, float) { return 0.7f; }},
        {"half black", prime, [](int x, int, float v) { return x < 48 ? 0.0f : v; }},
        {"zeros among light", prime, [](int x, int y, float v) { return (x + y) % 3 ? v : 0.0f; }},
        {"one bright pixel", prime,
         [](int x, int y, float v) { return x == 30 && y == 20 ? 1e6f : v; }},
        {"bright edge", prime, [](int x, int, float v) { return x == 0 ? 1e6f : 0.01f * v; }},
        {"one pixel wide", {0, 0, 1, 53}, [](int, int, float v) { return v; }},
        {"one pixel high", {4, 7, 59, 8}, [](int, int, float v) { return v; }},
        {"one pixel", {0, 0, 1, 1}, [](int, int, float v) { return v; }}};
    for (const Case& c : cases)
        for (const int count : {1, 3}) {
            const RunReport report =
                run_graph(graph("bayesian-wavelet-stack"), stack(c.window, count, c.light), {});
            EXPECT_TRUE(all_finite(report.images.at("image")[0])) << c.name;
            EXPECT_TRUE(all_finite(report.images.at("indirect")[0])) << c.name;
            const std::vector<Table>& fit = report.tables.at("fit");
            ASSERT_EQ(fit.size(), 14u) << c.name;
            for (const Table& band : fit)
                for (std::size_t row = 0; row < band.rows.size(); ++row) {
                    for (const char* column : {"s_n", "s_c", "deviation", "kurtosis", "greatest"}) {
                        EXPECT_TRUE(std::isfinite(band.number(column, row))) << c.name;
                        EXPECT_GE(band.number(column, row), 0.0) << c.name;
                    }
                    for (const char* column : {"p_n", "p_c"}) {
                        EXPECT_GE(band.number(column, row), 0.3) << c.name;
                        EXPECT_LE(band.number(column, row), 4.0) << c.name;
                    }
                }
        }
}

TEST(BayesianWavelet, BlackGroundDoesNotChangeTheFigures)
{
    const auto fit = [](const Region& window) {
        const auto light = [](int x, int y, float v) {
            return x >= 0 && x < 80 && y >= 0 && y < 80 ? v : 0.0f;
        };
        return run_graph(graph("bayesian-wavelet-stack"), stack(window, 4, light), {})
            .tables.at("fit");
    };
    const std::vector<Table> tight = fit({0, 0, 80, 80}), wide = fit({0, 0, 80, 400});
    // Bands reach over the edge of the light; the finest least.
    for (const std::size_t band : {1u, 3u})
        EXPECT_NEAR(wide[band].number("s_n", 1), tight[band].number("s_n", 1),
                    0.1 * tight[band].number("s_n", 1));
}

} // namespace
} // namespace rayloom::test
