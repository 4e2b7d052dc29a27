// SPDX-License-Identifier: Apache-2.0
#include "tests/support/made_up_input.h"

#include "rayloom/core/error.h"
#include "tests/support/engine_nodes_for_tests.h"
#include "tests/support/made_up_deep.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

namespace rayloom::test
{

namespace
{

constexpr int list_length = 5;
constexpr int bins = 20;

std::shared_ptr<MemoryImage> blank(const Region& window, std::vector<std::string> channels)
{
    auto image = std::make_shared<MemoryImage>();
    image->desc.data = window;
    // Overscan on one side, cut off on the other.
    image->desc.display = window.shifted(3, -2);
    image->desc.channels = std::move(channels);
    image->pixels = ImageBuffer(window, image->desc.channel_count());
    return image;
}

/// What is left of n, from 0 on wherever windows begin.
std::int64_t rest(std::int64_t n, int of) { return (n % of + of) % of; }

/// Two regions of different light, so that filters have something to keep apart.
float radiance(int x, int y, std::mt19937& random)
{
    std::exponential_distribution<float> light(1.0f);
    return rest(std::int64_t{x} + y, 29) < 14 ? 0.2f * light(random) : 1.5f * light(random);
}

std::shared_ptr<MemoryImage> histogram_image(const Region& window, unsigned seed)
{
    std::vector<std::string> names;
    for (int i = 0; i < 3 * bins + 1; ++i) {
        std::string digits = std::to_string(i);
        names.push_back("Bin_" + std::string(4 - digits.size(), '0') + digits);
    }
    auto image = blank(window, names);
    image->pixels.fill(0.0f);
    std::mt19937 random(seed);
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0; x < window.x1; ++x) {
            const auto more = rest(std::int64_t{x} * 7 + std::int64_t{y} * 3, 5);
            const int samples = 14 + static_cast<int>(more);
            for (int s = 0; s < samples; ++s)
                for (int c = 0; c < 3; ++c) {
                    const float v =
                        std::min(2.0f, std::pow(radiance(x, y, random), 1.0f / 2.2f) / 2.5f);
                    const float f = std::min(v * (bins - 2), bins - 2.001f);
                    const int b = static_cast<int>(f);
                    image->pixels.view().at(c * bins + b, x, y) +=
                        1.0f - (f - static_cast<float>(b));
                    image->pixels.view().at(c * bins + b + 1, x, y) += f - static_cast<float>(b);
                }
            image->pixels.view().at(3 * bins, x, y) = static_cast<float>(samples);
        }
    return image;
}

std::shared_ptr<MemoryImage> radiance_image(const Region& window, std::vector<std::string> names,
                                            unsigned seed)
{
    auto image = blank(window, std::move(names));
    std::mt19937 random(seed);
    // A black and a constant corner, so that shortcuts have something to skip.
    const Region black{window.x0, window.y0, window.x0 + 12, window.y0 + 12};
    const Region even{window.x1 - 14, window.y1 - 14, window.x1, window.y1};
    for (int y = window.y0; y < window.y1; ++y)
        for (int c = 0; c < image->desc.channel_count(); ++c)
            for (int x = window.x0; x < window.x1; ++x) {
                const bool alpha = image->desc.channels[static_cast<std::size_t>(c)] == "A";
                float& v = image->pixels.view().at(c, x, y);
                v = radiance(x, y, random);
                if (alpha) v = 0.25f + 0.75f * static_cast<float>(rest(std::int64_t{x} + y, 2));
                if (black.contains(x, y)) v = 0.0f;
                if (even.contains(x, y)) v = 0.5f;
            }
    return image;
}

std::vector<std::string> split_names(const std::string& text)
{
    std::vector<std::string> names(1);
    for (const char c : text) {
        if (c == ',')
            names.emplace_back();
        else if (c != ' ')
            names.back() += c;
    }
    return names;
}

} // namespace

RunRequest made_up_request(const Graph& graph, const Region& window, unsigned seed)
{
    RunRequest request;
    for (const GraphInput& input : graph.inputs) {
        if (input.kind == PortKind::deep) {
            // A graph that does without is held as it is without.
            if (input.required)
                request.inputs[input.name].deep =
                    std::make_shared<MemoryDeep>(made_up_deep(window, ++seed));
            continue;
        }
        const auto is = [&](const char* what) {
            return input.role == what || input.name == what ||
                   input.name.ends_with("_" + std::string(what));
        };
        std::vector<std::string> names{"R", "G", "B"};
        if (input.channels == "any" && input.kind == PortKind::image) names.push_back("A");
        if (input.name == "render") {
            names.clear();
            for (const char* layer : {"Combined", "DiffDir", "DiffInd", "DiffCol"})
                for (const char* c : {".R", ".G", ".B"}) names.push_back(layer + std::string(c));
        }
        if (input.channels != "any" && input.channels != "RGB") names = split_names(input.channels);
        InputBinding& binding = request.inputs[input.name];
        const int images = input.kind == PortKind::list ? list_length : 1;
        binding.is_list = input.kind == PortKind::list;
        for (int i = 0; i < images; ++i) {
            const unsigned image_seed = ++seed;
            if (is("histogram")) {
                binding.images.push_back(histogram_image(window, image_seed));
                continue;
            }
            auto image = radiance_image(window, names, image_seed);
            if (is("count")) image->pixels.fill(16.0f);
            const auto set = [&](const auto& value) {
                for (int c = 0; c < image->desc.channel_count(); ++c)
                    for (int y = window.y0; y < window.y1; ++y)
                        for (int x = window.x0; x < window.x1; ++x)
                            image->pixels.view().at(c, x, y) =
                                value(c, std::int64_t{x}, std::int64_t{y});
            };
            if (is("marked"))
                set([](int, auto x, auto y) { return rest(x * 5 + y * 3, 37) == 0 ? 1.0f : 0.0f; });
            // Objects where the regions of light are.
            if (is("boundary"))
                set([](int, auto x, auto y) { return rest(x + y, 29) % 14 == 0 ? 1.0f : 0.0f; });
            if (is("parts"))
                set([](int c, auto x, auto y) {
                    return c % 2 == 1 ? (c == 1 ? 1.0f : 0.0f) : rest(x + y, 29) < 14 ? 7.0f : 8.0f;
                });
            binding.images.push_back(std::move(image));
        }
    }
    for (const GraphParam& p : graph.params)
        if (p.info.required)
            throw Error("graph '" + graph.name + "' wants parameter '" + p.info.name + "'");
    return request;
}

} // namespace rayloom::test
