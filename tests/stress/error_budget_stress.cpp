// SPDX-License-Identifier: Apache-2.0
// How far each fast kernel is from its plain double counterpart, on input that is kind to it and on
// input that is not. Each entry has a bound that is held here; with RAYLOOM_NUMBERS=FILE the table
// of docs/numbers.md is written (`./dev numbers`).
#include "nodes/fuse/nlm_kernel.h"
#include "rayloom/image/border.h"
#include "rayloom/stats/posterior_mean.h"
#include "tests/oracle/histogram_fusion.h"
#include "tests/oracle/nlm.h"
#include "tests/oracle/posterior_mean.h"
#include "tests/oracle/steerable.h"
#include "tests/stress/error_budget.h"
#include "tests/support/folders.h"
#include "tests/support/run_node.h"
#include "tests/support/subjects.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <random>
#include <set>

namespace rayloom::test
{
namespace
{

using namespace budget;
const std::vector<std::string> rgb{"R", "G", "B"};

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
             compare(run.image(), fuse_histogram(raster(image), raster(bins), settings))});
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
        table.push_back({"fuse.nlm, 2^−x", "0 ≤ x < 100", itself, error});
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
        table.push_back({"fuse.nlm, no gate", text, itself, error});
    }
}

// ------------------------------------------------------------------------------- bands and coring

void coring(Table& table)
{
    const std::vector<double> shapes =
        long_version() ? std::vector<double>{0.3, 0.5, 0.8, 1.0, 1.5, 2.0, 3.0, 4.0}
                       : std::vector<double>{0.3, 1.0, 4.0};
    for (const double ratio : {1e-3, 1e-1, 1.0, 10.0, 1e3}) {
        Error relative, absolute(1.0);
        for (const double signal_p : shapes)
            for (const double noise_p : shapes) {
                const GeneralisedLaplacian signal{ratio, signal_p}, noise{1.0, noise_p};
                const double greatest = 20.0 * std::max(ratio, 1.0);
                const PosteriorMeanTable fast(signal, noise, greatest);
                std::vector<float> seen;
                std::vector<double> truth;
                for (double y = 1e-4; y <= greatest; y *= 2.7) {
                    seen.push_back(static_cast<float>(y));
                    truth.push_back(oracle::posterior_mean(static_cast<double>(seen.back()), ratio,
                                                           signal_p, 1.0, noise_p));
                }
                // Of the largest: zeros in the place of a curve are an error of 1.
                const double floor = 1e-3 * *std::ranges::max_element(truth);
                for (std::size_t i = 0; i < seen.size(); ++i) {
                    const auto found = static_cast<double>(fast(seen[i]));
                    relative.add(found, truth[i], std::max(truth[i], floor));
                    const double y = static_cast<double>(seen[i]);
                    absolute.add(found, truth[i], 1.0 + 1e-3 * y);
                    if (std::getenv("BUDGET_DEBUG"))
                        std::printf("%g %g %g y %g: %g %g  %g %g\n", ratio, signal_p, noise_p,
                                    seen[i], found, truth[i], std::abs(found - truth[i]),
                                    std::abs(found - truth[i]) / std::max(truth[i], floor));
                }
            }
        char text[120];
        std::snprintf(text, sizeof text, "s of signal / s of noise = %g, p of both %s", ratio,
                      long_version() ? "from 0.3 to 4" : "0.3, 1 and 4");
        table.push_back(
            {"threshold.coring, table", text, "value, at least 1e-3 of the largest", relative});
        table.push_back(
            {"threshold.coring, as its page promises", text, "s of the noise + y/1000", absolute});
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
        table.push_back({"multiscale.steerable, high-pass", text, largest, high});
        table.push_back({"multiscale.steerable, oriented", text, largest, oriented});
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
            {"multiscale.pyramid", text, itself, compare(run.image("levels", 2), truth)});
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
                             compare(joined.image(), expected, largest_of(expected))});
        }
    }
}

// ------------------------------------------------------------------------------- the table

/// What error_bounds.txt says.
struct Bounds {
    std::map<std::string, double> of_row;      ///< "kernel; input"
    std::set<std::string> optional;            ///< rows of the other length of the test
    std::map<std::string, std::string> reason; ///< of a kernel's entries above 1e-5
    std::map<std::string, std::string> no_row; ///< node, or stage.*, and why it has none
};

std::vector<std::string> fields(const std::string& line)
{
    std::vector<std::string> parts;
    std::size_t from = 0;
    for (std::size_t to; (to = line.find("; ", from)) != std::string::npos; from = to + 2)
        parts.push_back(line.substr(from, to - from));
    parts.push_back(line.substr(from));
    return parts;
}

Bounds read_bounds()
{
    Bounds bounds;
    std::ifstream file(source_folder() / "tests/stress/error_bounds.txt");
    for (std::string line; std::getline(file, line);) {
        if (line.empty() || line[0] == '#') continue;
        const std::vector<std::string> part = fields(line);
        bool known = part.size() >= 3;
        if (known && part[0] == "why") {
            known = bounds.reason.emplace(part[1], line.substr(part[1].size() + 7)).second;
        } else if (known && part[0] == "none") {
            known = bounds.no_row.emplace(part[1], part[2]).second;
        } else if (known && part.size() == 4) {
            const std::string row = part[1] + "; " + part[2];
            known = part[0] == "row" || part[0] == "short" || part[0] == "long";
            known = known && bounds.of_row.emplace(row, std::stod(part[3])).second;
            if (part[0] == (long_version() ? "short" : "long")) bounds.optional.insert(row);
        } else {
            known = false;
        }
        EXPECT_TRUE(known) << "error_bounds.txt: " << line;
    }
    return bounds;
}

/// All entries, measured once.
const Table& measured()
{
    static const Table table = [] {
        Table t;
        add_sum_entries(t);
        histogram(t);
        nlm(t);
        add_plane_entries(t);
        coring(t);
        steerable(t);
        pyramid(t);
        add_node_entries(t);
        add_plain_entries(t);
        return t;
    }();
    return table;
}

/// Where float arithmetic has no say, what the last bits of a double do is luck.
constexpr double nothing_closer = 1e-12;

/// A cell of a Markdown table: |y| is no two borders.
std::string cell(const std::string& text)
{
    std::string out;
    for (const char c : text) out += c == '|' ? std::string("\\|") : std::string(1, c);
    return out;
}

/// An error with `digits` behind the point; nought is nought.
std::string figure(double error, int digits)
{
    char text[40];
    std::snprintf(text, sizeof text, "%.*e", digits, error);
    return error == 0.0 ? "0" : text;
}

void write_table(const std::string& file, const Bounds& bounds)
{
    std::ofstream out(file);
    out << "| kernel | input | relative error | against | ULP | held below |\n"
           "|---|---|---|---|---|---|\n";
    for (const Entry& e : measured()) {
        const auto bound = bounds.of_row.find(e.kernel + "; " + e.input);
        char ulp[40];
        std::snprintf(ulp, sizeof ulp, "%.3g", e.error.ulp());
        out << "| " << cell(e.kernel) << " | " << cell(e.input) << " | "
            << figure(e.error.relative(), 1) << " | " << cell(e.against) << " | " << ulp << " | "
            << (bound == bounds.of_row.end() ? "" : figure(bound->second, 1)) << " |\n";
    }
    std::set<std::string> said;
    for (const Entry& e : measured())
        if (e.error.relative() > 1e-5 && said.insert(e.kernel).second) {
            const auto reason = bounds.reason.find(e.kernel);
            out << (said.size() == 1 ? "\nWhy, for the entries above 1e-5:\n\n- " : "- ")
                << e.kernel << ": " << (reason == bounds.reason.end() ? "" : reason->second)
                << "\n";
        }
    out << "\nNodes without an entry:\n\n";
    for (const auto& [node, reason] : bounds.no_row)
        out << "- `" << node << "`: " << reason << "\n";
}

TEST(ErrorBudget, EachKernelIsWithinItsBound)
{
    const Bounds bounds = read_bounds();
    std::set<std::string> seen;
    for (const Entry& e : measured()) {
        const std::string row = e.kernel + "; " + e.input;
        EXPECT_TRUE(seen.insert(row).second) << row << " twice";
        EXPECT_GT(e.error.count(), 0u) << row << " measures nothing";
        const double error = e.error.relative();
        const auto found = bounds.of_row.find(row);
        if (found == bounds.of_row.end()) {
            ADD_FAILURE() << "error_bounds.txt has no bound for: row; " << row << "; " << error;
            continue;
        }
        EXPECT_LE(error, found->second) << row;
        // A bound far above what is measured holds nothing.
        EXPECT_LE(found->second, std::max(4.0 * error, nothing_closer)) << row << ": " << error;
        EXPECT_TRUE(error <= 1e-5 || bounds.reason.contains(e.kernel))
            << row << ": " << error << " and no reason in error_bounds.txt";
    }
    for (const auto& [row, bound] : bounds.of_row)
        EXPECT_TRUE(seen.contains(row) || bounds.optional.contains(row))
            << row << " is not measured";
    if (const char* file = std::getenv("RAYLOOM_NUMBERS")) write_table(file, bounds);
}

/// Whether `text` names the node: "fit.noise, shape" names fit.noise, "fit.noise_map" does not.
bool names(const std::string& text, const std::string& node)
{
    const auto part_of_name = [](char c) {
        return std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '.';
    };
    for (std::size_t at = 0; (at = text.find(node, at)) != std::string::npos; ++at) {
        const std::size_t end = at + node.size();
        if ((at == 0 || !part_of_name(text[at - 1])) &&
            (end == text.size() || !part_of_name(text[end])))
            return true;
    }
    return false;
}

TEST(ErrorBudget, EveryNodeHasARowOrAReason)
{
    const Bounds bounds = read_bounds();
    std::set<std::string> used;
    for (const std::string& node : built_in_nodes()) {
        const bool row =
            std::ranges::any_of(measured(), [&](const Entry& e) { return names(e.kernel, node); });
        const std::string stage = node.substr(0, node.find('.')) + ".*";
        for (const std::string& listed : {node, stage})
            if (bounds.no_row.contains(listed)) {
                EXPECT_FALSE(row) << node << " has a row and a reason for having none";
                used.insert(listed);
            }
        EXPECT_TRUE(row || used.contains(node) || used.contains(stage))
            << node << " has no row in the table of docs/numbers.md: give it a plain version in "
            << "tests/oracle/plain_nodes.cpp, or error_bounds.txt the reason why it needs none";
    }
    for (const auto& [node, reason] : bounds.no_row)
        EXPECT_TRUE(used.contains(node)) << node << " is no node";
}

} // namespace
} // namespace rayloom::test
