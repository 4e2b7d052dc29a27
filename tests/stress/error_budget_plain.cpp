// SPDX-License-Identifier: Apache-2.0
// Error of every node that has a plain version in double (tests/oracle/plain_nodes.cpp), in the
// graph of its entry there, on made-up light, on the same light far away from zero, and on light of
// many magnitudes. A node joins by being in that table. Deep nodes have versions of their own.
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/oracle/plain_nodes.h"
#include "tests/stress/error_budget.h"
#include "tests/support/made_up_deep.h"
#include "tests/support/made_up_input.h"
#include "tests/support/run_deep_node.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

namespace rayloom::test::budget
{
namespace
{

using oracle::NodeWork;
using oracle::Raster;

struct Kind {
    const char* name;
    std::function<float(float value, std::mt19937&)> change;
};

const std::vector<Kind>& kinds()
{
    static const std::vector<Kind> all{
        {"made-up light", [](float v, std::mt19937&) { return v; }},
        {"the same on 1e4", [](float v, std::mt19937&) { return v + 1e4f; }},
        {"over twelve decades",
         [](float v, std::mt19937& random) {
             const double share = std::uniform_real_distribution<>(-6.0, 6.0)(random);
             return static_cast<float>(static_cast<double>(v) * std::pow(10.0, share));
         }},
    };
    return all;
}

Raster<double> raster_of(const MemoryImage& image)
{
    const Region& r = image.desc.data;
    Raster<double> out(r.width(), r.height(), image.desc.channel_count());
    for (int c = 0; c < out.channels; ++c)
        for (int y = 0; y < out.height; ++y)
            for (int x = 0; x < out.width; ++x)
                out.at(c, x, y) =
                    static_cast<double>(image.pixels.view().at(c, r.x0 + x, r.y0 + y));
    return out;
}

std::shared_ptr<MemoryImage> changed_copy(const MemoryImage& image, const Kind& kind,
                                          std::mt19937& random)
{
    auto copy = std::make_shared<MemoryImage>();
    copy->desc = image.desc;
    copy->pixels = ImageBuffer(image.desc.data, image.desc.channel_count());
    const Region& r = image.desc.data;
    const bool counts = image.desc.channels == std::vector<std::string>{"N"};
    for (int c = 0; c < image.desc.channel_count(); ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x) {
                const float v = image.pixels.view().at(c, x, y);
                copy->pixels.view().at(c, x, y) = counts ? v : kind.change(v, random);
            }
    return copy;
}

/// What the values of a node are measured against.
enum class Against { value, largest, inputs, median };

/// Each value, but for results whose parts cancel: those are measured against the parts.
Against against_of(const std::string& node, const oracle::PlainResult& truth)
{
    // Parts of both signs that lie around the pixel, and shares of a whole.
    if (node == "multiscale.steerable_inverse" || node == "transform.histogram")
        return Against::largest;
    // Differences of inputs at the same pixel.
    if (node == "fuse.residual" || node == "threshold.outlier") return Against::inputs;
    // What the logarithm was moved off zero by is a share of the median.
    if (node == "transform.exp") return Against::median;
    for (const auto& [name, images] : truth.images)
        for (const Raster<double>& image : images)
            for (const double v : image.values)
                if (v < 0.0) return Against::largest;
    return Against::value;
}

const char* text_of(Against against)
{
    switch (against) {
    case Against::value: return itself;
    case Against::largest: return largest;
    case Against::inputs: return "largest input of the pixel";
    case Against::median: return "value, at least the median";
    }
    return "";
}

void compare(const MemoryImage& got, const Raster<double>& truth, Against against,
             const oracle::PlainInput& inputs, Error& error)
{
    const Raster<double> values = raster_of(got);
    ASSERT_EQ(values.values.size(), truth.values.size());
    for (int c = 0; c < truth.channels; ++c) {
        std::vector<double> sizes;
        for (int y = 0; y < truth.height; ++y)
            for (int x = 0; x < truth.width; ++x) sizes.push_back(std::fabs(truth.at(c, x, y)));
        std::ranges::sort(sizes);
        for (int y = 0; y < truth.height; ++y)
            for (int x = 0; x < truth.width; ++x) {
                double scale = std::fabs(truth.at(c, x, y));
                if (against == Against::largest) scale = sizes.back();
                if (against == Against::median) scale = std::max(scale, sizes[sizes.size() / 2]);
                if (against == Against::inputs)
                    for (const auto& [name, images] : inputs.bound)
                        scale = std::max(scale, std::fabs(images.front().at(c, x, y)));
                error.add(values.at(c, x, y), truth.at(c, x, y), scale);
            }
    }
}

void plain_node(const NodeWork& work, const Kind& kind, Table& table)
{
    const Graph graph = parse_graph(oracle::graph_text(work), work.node);
    RunRequest request = made_up_request(graph, Region{-5, 3, 56, 50}, 1);
    oracle::PlainInput plain;
    std::mt19937 random(21);
    for (auto& [name, input] : request.inputs)
        for (auto& image : input.images) {
            auto changed = changed_copy(*image, kind, random);
            if (work.node == "threshold.sanitize")
                for (int y = 20; y < 24; ++y)
                    for (int x = 10; x < 14; ++x)
                        changed->pixels.view().at(2, x, y) =
                            std::numeric_limits<float>::quiet_NaN();
            plain.bound[name].push_back(raster_of(*changed));
            image = std::move(changed);
        }
    const RunReport report = run_graph(graph, request);
    const oracle::PlainResult truth = work.plain(plain);
    const Against against = against_of(work.node, truth);
    Error error;
    for (const auto& [name, images] : truth.images)
        for (std::size_t i = 0; i < images.size(); ++i)
            compare(report.images.at(name).at(i), images[i], against, plain, error);
    for (const auto& [name, columns] : truth.tables)
        for (const auto& [column, numbers] : columns)
            for (std::size_t row = 0; row < numbers.size(); ++row) {
                const double got = report.tables.at(name).front().number(column, row);
                // Infinity where that is the answer: PSNR of images that are equal.
                if (got == numbers[row])
                    error.add(0.0, 0.0);
                else
                    error.add(got, numbers[row]);
            }
    table.push_back({work.node, kind.name, text_of(against), error});
}

// ------------------------------------------------------------------------------- deep pixels

void deep_nodes(Table& table)
{
    const Region window{-4, 2, 37, 33};
    for (const Kind& kind : kinds()) {
        std::mt19937 random(22);
        // Alpha and depth stay.
        const MemoryDeep deep = with_values(made_up_deep(window, 5), [&](int c, int, int, float v) {
            return c < 3 ? kind.change(v, random) : v;
        });
        const MemoryImage color = [&] {
            MemoryImage image;
            image.desc.data = image.desc.display = window;
            image.desc.channels = {"R", "G", "B"};
            image.pixels = ImageBuffer(window, 3);
            std::uniform_real_distribution<float> unit(0.1f, 1.0f);
            for (int c = 0; c < 3; ++c)
                for (int y = window.y0; y < window.y1; ++y)
                    for (int x = window.x0; x < window.x1; ++x)
                        image.pixels.view().at(c, x, y) = kind.change(unit(random), random);
            return image;
        }();
        const DeepRun flat = run_deep("{op: transform.deep_flatten, deep: deep}", deep);
        const DeepRun recolored =
            run_deep("{op: transform.deep_recolor, deep: deep, color: color}", deep, &color);
        Error flattened, values;
        for (int y = window.y0; y < window.y1; ++y)
            for (int x = window.x0; x < window.x1; ++x)
                for (int c = 0; c < 3; ++c) {
                    const auto samples = samples_of(deep, c, x, y);
                    flattened.add(static_cast<double>(flat.image().pixels.view().at(c, x, y)),
                                  oracle::flatten(samples));
                    if (samples.empty() || !(oracle::coverage(samples) > 0.0)) continue;
                    const auto truth = oracle::recolor(
                        samples, static_cast<double>(color.pixels.view().at(c, x, y)), 8.0);
                    const auto got = samples_at(recolored.deep(), c, x, y);
                    double most = 0.0;
                    for (const double v : truth) most = std::max(most, std::fabs(v));
                    for (std::size_t i = 0; i < truth.size(); ++i)
                        values.add(static_cast<double>(got[i]), truth[i], most);
                }
        table.push_back({"transform.deep_flatten", kind.name, itself, flattened});
        table.push_back({"transform.deep_recolor", kind.name, "largest of the pixel", values});
    }
}

} // namespace

void add_plain_entries(Table& table)
{
    for (const NodeWork& work : oracle::node_work())
        for (const Kind& kind : kinds())
            if (work.plain) plain_node(work, kind, table);
    deep_nodes(table);
}

} // namespace rayloom::test::budget
