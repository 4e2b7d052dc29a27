// SPDX-License-Identifier: Apache-2.0
#include "tests/support/tiled_node.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <random>

namespace rayloom::node_test
{

TestImagePtr random_image(const Region& data, const Region& display,
                          std::vector<std::string> channels, unsigned seed)
{
    auto image = std::make_shared<TestImage>();
    image->desc.data = data;
    image->desc.display = display;
    image->desc.channels = std::move(channels);
    image->pixels = ImageBuffer(data, image->desc.channel_count());
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
    for (int y = data.y0; y < data.y1; ++y)
        for (int x = data.x0; x < data.x1; ++x)
            for (int c = 0; c < image->desc.channel_count(); ++c) {
                const float u = uniform(random), v = uniform(random);
                float value = 4.0f * v;
                if (u < 0.05f) value = -v;
                if (u > 0.97f) value = 300.0f * v;
                if (u > 0.4f && u < 0.42f) value = 0.0f;
                if (c == image->desc.alpha()) value = u < 0.2f ? 0.0f : u > 0.8f ? 1.0f : v;
                image->pixels.view().at(c, x, y) = value;
            }
    return image;
}

NodeRun run_node(std::string_view op, const ParamValues& params, const TestInputs& inputs,
                 int tile_width, int tile_height)
{
    std::vector<test::NodeInput> given;
    for (const auto& [port, images] : inputs) {
        test::NodeInput in;
        in.port = port;
        for (const TestImagePtr& image : images) in.images.push_back(image.get());
        given.push_back(std::move(in));
    }
    test::RunOptions options;
    if (tile_width > 0) options.tile_width = tile_width;
    if (tile_height > 0) options.tile_height = tile_height;
    test::NodeRun result = test::run_node(op, params, given, options);
    NodeRun run;
    run.plan = std::move(result.plan);
    run.counts = std::move(result.counted);
    for (auto& [port, images] : result.outputs)
        for (TestImage& image : images)
            run.outputs[port].push_back(std::make_shared<const TestImage>(std::move(image)));
    return run;
}

std::string difference(const TestImage& a, const TestImage& b, float tolerance)
{
    if (a.desc.channels != b.desc.channels) {
        std::string text = "channels:";
        for (const std::string& c : a.desc.channels) text += " " + c;
        text += " against";
        for (const std::string& c : b.desc.channels) text += " " + c;
        return text;
    }
    if (a.desc.data != b.desc.data)
        return "data window " + a.desc.data.text() + " against " + b.desc.data.text();
    if (a.desc.display != b.desc.display)
        return "display window " + a.desc.display.text() + " against " + b.desc.display.text();
    std::size_t count = 0;
    std::string first;
    float worst = 0.0f;
    for (int y = a.desc.data.y0; y < a.desc.data.y1; ++y)
        for (int x = a.desc.data.x0; x < a.desc.data.x1; ++x)
            for (int c = 0; c < a.desc.channel_count(); ++c) {
                const float va = a.pixels.view().at(c, x, y), vb = b.pixels.view().at(c, x, y);
                if (std::isnan(va) && std::isnan(vb)) continue;
                if (std::bit_cast<std::uint32_t>(va) == std::bit_cast<std::uint32_t>(vb)) continue;
                const float error = std::fabs(va - vb) / (1.0f + std::fabs(vb));
                if (tolerance > 0.0f && error <= tolerance) continue;
                worst = std::max(worst, error);
                if (count++ == 0)
                    first = a.desc.channels[static_cast<std::size_t>(c)] + " at (" +
                            std::to_string(x) + ", " + std::to_string(y) +
                            "): " + std::to_string(va) + " against " + std::to_string(vb);
            }
    if (count == 0) return {};
    return std::to_string(count) + " values differ, by up to " + std::to_string(worst) +
           "; first " + first;
}

} // namespace rayloom::node_test
