// SPDX-License-Identifier: Apache-2.0
// What stays true of a node whatever its picture: which invariants each one holds stands in
// invariants.txt, one line a node. The list and the measurement must agree both ways, so that a
// node that loses one fails, and a new node is asked for its line.
#include "rayloom/engine/run.h"
#include "tests/stress/hostile_images.h"
#include "tests/support/folders.h"
#include "tests/support/made_up_input.h"
#include "tests/support/subjects.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iostream>
#include <set>
#include <sstream>

namespace rayloom::test
{
namespace
{

using Images = std::vector<MemoryImage>;

Images images_of(const Graph& graph, const RunRequest& request)
{
    RunReport report = run_graph(graph, request);
    Images images;
    for (auto& [name, list] : report.images)
        for (MemoryImage& image : list) images.push_back(std::move(image));
    return images;
}

/// Calls with each pixel of both; false as soon as `agree` is.
bool all_pixels(const Images& a, const Images& b,
                const std::function<bool(float, float, const MemoryImage&)>& agree)
{
    if (a.size() != b.size()) return false;
    for (std::size_t i = 0; i < a.size(); ++i) {
        const Region& r = a[i].desc.data;
        if (r != b[i].desc.data || a[i].desc.channels != b[i].desc.channels) return false;
        for (int c = 0; c < a[i].desc.channel_count(); ++c)
            for (int y = r.y0; y < r.y1; ++y)
                for (int x = r.x0; x < r.x1; ++x)
                    if (!agree(a[i].pixels.view().at(c, x, y), b[i].pixels.view().at(c, x, y),
                               a[i]))
                        return false;
    }
    return true;
}

float largest(const MemoryImage& image)
{
    float most = 0.0f;
    const Region& r = image.desc.data;
    for (int c = 0; c < image.desc.channel_count(); ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (const float v : image.pixels.view().row_span(c, y))
                most = std::max(most, std::abs(v));
    return most;
}

/// Equal up to rounding, measured against the largest value of the picture.
bool same_but_for_rounding(const Images& a, const Images& b)
{
    std::vector<float> scale;
    for (const MemoryImage& image : a) scale.push_back(largest(image));
    return all_pixels(a, b, [&](float u, float v, const MemoryImage& image) {
        const float limit = 2e-5f * scale[static_cast<std::size_t>(&image - a.data())];
        return std::abs(u - v) <= limit;
    });
}

/// Pixel (x, y) of what comes out is pixel `from(x, y)` of what went in; windows begin at 0.
template <class From>
MemoryImage moved(const MemoryImage& image, bool swap_axes, const From& from)
{
    MemoryImage out;
    out.desc = image.desc;
    if (swap_axes) {
        const Region &d = image.desc.data, &w = image.desc.display;
        out.desc.data = {d.y0, d.x0, d.y1, d.x1};
        out.desc.display = {w.y0, w.x0, w.y1, w.x1};
    }
    out.pixels = ImageBuffer(out.desc.data, out.desc.channel_count());
    const Region& r = out.desc.data;
    for (int c = 0; c < out.desc.channel_count(); ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x) {
                const auto [fx, fy] = from(r, x, y);
                out.pixels.view().at(c, x, y) = image.pixels.view().at(c, fx, fy);
            }
    return out;
}

MemoryImage mirrored(const MemoryImage& image)
{
    return moved(image, false, [](const Region& r, int x, int y) {
        return std::pair{r.x0 + r.x1 - 1 - x, y};
    });
}

MemoryImage transposed(const MemoryImage& image)
{
    return moved(image, true, [](const Region&, int x, int y) { return std::pair{y, x}; });
}

bool is_light(const std::string& input)
{
    for (const char* other : {"histogram", "count", "variance", "albedo", "guide", "normal",
                              "depth", "parts", "pivot", "color"})
        if (input.ends_with(other) && !(input == "color")) return false;
    return true;
}

/// Even sizes, so that a pyramid halves the mirrored picture at the mirrored places.
constexpr Region square{0, 0, 48, 48};

RunRequest plain_request(const Graph& graph)
{
    RunRequest request = made_up_request(graph, square);
    // Light on one side, dark on the other, and a display window that mirrors onto itself.
    change_images(request, [](const std::string&, std::size_t, MemoryImage& image) {
        image.desc.display = image.desc.data;
    });
    return request;
}

bool holds_constant(const Graph& graph, bool same_value)
{
    RunRequest request = plain_request(graph);
    change_images(request, [](const std::string&, std::size_t, MemoryImage& image) {
        set_pixels(image, [](int, int, int, float) { return 0.375f; });
    });
    const Images out = images_of(graph, request);
    for (const MemoryImage& image : out) {
        const Region& r = image.desc.data;
        for (int c = 0; c < image.desc.channel_count(); ++c) {
            const float first = same_value ? 0.375f : image.pixels.view().at(c, r.x0, r.y0);
            for (int y = r.y0; y < r.y1; ++y)
                for (const float v : image.pixels.view().row_span(c, y))
                    if (!(std::abs(v - first) <= 2e-6f * std::max(1.0f, std::abs(first))))
                        return false;
        }
    }
    return !out.empty();
}

bool holds_range(const Graph& graph)
{
    const RunRequest request = plain_request(graph);
    if (request.inputs.empty()) return false;
    float low = INFINITY, high = -INFINITY;
    for (const auto& [name, binding] : request.inputs)
        for (const auto& image : binding.images)
            for (int c = 0; c < image->desc.channel_count(); ++c)
                for (int y = square.y0; y < square.y1; ++y)
                    for (const float v : image->pixels.view().row_span(c, y)) {
                        low = std::min(low, v);
                        high = std::max(high, v);
                    }
    const Images out = images_of(graph, request);
    const float slack = 1e-6f * high;
    return !out.empty() && all_pixels(out, out, [&](float v, float, const MemoryImage&) {
        return v >= low - slack && v <= high + slack;
    });
}

/// Light times four, variances times sixteen: to the last bit, as no rounding changes with a power
/// of two. The first output is light; a variance beside it is not looked at.
bool holds_scale(const Graph& graph)
{
    const RunRequest plain = plain_request(graph);
    RunRequest scaled = plain;
    bool any = false;
    change_images(scaled, [&](const std::string& input, std::size_t, MemoryImage& image) {
        const bool light = is_light(input);
        any = any || light;
        const int alpha = image.desc.alpha();
        if (light)
            set_pixels(image, [=](int c, int, int, float v) { return c == alpha ? v : 4.0f * v; });
        if (input.ends_with("variance"))
            set_pixels(image, [](int, int, int, float v) { return 16.0f * v; });
    });
    if (!any || graph.outputs.empty()) return false;
    const std::string& first = graph.outputs.front().name;
    RunReport a = run_graph(graph, plain), b = run_graph(graph, scaled);
    if (!a.images.contains(first) || !b.images.contains(first)) return false;
    for (MemoryImage& image : a.images[first])
        for (const int c : image.desc.colour())
            for (int y = image.desc.data.y0; y < image.desc.data.y1; ++y)
                for (float& v : image.pixels.view().row_span(c, y)) v *= 4.0f;
    return all_pixels(a.images[first], b.images[first],
                      [](float u, float v, const MemoryImage&) { return u == v; });
}

bool holds_order(const Graph& graph)
{
    const RunRequest plain = plain_request(graph);
    RunRequest turned = plain;
    bool any = false;
    for (auto& [name, binding] : turned.inputs)
        if (binding.is_list) {
            std::ranges::reverse(binding.images);
            any = true;
        }
    return any && same_but_for_rounding(images_of(graph, plain), images_of(graph, turned));
}

bool holds_move(const Graph& graph, MemoryImage (*move)(const MemoryImage&))
{
    const RunRequest plain = plain_request(graph);
    RunRequest request = plain;
    change_images(
        request, [&](const std::string&, std::size_t, MemoryImage& image) { image = move(image); });
    Images expected;
    for (const MemoryImage& image : images_of(graph, plain)) expected.push_back(move(image));
    return !expected.empty() && same_but_for_rounding(expected, images_of(graph, request));
}

std::set<std::string> measured(const Graph& graph)
{
    std::set<std::string> held;
    const auto look = [&](const char* name, const auto& holds) {
        try {
            if (holds()) held.insert(name);
        } catch (const Error&) { // refused: nothing to hold
        }
    };
    look("flat", [&] { return holds_constant(graph, false); });
    look("constant", [&] { return holds_constant(graph, true); });
    look("range", [&] { return holds_range(graph); });
    look("scale", [&] { return holds_scale(graph); });
    look("order", [&] { return holds_order(graph); });
    look("mirror", [&] { return holds_move(graph, mirrored); });
    look("transpose", [&] { return holds_move(graph, transposed); });
    return held;
}

std::map<std::string, std::set<std::string>> listed()
{
    std::ifstream file(test::source_folder() / "tests/stress/invariants.txt");
    std::map<std::string, std::set<std::string>> list;
    for (std::string line; std::getline(file, line);) {
        std::istringstream words(line.substr(0, line.find('#')));
        std::string subject;
        if (!(words >> subject)) continue;
        std::set<std::string>& held = list[subject];
        for (std::string word; words >> word;) held.insert(word);
    }
    return list;
}

std::string line_of(const std::string& subject, const std::set<std::string>& held)
{
    std::string line = subject;
    for (const std::string& word : held) line += " " + word;
    return line;
}

TEST(Invariants, AreThoseListedForEachNode)
{
    const auto list = listed();
    std::set<std::string> seen;
    for (const std::string& node : built_in_nodes()) {
        const Graph graph = example_graph(node);
        if (touches_files(graph)) continue;
        seen.insert(node);
        const std::set<std::string> held = measured(graph);
        const auto it = list.find(node);
        if (it == list.end() || it->second != held)
            ADD_FAILURE() << "tests/stress/invariants.txt says: "
                          << (it == list.end() ? "nothing" : line_of(node, it->second))
                          << "\n                     measured is: " << line_of(node, held);
    }
    for (const auto& [node, held] : list)
        EXPECT_TRUE(seen.contains(node)) << "no node is called " << node;
}

} // namespace
} // namespace rayloom::test
