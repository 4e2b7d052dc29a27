// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/channel_picks.h"

#include "rayloom/core/text.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <optional>

namespace rayloom
{
namespace
{

std::optional<float> read_number(std::string_view text)
{
    float value = 0.0f;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
    return value;
}

std::string_view trimmed(std::string_view text)
{
    while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
    while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
    return text;
}

std::string layer_label(const std::string& layer)
{
    return layer.empty() ? "(none: plain R, G, B)" : layer;
}

} // namespace

std::vector<ChannelPick> parse_channel_picks(std::span<const std::string> texts,
                                             std::span<const std::string> names,
                                             std::span<const int> indices)
{
    std::vector<ChannelPick> picks;
    for (const std::string& text : texts) {
        const std::size_t equals = text.find('=');
        const std::string_view left = trimmed(std::string_view(text).substr(0, equals));
        const std::string_view right =
            equals == std::string::npos ? left : trimmed(std::string_view(text).substr(equals + 1));
        if (left.empty() || right.empty())
            throw NodeError("cannot read the channel '" + text +
                            "'; write R, NEW=R or A=1 (a constant)");
        ChannelPick pick;
        pick.name = left;
        const auto it = std::find(names.begin(), names.end(), right);
        if (it != names.end()) {
            pick.source = indices[static_cast<std::size_t>(it - names.begin())];
        } else if (const auto number = read_number(right); number && equals != std::string::npos) {
            pick.constant = *number;
        } else {
            throw NodeError("there is no channel '" + std::string(right) + "'" +
                            suggestion(right, names));
        }
        for (const ChannelPick& other : picks)
            if (other.name == pick.name)
                throw NodeError("the channel '" + pick.name + "' is given twice");
        picks.push_back(std::move(pick));
    }
    if (picks.empty()) throw NodeError("the list of channels is empty");
    return picks;
}

void declare_picks(PlanContext& context, std::string_view output, std::size_t element,
                   std::span<const ChannelPick> picks)
{
    for (std::size_t i = 0; i < picks.size(); ++i)
        if (picks[i].source >= 0)
            context.pass_channel(output, static_cast<int>(i), "image", picks[i].source, element, 0);
}

std::vector<std::string> pick_names(std::span<const ChannelPick> picks)
{
    std::vector<std::string> names;
    for (const ChannelPick& pick : picks) names.push_back(pick.name);
    return names;
}

void copy_picks(const ConstImageView& in, std::span<const ChannelPick> picks, const ImageView& out)
{
    const Region& region = out.region();
    const auto n = static_cast<std::size_t>(region.width());
    for (int y = region.y0; y < region.y1; ++y)
        for (std::size_t i = 0; i < picks.size(); ++i) {
            float* to = out.row(static_cast<int>(i), y);
            if (picks[i].source < 0)
                std::fill_n(to, n, picks[i].constant);
            else
                std::memcpy(to, in.ptr(picks[i].source, region.x0, y), n * sizeof(float));
        }
}

std::vector<LayerChannels> layers_of(const ImageDesc& image)
{
    std::vector<LayerChannels> layers;
    for (int c = 0; c < image.channel_count(); ++c) {
        const std::string& full = image.channels[static_cast<std::size_t>(c)];
        const std::size_t dot = full.rfind('.');
        const std::string layer = dot == std::string::npos ? "" : full.substr(0, dot);
        auto it = std::find_if(layers.begin(), layers.end(),
                               [&](const LayerChannels& l) { return l.layer == layer; });
        if (it == layers.end()) it = layers.insert(layers.end(), LayerChannels{layer, {}, {}});
        it->indices.push_back(c);
        it->names.push_back(dot == std::string::npos ? full : full.substr(dot + 1));
    }
    return layers;
}

const LayerChannels* find_layer(std::span<const LayerChannels> layers, std::string_view wanted)
{
    for (const LayerChannels& layer : layers)
        if (layer.layer == wanted) return &layer;
    if (wanted.empty()) return nullptr;
    const std::string ending = "." + std::string(wanted);
    std::vector<std::string> candidates;
    const LayerChannels* found = nullptr;
    for (const LayerChannels& layer : layers)
        if (layer.layer.ends_with(ending)) {
            candidates.push_back(layer.layer);
            found = &layer;
        }
    if (candidates.size() > 1)
        throw NodeError("the layer '" + std::string(wanted) + "' could be " +
                        join_names(candidates, true) + "; write one of them in full");
    return found;
}

const LayerChannels& require_layer(std::span<const LayerChannels> layers, std::string_view wanted)
{
    if (const LayerChannels* layer = find_layer(layers, wanted)) return *layer;
    std::vector<std::string> names;
    for (const LayerChannels& layer : layers) names.push_back(layer_label(layer.layer));
    throw NodeError("the image has no layer '" + std::string(wanted) + "'" +
                    suggestion(wanted, names));
}

} // namespace rayloom
