// SPDX-License-Identifier: Apache-2.0
/// Every node is in the table of work and plain versions by being registered, and does what its
/// plain version says.
#include "rayloom/core/registry.h"
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/oracle/plain_nodes.h"
#include "tests/support/folders.h"
#include "tests/support/made_up_input.h"
#include "tests/support/render_data.h"
#include "tests/support/subjects.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <set>
#include <sstream>

namespace rayloom
{
namespace
{

using oracle::NodeWork;
using oracle::Raster;

std::string text_of(const std::filesystem::path& file)
{
    std::ostringstream text;
    text << std::ifstream(file).rdbuf();
    return text.str();
}

TEST(NodeWork, EveryNodeIsInTheTable)
{
    std::set<std::string> registered, listed;
    // What takes deep pixels alone has work by the sample, and tests/oracle/deep.h.
    const auto is_deep = [](const std::string& node) {
        return std::ranges::any_of(Registry::instance().find(node)->inputs, [](const PortInfo& p) {
            return p.kind == PortKind::deep && p.required;
        });
    };
    for (const std::string& node : test::built_in_nodes())
        if (!node.starts_with("io.") && !is_deep(node)) registered.insert(node);
    for (const NodeWork& work : oracle::node_work()) {
        EXPECT_TRUE(listed.insert(work.node).second) << work.node << " twice";
        EXPECT_GE(work.flops, 0.0) << work.node;
        EXPECT_GE(work.bytes, 0.0) << work.node;
        EXPECT_GT(work.count.size(), 10u) << work.node << ": how flops and bytes were counted";
    }
    for (const std::string& node : registered)
        EXPECT_TRUE(listed.contains(node))
            << node << " wants an entry in tests/oracle/plain_nodes.cpp: flops and bytes a pixel, "
            << "and a plain version";
    for (const std::string& node : listed) EXPECT_TRUE(registered.contains(node)) << node;
}

TEST(NodeWork, WithoutAPlainVersionThereIsABenchmarkOfThePair)
{
    std::string benchmarks;
    for (const auto& file :
         std::filesystem::directory_iterator(test::source_folder() / "tests/bench"))
        if (file.path().string().ends_with("_bench.cpp")) benchmarks += text_of(file.path());
    for (const NodeWork& work : oracle::node_work()) {
        if (work.plain || work.node.starts_with("oiio.")) continue;
        // "node/plain_case", or "node/" + name with names that begin with plain_.
        EXPECT_TRUE(benchmarks.find('"' + work.node + "/plain") != std::string::npos ||
                    (benchmarks.find('"' + work.node + "/\"") != std::string::npos &&
                     benchmarks.find("plain_") != std::string::npos))
            << work.node;
    }
}

Raster<double> raster_of(const MemoryImage& image)
{
    const Region& r = image.desc.data;
    Raster<double> out(r.width(), r.height(), image.desc.channel_count());
    for (int c = 0; c < out.channels; ++c)
        for (int y = 0; y < out.height; ++y)
            for (int x = 0; x < out.width; ++x)
                out.at(c, x, y) = image.pixels.view().at(c, r.x0 + x, r.y0 + y);
    return out;
}

/// What is done to made-up images before both versions see them.
struct Input {
    const char* name;
    unsigned seed;
    std::function<void(MemoryImage&, std::size_t number)> change;
};

void scale(MemoryImage& image, float factor)
{
    if (image.desc.channels == std::vector<std::string>{"N"}) return; // sample counts
    for (int y = image.desc.data.y0; y < image.desc.data.y1; ++y)
        for (int c = 0; c < image.desc.channel_count(); ++c)
            for (float& v : image.pixels.view().row_span(c, y)) v *= factor;
}

/// Three channels become those of a real render, another one for every image.
void take_render(MemoryImage& image, std::size_t number)
{
    if (image.desc.channel_count() != 3) return;
    static const std::vector<test::TestImage> renders =
        test::read_stack(test::source_folder() / "tests/data/cycles/interior", 16);
    const test::TestImage& render = renders.at(number % renders.size());
    const Region& from = render.desc.data;
    for (int y = image.desc.data.y0; y < image.desc.data.y1; ++y)
        for (int c = 0; c < 3; ++c)
            for (int x = image.desc.data.x0; x < image.desc.data.x1; ++x)
                image.pixels.view().at(c, x, y) = render.view().at(
                    c, from.x0 + (x + 100) % from.width(), from.y0 + (y + 100) % from.height());
}

const std::vector<Input>& inputs()
{
    static const std::vector<Input> all{
        {"made_up", 1, [](MemoryImage&, std::size_t) {}},
        {"made_up_again", 77, [](MemoryImage&, std::size_t) {}},
        {"bright", 2, [](MemoryImage& image, std::size_t) { scale(image, 3e4f); }},
        {"dark", 3, [](MemoryImage& image, std::size_t) { scale(image, 3e-4f); }},
        {"render", 4, take_render},
    };
    return all;
}

struct Case {
    const NodeWork* work;
    const Input* input;
};

std::vector<Case> cases()
{
    std::vector<Case> all;
    for (const NodeWork& work : oracle::node_work())
        for (const Input& input : inputs())
            if (work.plain) all.push_back({&work, &input});
    return all;
}

void expect_same(const std::string& name, const MemoryImage& image, const Raster<double>& expected,
                 double tolerance)
{
    const Raster<double> got = raster_of(image);
    ASSERT_EQ(got.width, expected.width) << name;
    ASSERT_EQ(got.height, expected.height) << name;
    ASSERT_EQ(got.channels, expected.channels) << name;
    for (int c = 0; c < got.channels; ++c) {
        double largest = 0.0, worst = 0.0;
        int at_x = 0, at_y = 0;
        for (int y = 0; y < got.height; ++y)
            for (int x = 0; x < got.width; ++x) {
                ASSERT_TRUE(std::isfinite(got.at(c, x, y))) << name << " " << x << " " << y;
                largest = std::max(largest, std::abs(expected.at(c, x, y)));
                const double error = std::abs(got.at(c, x, y) - expected.at(c, x, y));
                if (error <= worst) continue;
                worst = error;
                at_x = x;
                at_y = y;
            }
        EXPECT_LE(worst, tolerance * largest)
            << name << ", channel " << c << " at (" << at_x << ", " << at_y
            << "): " << got.at(c, at_x, at_y) << ", plainly " << expected.at(c, at_x, at_y);
    }
}

class PlainNode : public testing::TestWithParam<Case>
{
};

TEST_P(PlainNode, SaysTheSame)
{
    const NodeWork& work = *GetParam().work;
    const Graph graph = parse_graph(oracle::graph_text(work), work.node);
    RunRequest request =
        test::made_up_request(graph, Region{-5, 3, 56, 50}, GetParam().input->seed);
    oracle::PlainInput plain;
    std::size_t number = 0;
    for (auto& [name, input] : request.inputs)
        for (auto& image : input.images) {
            auto changed = std::make_shared<MemoryImage>();
            changed->desc = image->desc;
            changed->pixels = ImageBuffer(image->desc.data, image->desc.channel_count());
            copy_pixels(image->pixels.view(), changed->pixels.view());
            GetParam().input->change(*changed, number++);
            if (work.node == "threshold.sanitize") {
                changed->pixels.view().at(0, 3, 9) = std::numeric_limits<float>::quiet_NaN();
                changed->pixels.view().at(1, -5, 3) = std::numeric_limits<float>::infinity();
                for (int y = 20; y < 24; ++y)
                    for (int x = 10; x < 14; ++x)
                        changed->pixels.view().at(2, x, y) =
                            -std::numeric_limits<float>::infinity();
            }
            plain.bound[name].push_back(raster_of(*changed));
            image = std::move(changed);
        }
    const RunReport report = run_graph(graph, request);
    const oracle::PlainResult expected = work.plain(plain);
    ASSERT_FALSE(expected.images.empty() && expected.tables.empty());
    for (const auto& [name, images] : expected.images) {
        const auto& got = report.images.at(name);
        ASSERT_EQ(got.size(), images.size()) << name;
        for (std::size_t i = 0; i < images.size(); ++i)
            expect_same(name + "[" + std::to_string(i) + "]", got[i], images[i], work.tolerance);
    }
    for (const auto& [name, columns] : expected.tables)
        for (const auto& [column, numbers] : columns)
            for (std::size_t row = 0; row < numbers.size(); ++row)
                EXPECT_NEAR(report.tables.at(name).front().number(column, row), numbers[row],
                            work.tolerance * std::abs(numbers[row]))
                    << name << "." << column << "[" << row << "]";
}

INSTANTIATE_TEST_SUITE_P(Nodes, PlainNode, testing::ValuesIn(cases()), [](const auto& subject) {
    return test::as_test_name(subject.param.work->node) + "_" + subject.param.input->name;
});

} // namespace
} // namespace rayloom
