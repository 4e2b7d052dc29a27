// SPDX-License-Identifier: Apache-2.0
#include "tests/support/tiled_node.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <random>
#include <stdexcept>

namespace rayloom::node_test
{
namespace
{

class Services final : public RunServices
{
public:
    explicit Services(NodeRun& run) : m_run(&run) {}
    bool cancelled() const noexcept override { return false; }
    bool may_skip() const noexcept override { return true; }
    void count_skip(std::string_view, std::size_t) override {}
    void count(std::string_view what, std::size_t n) override
    {
        m_run->counts[std::string(what)] += n;
    }

private:
    NodeRun* m_run;
};

} // namespace

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
    const NodeInfo* info = Registry::instance().find(op);
    if (!info) throw std::runtime_error("no node " + std::string(op));
    ParamValues checked;
    for (const auto& [name, value] : params) {
        const ParamInfo* param = info->param(name);
        if (!param) throw std::runtime_error("no parameter " + name);
        checked[name] = check_param(*param, value);
    }
    const std::unique_ptr<Node> node = info->create(checked);

    std::map<std::string, PlannedInput, std::less<>> planned;
    for (const PortInfo& port : info->inputs) {
        PlannedInput& in = planned[port.name];
        in.kind = port.kind;
        if (const auto it = inputs.find(port.name); it != inputs.end()) {
            in.connected = true;
            for (const TestImagePtr& image : it->second) in.images.push_back(image->desc);
        } else if (port.required) {
            throw std::runtime_error("input " + port.name + " is missing");
        }
    }
    PlanContext plan(planned);
    node->plan(plan);

    NodeRun run;
    run.plan = plan.result();
    Services services(run);
    const auto& first_descs = run.plan.outputs.begin()->second;
    for (std::size_t element = 0; element < first_descs.size(); ++element) {
        std::map<std::string, std::shared_ptr<TestImage>> results;
        for (const auto& [port, descs] : run.plan.outputs) {
            auto image = std::make_shared<TestImage>();
            image->desc = descs[element];
            image->pixels = ImageBuffer(image->desc.data, image->desc.channel_count());
            image->pixels.fill(-12345.0f);
            results[port] = image;
            run.outputs[port].push_back(image);
        }
        const Region all = first_descs[element].data;
        const int tw = tile_width > 0 ? tile_width : all.width();
        const int th = tile_height > 0 ? tile_height : all.height();
        for (int y = all.y0; y < all.y1; y += th)
            for (int x = all.x0; x < all.x1; x += tw) {
                const Region region = Region{x, y, x + tw, y + th}.intersect(all);
                // Copies of just the needed pixels: a read beyond them is out of bounds.
                std::vector<std::vector<ConstImageView>> views;
                std::vector<ImageBuffer> copies;
                std::vector<TileContext::Input> tile_inputs;
                views.reserve(inputs.size());
                for (const auto& [port, images] : inputs) {
                    views.emplace_back();
                    const auto need = run.plan.needs.find(port);
                    for (std::size_t i = 0; i < images.size(); ++i) {
                        const Region wanted =
                            (need == run.plan.needs.end() ? region
                                                          : need->second({i, element, region}))
                                .intersect(images[i]->desc.data);
                        if (wanted.empty()) {
                            views.back().emplace_back();
                            continue;
                        }
                        ImageBuffer copy(wanted, images[i]->desc.channel_count());
                        copy_pixels(images[i]->pixels.view().crop(wanted), copy.view());
                        views.back().push_back(copy.view());
                        copies.push_back(std::move(copy));
                    }
                    tile_inputs.push_back({port, views.back(), {}, nullptr});
                }
                std::vector<TileContext::Output> tile_outputs;
                for (const auto& [port, image] : results)
                    tile_outputs.push_back({port, image->pixels.view().crop(region)});
                node->compute(TileContext(region, element, tile_inputs, tile_outputs, services));
            }
    }
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
