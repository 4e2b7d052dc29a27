// SPDX-License-Identifier: Apache-2.0
// Error of what is summed over many samples, with a mean far above the spread, whole and merged
// from parts. The truth is taken in long double, in two passes over the same floats.
#include "nodes/fit/band_figures.h"
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "rayloom/stats/moments.h"
#include "tests/stress/error_budget.h"
#include "tests/support/run_node.h"

#include <array>
#include <span>

namespace rayloom::test::budget
{
namespace
{

/// Samples of σ = 1 on a mean of `ratio`.
std::vector<float> samples_of(double ratio, std::size_t n)
{
    std::mt19937_64 random(5);
    std::vector<float> samples(n);
    for (float& v : samples) v = static_cast<float>(ratio + steady_noise(random));
    return samples;
}

struct Truth {
    long double mean = 0, squares = 0; ///< mean, and Σ (x − mean)²
};

/// Of every step-th value.
Truth truth_of(std::span<const float> samples, std::size_t step = 1)
{
    Truth truth;
    long double n = 0;
    for (std::size_t i = 0; i < samples.size(); i += step, n += 1) truth.mean += samples[i];
    truth.mean /= n;
    for (std::size_t i = 0; i < samples.size(); i += step) {
        const long double d = samples[i] - truth.mean;
        truth.squares += d * d;
    }
    return truth;
}

std::string text_of(double ratio, std::size_t n, const char* unit = "samples")
{
    char text[100];
    std::snprintf(text, sizeof text, "mean/σ = %g, %g %s", ratio, static_cast<double>(n), unit);
    return text;
}

/// Sums as reductions make them: a row at a time, then pairs of what has been summed, in a tree.
template <class Sum, class Row, class Merge>
Sum in_tree(std::span<const float> samples, std::size_t width, const Row& row, const Merge& merge)
{
    std::vector<Sum> sums;
    for (std::size_t i = 0; i < samples.size(); i += width)
        sums.push_back(row(samples.subspan(i, std::min(width, samples.size() - i))));
    while (sums.size() > 1) {
        std::vector<Sum> half;
        for (std::size_t i = 0; i + 1 < sums.size(); i += 2) {
            half.push_back(sums[i]);
            merge(half.back(), sums[i + 1]);
        }
        if (sums.size() % 2 == 1) half.push_back(sums.back());
        sums = std::move(half);
    }
    return sums.front();
}

void moments(Table& table, double ratio, const std::vector<float>& samples, const Truth& truth)
{
    const auto expected =
        static_cast<double>(truth.squares / static_cast<long double>(samples.size() - 1));
    const auto add = [](std::span<const float> row) {
        Moments<> m;
        for (const float v : row) m.add(static_cast<double>(v));
        return m;
    };
    Error whole, merged;
    whole.add(add(samples).variance(), expected);
    merged.add(
        in_tree<Moments<>>(samples, 1000, add,
                           [](Moments<>& into, const Moments<>& other) { into.merge(other); })
            .variance(),
        expected);
    const std::string text = text_of(ratio, samples.size());
    table.push_back({"stats::Moments, variance", text, itself, whole});
    table.push_back({"stats::Moments, variance, rows merged", text, itself, merged});
}

/// The node in the engine: rows in parallel, merged in the engine's tree.
void channels(Table& table, double ratio, const std::vector<float>& samples, const Truth& truth)
{
    constexpr int width = 1000;
    auto image = std::make_shared<MemoryImage>();
    image->desc.data = {0, 0, width, static_cast<int>(samples.size()) / width};
    image->desc.display = image->desc.data;
    image->desc.channels = {"Y"};
    image->pixels = ImageBuffer(image->desc.data, 1);
    for (int y = 0; y < image->desc.data.y1; ++y)
        std::copy_n(samples.data() + y * width, width, image->pixels.view().row(0, y));
    RunRequest request;
    request.inputs["image"].images = {image};
    const Graph graph = parse_graph("rayloom: 1\nname: sums\ninputs: {image: {doc: any}}\nnodes: "
                                    "{f: {op: measure.channels, image: image}}\noutputs: {f: f}\n",
                                    "sums");
    const rayloom::Table figures = run_graph(graph, request).tables.at("f").front();
    Error mean, deviation;
    mean.add(figures.number("mean"), static_cast<double>(truth.mean));
    deviation.add(
        figures.number("deviation"),
        std::sqrt(static_cast<double>(truth.squares / static_cast<long double>(samples.size()))));
    const std::string text = text_of(ratio, samples.size(), "pixels");
    table.push_back({"measure.channels, mean", text, itself, mean});
    table.push_back({"measure.channels, deviation", text, itself, deviation});
}

/// A list of `images` images, which hold the samples image by image.
void statistics_of_list(Table& table, double ratio, std::span<const float> samples,
                        std::size_t images)
{
    const std::size_t pixels = std::min<std::size_t>(1000, samples.size() / images);
    const Region data{0, 0, static_cast<int>(pixels), 1};
    std::vector<TestImage> stack;
    for (std::size_t i = 0; i < images; ++i)
        stack.push_back(make_image(data, {"Y"}, [&](int, int x, int) {
            return samples[i * pixels + static_cast<std::size_t>(x)];
        }));
    NodeInput input{"stack", {}, nullptr, true};
    for (const TestImage& image : stack) input.images.push_back(&image);
    const NodeRun run = run_node("transform.statistics", {}, {input});
    Error mean, variance;
    for (std::size_t x = 0; x < pixels; ++x) {
        const Truth truth = truth_of(samples.subspan(x, images * pixels - x), pixels);
        const int at = static_cast<int>(x);
        mean.add(static_cast<double>(run.image("mean").view().at(0, at, 0)),
                 static_cast<double>(truth.mean));
        variance.add(static_cast<double>(run.image("variance").view().at(0, at, 0)),
                     static_cast<double>(truth.squares / static_cast<long double>(images - 1)));
    }
    const std::string text = text_of(ratio, images, "images");
    table.push_back({"transform.statistics, mean", text, itself, mean});
    table.push_back({"transform.statistics, variance", text, itself, variance});
}

/// One deep pixel that holds all samples.
void statistics_of_deep(Table& table, double ratio, const std::vector<float>& samples,
                        const Truth& truth)
{
    TestDeep deep;
    deep.desc.data = deep.desc.display = {0, 0, 1, 1};
    deep.desc.channels = {"Y"};
    auto row = std::make_shared<DeepRow>();
    row->first = {0, static_cast<std::uint32_t>(samples.size())};
    row->samples = {samples};
    deep.rows = {row};
    const NodeRun run = run_node("transform.statistics", {}, {{"deep", {}, &deep, false}});
    Error mean, variance;
    mean.add(static_cast<double>(run.image("mean").view().at(0, 0, 0)),
             static_cast<double>(truth.mean));
    variance.add(static_cast<double>(run.image("variance").view().at(0, 0, 0)),
                 static_cast<double>(truth.squares / static_cast<long double>(samples.size() - 1)));
    const std::string text = text_of(ratio, samples.size(), "deep samples");
    table.push_back({"transform.statistics, mean", text, itself, mean});
    table.push_back({"transform.statistics, variance", text, itself, variance});
}

/// The sums of fit.laplacian, fit.noise and measure.band_fit: powers about zero, which is the mean
/// of a band.
void bands(Table& table, double ratio, const std::vector<float>& samples)
{
    const long double n = static_cast<long double>(samples.size());
    long double second = 0, fourth = 0, excess = 0;
    for (const float v : samples) {
        const long double square = static_cast<long double>(v) * v;
        second += square;
        fourth += square * square;
    }
    second /= n;
    // kurtosis − 1 = Σ (x² − mean of x²)² / n / second², without the difference.
    for (const float v : samples) {
        const long double d = static_cast<long double>(v) * v - second;
        excess += d * d;
    }
    using Sums = std::array<double, BandMoments::size>;
    const Sums sums = in_tree<Sums>(
        samples, 1000,
        [](std::span<const float> row) {
            Sums s{};
            BandMoments::add(row, s);
            return s;
        },
        [](Sums& into, const Sums& other) { BandMoments::combine(into, other); });
    const BandMoments found(sums);
    Error two, four, sampling;
    two.add(found.second, static_cast<double>(second));
    four.add(found.fourth, static_cast<double>(fourth / n));
    sampling.add(found.sampling_error(), static_cast<double>(std::sqrt(excess / n / n) / second));
    const std::string text = text_of(ratio, samples.size(), "values");
    table.push_back({"fit.laplacian and fit.noise, Σv², rows merged", text, itself, two});
    table.push_back({"fit.laplacian and fit.noise, Σv⁴, rows merged", text, itself, four});
    table.push_back({"fit.laplacian, sampling error", text, itself, sampling});
}

/// The light a flash lacks is the difference of two sums over the image.
void flash(Table& table)
{
    for (const double share : {0.5, 1e-3, 1e-6}) {
        const Region data{0, 0, 500, 400};
        std::mt19937 random(8);
        std::uniform_real_distribution<double> unit(0.1, 1.0);
        const auto light = [&](int, int, int) { return static_cast<float>(unit(random)); };
        const TestImage partial = make_image(data, {"Y"}, light),
                        flash_unit = make_image(data, {"Y"}, light);
        const TestImage image = make_image(data, {"Y"}, [&](int, int x, int y) {
            const double flash = static_cast<double>(flash_unit.view().at(0, x, y));
            return static_cast<float>(static_cast<double>(partial.view().at(0, x, y)) +
                                      share * flash);
        });
        long double missing = 0, all = 0;
        for (int y = 0; y < data.y1; ++y)
            for (int x = 0; x < data.x1; ++x) {
                missing += static_cast<long double>(image.view().at(0, x, y)) -
                           static_cast<long double>(partial.view().at(0, x, y));
                all += static_cast<long double>(flash_unit.view().at(0, x, y));
            }
        const NodeRun run =
            run_node("fit.flash_intensity", {},
                     {{"image", {&image}}, {"partial", {&partial}}, {"flash_unit", {&flash_unit}}});
        Error error;
        error.add(run.tables.begin()->second.number("intensity"),
                  static_cast<double>(missing / all));
        char text[80];
        std::snprintf(text, sizeof text, "a flash of %g of the light, 2e+05 pixels", share);
        table.push_back({"fit.flash_intensity", text, itself, error});
    }
}

} // namespace

void add_sum_entries(Table& table)
{
    const std::size_t n = long_version() ? 10'000'000 : 200'000;
    for (const double ratio : {1.0, 1e2, 1e4, 1e6}) {
        const std::vector<float> samples = samples_of(ratio, n);
        const Truth truth = truth_of(samples);
        statistics_of_list(table, ratio, samples, 16);
        statistics_of_list(table, ratio, samples, long_version() ? 10'000 : 1'000);
        statistics_of_deep(table, ratio, samples, truth);
        channels(table, ratio, samples, truth);
        moments(table, ratio, samples, truth);
    }
    for (const double ratio : {0.0, 1.0, 1e3, 1e6}) bands(table, ratio, samples_of(ratio, n));
    flash(table);
}

} // namespace rayloom::test::budget
