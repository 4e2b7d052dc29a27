// SPDX-License-Identifier: Apache-2.0
// How far each fast kernel is from its plain double counterpart, on input that is kind to it and on
// input that is not. Each entry has a bound that is held here; with RAYLOOM_NUMBERS=FILE the table
// of docs/numbers.md is written (`./dev numbers`).
#include "nodes/fuse/nlm_kernel.h"
#include "rayloom/image/border.h"
#include "rayloom/stats/moments.h"
#include "rayloom/stats/posterior_mean.h"
#include "tests/oracle/histogram_fusion.h"
#include "tests/oracle/nlm.h"
#include "tests/oracle/posterior_mean.h"
#include "tests/oracle/steerable.h"
#include "tests/stress/error_budget.h"
#include "tests/stress/soak.h"
#include "tests/support/plane_scene.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <random>

namespace rayloom::test
{
namespace
{

using namespace budget;
const std::vector<std::string> rgb{"R", "G", "B"};

// ------------------------------------------------------------------------------- statistics

void statistics(Table& table)
{
    for (const double ratio : {1.0, 1e2, 1e4, 1e6}) {
        constexpr int images = 16;
        const Region data{0, 0, 64, 48};
        std::mt19937 random(3);
        std::normal_distribution<double> noise(ratio, 1.0);
        std::vector<TestImage> stack;
        for (int i = 0; i < images; ++i)
            stack.push_back(make_image(
                data, rgb, [&](int, int, int) { return static_cast<float>(noise(random)); }));
        NodeInput input{"stack", {}, nullptr, true};
        for (const TestImage& image : stack) input.images.push_back(&image);
        const NodeRun run = run_node("transform.statistics", {}, {input});
        Error mean, variance;
        for (int c = 0; c < 3; ++c)
            for (int y = 0; y < data.y1; ++y)
                for (int x = 0; x < data.x1; ++x) {
                    long double m = 0, s = 0;
                    for (const TestImage& image : stack) m += image.view().at(c, x, y);
                    m /= images;
                    for (const TestImage& image : stack) {
                        const long double d = image.view().at(c, x, y) - m;
                        s += d * d;
                    }
                    mean.add(run.image("mean").view().at(c, x, y), static_cast<double>(m));
                    variance.add(run.image("variance").view().at(c, x, y),
                                 static_cast<double>(s / (images - 1)));
                }
        char text[80];
        std::snprintf(text, sizeof text, "mean/σ = %g, 16 samples", ratio);
        table.push_back({"transform.statistics, mean", text, itself, mean, 1e-7, ""});
        table.push_back({"transform.statistics, variance", text, itself, variance, 1e-7, ""});
    }
}

void moments(Table& table)
{
    const std::int64_t n = soaking() || std::getenv("RAYLOOM_NUMBERS") ? 10'000'000 : 200'000;
    for (const double ratio : {1.0, 1e3, 1e6}) {
        const auto sample = [&](auto& random) {
            return std::normal_distribution<double>(ratio, 1.0)(random);
        };
        Moments<> sum;
        Moments4 power;
        long double total = 0, squares = 0, fourth = 0;
        std::mt19937_64 first(5);
        for (std::int64_t i = 0; i < n; ++i) {
            const double x = sample(first);
            sum.add(x);
            power.add(x);
            total += x;
        }
        const long double mean = total / n;
        std::mt19937_64 again(5);
        for (std::int64_t i = 0; i < n; ++i) {
            const long double d = sample(again) - mean;
            squares += d * d;
            fourth += d * d * d * d;
        }
        Error variance, kurtosis;
        variance.add(sum.variance(), static_cast<double>(squares / (n - 1)));
        kurtosis.add(power.fourth(), static_cast<double>(fourth / n));
        char text[80];
        std::snprintf(text, sizeof text, "mean/σ = %g, %.0e samples", ratio,
                      static_cast<double>(n));
        table.push_back({"stats::Moments, variance", text, itself, variance, 1e-8, ""});
        table.push_back({"stats::Moments4, fourth moment", text, itself, kurtosis, 1e-8, ""});
    }
}

// ------------------------------------------------------------------------------- fusion

oracle::Raster<double> raster(const TestImage& image)
{
    const Region& r = image.desc.data;
    oracle::Raster<double> out(r.width(), r.height(), image.desc.channel_count());
    for (int c = 0; c < out.channels; ++c)
        for (int y = 0; y < out.height; ++y)
            for (int x = 0; x < out.width; ++x)
                out.at(c, x, y) = static_cast<double>(image.view().at(c, r.x0 + x, r.y0 + y));
    return out;
}

Error compare(const TestImage& image, const oracle::Raster<double>& truth, double scale = 0.0)
{
    Error error(scale);
    const Region& r = image.desc.data;
    for (int c = 0; c < truth.channels; ++c)
        for (int y = 0; y < truth.height; ++y)
            for (int x = 0; x < truth.width; ++x)
                error.add(static_cast<double>(image.view().at(c, r.x0 + x, r.y0 + y)),
                          truth.at(c, x, y));
    return error;
}

double largest_of(const oracle::Raster<double>& image)
{
    double most = 0.0;
    for (const double v : image.values) most = std::max(most, std::fabs(v));
    return most;
}

void histogram(Table& table)
{
    struct Kind {
        const char* name;
        double counts, light;
    };
    for (const Kind& kind :
         {Kind{"16 samples a pixel", 16.0, 1.0}, Kind{"1e6 samples a pixel", 1e6, 1.0},
          Kind{"light from 1e-8 to 1e8", 16.0, 0.0}}) {
        const Region data{0, 0, 33, 27};
        std::mt19937 random(7);
        std::uniform_real_distribution<double> unit(0.0, 1.0);
        const TestImage image = make_image(data, rgb, [&](int, int, int) {
            const double v = unit(random);
            return static_cast<float>(kind.light > 0.0 ? v : std::pow(10.0, 16.0 * v - 8.0));
        });
        std::vector<std::string> names;
        for (int i = 0; i <= 60; ++i) names.push_back("Bin_" + std::to_string(i));
        const TestImage bins = make_image(data, names, [&](int c, int x, int y) {
            const double centre = (x + 2 * y) % 23 < 12 ? 6.0 : 11.0, d = (c % 20 - centre) / 3.0;
            return static_cast<float>(c == 60 ? kind.counts
                                              : kind.counts / 7.5 * std::exp(-0.5 * d * d) *
                                                    (0.5 + unit(random)));
        });
        // Every patch is kept, so that no threshold hangs on the last bit.
        const NodeRun run =
            run_node("fuse.histogram",
                     {{"kappa", 1e9}, {"window", std::int64_t{9}}, {"patch", std::int64_t{3}}},
                     {{"image", {&image}}, {"histogram", {&bins}}});
        oracle::FusionSettings settings;
        settings.kappa = 1e9;
        settings.window_radius = 4;
        table.push_back(
            {"fuse.histogram, averages", kind.name, itself,
             compare(run.image(), fuse_histogram(raster(image), raster(bins), settings)), 2e-6,
             ""});
    }
}

void nlm(Table& table)
{
    {
        std::vector<float> x, result;
        for (double v = 0.0; v < 100.0; v += 0.00037) x.push_back(static_cast<float>(v));
        result.resize(x.size());
        nlm_power_of_two_negative(x, result);
        Error error;
        for (std::size_t i = 0; i < x.size(); ++i)
            error.add(static_cast<double>(result[i]), std::exp2(-static_cast<double>(x[i])));
        table.push_back({"fuse.nlm, 2^−x", "0 ≤ x < 100", itself, error, 3e-7, ""});
    }
    for (const double contrast : {1.0, 1e4, 1e8}) {
        const Region data{0, 0, 31, 26};
        std::mt19937 random(9);
        std::lognormal_distribution<double> noise(0.0, 0.5);
        std::normal_distribution<double> guide_noise(0.0, 0.05);
        const auto scene = [&](int x, int y) { return x / 7 % 2 == y / 9 % 2 ? 1.0 : contrast; };
        const TestImage image = make_image(data, rgb, [&](int, int x, int y) {
            return static_cast<float>(scene(x, y) * noise(random));
        });
        const TestImage guide = make_image(data, rgb, [&](int, int x, int y) {
            return static_cast<float>(0.4 * std::log10(scene(x, y)) + guide_noise(random));
        });
        const TestImage spread = make_image(data, {"Y"}, [](int, int, int) { return 0.01f; });
        const NodeRun run = run_node("fuse.nlm",
                                     {{"gate", std::string("none")},
                                      {"window", std::int64_t{9}},
                                      {"patch", std::int64_t{5}}},
                                     {{"image", {&image}, nullptr, true},
                                      {"guide", {&guide}, nullptr, true},
                                      {"guide_variance", {&spread}, nullptr, true}});
        oracle::NlmSettings settings;
        settings.gate = oracle::NlmGate::none;
        settings.window = 9;
        settings.sigma_s = 3.0;
        const oracle::NlmFrame frame{image.view(), guide.view(), spread.view(), {}, {}};
        const auto truth = oracle::filter_nlm<double>({&frame, 1}, 0, settings, data);
        Error error;
        for (int c = 0; c < 3; ++c)
            for (int y = 0; y < data.y1; ++y)
                for (int x = 0; x < data.x1; ++x)
                    error.add(static_cast<double>(run.image().view().at(c, x, y)),
                              truth.pixels[static_cast<std::size_t>(c) * data.pixels() +
                                           static_cast<std::size_t>(y * data.x1 + x)]);
        char text[80];
        std::snprintf(text, sizeof text, "regions of light 1 and %g", contrast);
        table.push_back({"fuse.nlm, no gate", text, itself, error, 5e-6, ""});
    }
}

// ------------------------------------------------------------------------------- planes

void planes(Table& table)
{
    const ParamValues fit{{"max_radius", std::int64_t{4}},
                          {"target_noise", 0.0},
                          {"range", 0.0},
                          {"range_scale", std::string("mean")}};
    const ParamValues fuse{{"max_radius", std::int64_t{4}}, {"blend", std::string("min")}};
    oracle::PlaneOptions options;
    options.max_radius = 4;
    options.target_noise = 0.0;
    options.range = 0.0;
    // One line of a surface, the rest of which counts ε: its matrix has a condition of about 1/ε.
    for (const double condition : {1.0, 1e2, 1e4, 1e6, 1e8}) {
        const float share = static_cast<float>(1.0 / condition);
        PlaneScene scene = noisy_scene({0, 0, 27, 21}, 3, 0.05f, 3);
        scene.normal.reset();
        scene.boundary.reset();
        scene.parts = make_image({0, 0, 27, 21}, {"id0", "coverage0", "id1", "coverage1"},
                                 [&](int c, int, int y) {
                                     if (c % 2 == 0) return 3.0f + static_cast<float>(c);
                                     const float first = y == 10 ? 1.0f : share;
                                     return c == 1 ? first : 1.0f - first;
                                 });
        const TestImage result = filter_planes(scene, fit, fuse);
        const oracle::PlaneInput in = scene.for_oracle();
        const auto truth = fuse_all(in, options, fit_all(in, options));
        char text[80];
        std::snprintf(text, sizeof text, "condition %g", condition);
        table.push_back(
            {"fit.plane and fuse.planes", text, itself, compare(result, truth), 5e-6, ""});
    }
    for (const double slope : {1e-2, 1e-5, 1e-8}) {
        const auto plane = [&](int c, int x, int y) {
            return static_cast<float>(1.0 + c + slope * (x - 0.5 * y));
        };
        const PlaneScene scene = even_scene({0, 0, 27, 21}, 3, plane, 1e-6f);
        const TestImage result = filter_planes(scene, fit, fuse);
        const oracle::PlaneInput in = scene.for_oracle();
        char text[80];
        std::snprintf(text, sizeof text, "slope/mean = %g", slope);
        table.push_back({"fit.plane and fuse.planes", text, itself,
                         compare(result, fuse_all(in, options, fit_all(in, options))), 5e-6, ""});
    }
}

// ------------------------------------------------------------------------------- bands and coring

void coring(Table& table)
{
    const std::vector<double> shapes =
        soaking() || std::getenv("RAYLOOM_NUMBERS")
            ? std::vector<double>{0.3, 0.5, 0.8, 1.0, 1.5, 2.0, 3.0, 4.0}
            : std::vector<double>{0.3, 1.0, 4.0};
    for (const double ratio : {1e-3, 1e-1, 1.0, 10.0, 1e3}) {
        Error error(1.0);
        for (const double signal_p : shapes)
            for (const double noise_p : shapes) {
                const GeneralisedLaplacian signal{ratio, signal_p}, noise{1.0, noise_p};
                const double greatest = 20.0;
                const PosteriorMeanTable fast(signal, noise, greatest);
                for (double y = 1e-4; y <= greatest; y *= 2.7)
                    error.add(static_cast<double>(fast(static_cast<float>(y))),
                              oracle::posterior_mean(static_cast<double>(static_cast<float>(y)),
                                                     ratio, signal_p, 1.0, noise_p));
            }
        char text[120];
        std::snprintf(text, sizeof text, "s of signal / s of noise = %g, p from 0.3 to 4 both",
                      ratio);
        table.push_back({"threshold.coring, table", text, "s of the noise", error, 5e-5,
                         "cubics between samples, as many as 1e-4 of the noise asks for"});
    }
}

void steerable(Table& table)
{
    for (const double offset : {0.0, 1e4}) {
        const Region window{0, 0, 25, 22};
        std::mt19937 random(5);
        std::normal_distribution<double> value(offset, 1.0);
        const TestImage image = make_image(
            window, {"Y"}, [&](int, int, int) { return static_cast<float>(value(random)); });
        const NodeRun run =
            run_node("multiscale.steerable", {{"levels", std::int64_t{2}}}, {{"image", {&image}}});
        const oracle::PixelFunction pixel = [&](int x, int y) {
            return static_cast<double>(
                image.view().at(0, border_index(x, window.x0, window.x1, Border::mirror),
                                border_index(y, window.y0, window.y1, Border::mirror)));
        };
        Error high(offset + 4.0), oriented(offset + 4.0);
        const auto look = [&](Error& error, std::size_t band, const auto& truth) {
            const TestImage& out = run.image("bands", band);
            const Region& r = out.desc.data;
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1; ++x)
                    error.add(static_cast<double>(out.view().at(0, x, y)), truth(x, y));
        };
        look(high, 0, [&](int x, int y) { return oracle::steerable_high(pixel, x, y); });
        look(oriented, 1,
             [&](int x, int y) { return oracle::steerable_oriented(pixel, 1, 0, x, y); });
        const std::string text = offset > 0.0 ? "noise of σ = 1 on 1e4" : "noise";
        table.push_back({"multiscale.steerable, high-pass", text, largest, high, 2e-6, ""});
        table.push_back({"multiscale.steerable, oriented", text, largest, oriented, 2e-6, ""});
    }
}

void pyramid(Table& table)
{
    for (const double span : {1.0, 1e8}) {
        const Region data{0, 0, 41, 35};
        std::mt19937 random(11);
        std::uniform_real_distribution<double> unit(0.0, 1.0);
        const TestImage image = make_image(data, rgb, [&](int, int, int) {
            return static_cast<float>(std::pow(span, unit(random)) * (0.1 + unit(random)));
        });
        const NodeRun run =
            run_node("multiscale.pyramid", {{"scales", std::int64_t{3}}}, {{"image", {&image}}});
        const auto truth = oracle::downsample(raster(image), 2);
        const char* text = span > 1.0 ? "light over eight decades" : "noise";
        table.push_back(
            {"multiscale.pyramid", text, itself, compare(run.image("levels", 2), truth), 5e-6, ""});
        std::vector<const TestImage*> levels;
        std::vector<oracle::Raster<double>> rasters;
        for (std::size_t i = 0; i < 3; ++i) {
            levels.push_back(&run.image("levels", i));
            rasters.push_back(raster(*levels.back()));
        }
        for (const char* limit : {"none", "share"}) {
            const NodeRun joined = run_node("multiscale.recombine", {{"limit", std::string(limit)}},
                                            {{"levels", levels, nullptr, true}});
            const auto expected = oracle::recombine(rasters, std::string(limit) == "none"
                                                                 ? oracle::RecombineLimit::none
                                                                 : oracle::RecombineLimit::share);
            table.push_back({std::string("multiscale.recombine, limit ") + limit, text, largest,
                             compare(joined.image(), expected, largest_of(expected)), 5e-6, ""});
        }
    }
}

/// A cell of a Markdown table: |y| is no two borders.
std::string cell(const std::string& text)
{
    std::string out;
    for (const char c : text) out += c == '|' ? std::string("\\|") : std::string(1, c);
    return out;
}

TEST(ErrorBudget, EachKernelIsWithinItsBound)
{
    Table table;
    statistics(table);
    moments(table);
    histogram(table);
    nlm(table);
    planes(table);
    coring(table);
    steerable(table);
    pyramid(table);
    add_node_entries(table);
    for (const Entry& e : table)
        EXPECT_LE(e.error.relative(), e.bound) << e.kernel << ", " << e.input;
    const char* file = std::getenv("RAYLOOM_NUMBERS");
    if (!file) return;
    std::ofstream out(file);
    out << "| kernel | input | relative error | against | ULP | held below |\n"
           "|---|---|---|---|---|---|\n";
    for (const Entry& e : table) {
        char line[400];
        std::snprintf(line, sizeof line, "| %s | %s | %.1e | %s | %.3g | %.0e |\n",
                      cell(e.kernel).c_str(), cell(e.input).c_str(), e.error.relative(),
                      cell(e.against).c_str(), e.error.ulp(), e.bound);
        out << line;
    }
    std::string said;
    for (const Entry& e : table)
        if (e.error.relative() > 1e-5 && said.find(e.kernel + "\n") == std::string::npos) {
            out << (said.empty() ? "\nWhy, for the entries above 1e-5:\n\n- " : "- ") << e.kernel
                << ": " << e.reason << "\n";
            said += e.kernel + "\n";
        }
    if (said.empty()) out << "\nNo entry is above 1e-5.\n";
}

} // namespace
} // namespace rayloom::test
