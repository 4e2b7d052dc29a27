// SPDX-License-Identifier: Apache-2.0
#include "nodes/transform/render_roles.h"

#include "rayloom/core/text.h"

#include <algorithm>

namespace rayloom
{

namespace
{

/// `*` stands for any characters.
bool matches(std::string_view text, std::string_view pattern)
{
    if (pattern.empty()) return text.empty();
    if (pattern[0] == '*') {
        for (std::size_t i = 0; i <= text.size(); ++i)
            if (matches(text.substr(i), pattern.substr(1))) return true;
        return false;
    }
    return !text.empty() && text[0] == pattern[0] && matches(text.substr(1), pattern.substr(1));
}

bool plays(const LayerChannels& layer, const std::string& pattern)
{
    if (pattern == "(plain)") return layer.layer.empty();
    if (layer.layer.empty()) return false;
    const std::size_t dot = layer.layer.rfind('.');
    const std::string_view pass =
        dot == std::string::npos ? layer.layer : std::string_view(layer.layer).substr(dot + 1);
    return matches(layer.layer, pattern) || matches(pass, pattern);
}

int find_layer_of(const std::vector<LayerChannels>& layers, const RoleRule* rule)
{
    if (!rule) return -1;
    for (const std::string& pattern : rule->layers)
        for (std::size_t i = 0; i < layers.size(); ++i)
            if (plays(layers[i], pattern)) return static_cast<int>(i);
    return -1;
}

RendererMap choose_map(const std::vector<LayerChannels>& layers, const std::string& renderer)
{
    const std::vector<RendererMap> maps = standard_renderer_maps();
    std::vector<std::string> names;
    const RendererMap* best = nullptr;
    int most = -1;
    for (const RendererMap& map : maps) {
        names.push_back(map.name());
        if (map.name() == renderer) return map;
        int known = 0;
        for (const auto& [role, doc] : renderer_roles())
            known += find_layer_of(layers, map.rule(role)) >= 0 ? 1 : 0;
        if (known > most) {
            most = known;
            best = &map;
        }
    }
    if (renderer != "auto")
        throw NodeError("there is no renderer map '" + renderer + "'" +
                        suggestion(renderer, names));
    return *best;
}

} // namespace

RenderRoles::RenderRoles(const ImageDesc& image, const std::string& renderer)
    : m_layers(layers_of(image)), m_map(choose_map(m_layers, renderer))
{
}

int RenderRoles::find(std::string_view role) const
{
    return find_layer_of(m_layers, m_map.rule(role));
}

std::vector<int> RenderRoles::find_all(std::string_view role) const
{
    std::vector<int> found;
    const RoleRule* rule = m_map.rule(role);
    if (!rule) return found;
    for (std::size_t i = 0; i < m_layers.size(); ++i)
        if (std::any_of(rule->layers.begin(), rule->layers.end(),
                        [&](const std::string& p) { return plays(m_layers[i], p); }))
            found.push_back(static_cast<int>(i));
    return found;
}

std::vector<Lobe> find_lobes(PlanContext& context, const LobeChoice& choice,
                             const RenderRoles& roles)
{
    if (context.count("layers") != roles.layers().size())
        throw NodeError("input 'layers' has " + std::to_string(context.count("layers")) +
                        " images, the render has " + std::to_string(roles.layers().size()) +
                        " layers; feed it with transform.layers of the same render");
    const auto black = [&](int layer) {
        return context.black("layers", static_cast<std::size_t>(layer));
    };
    std::vector<Lobe> lobes;
    std::optional<Lobe> black_one;
    for (const std::string kind : {"diffuse", "glossy", "transmission", "subsurface"}) {
        int pivot = roles.find(kind + "_color");
        // Only a renderer that writes a colour for each lobe (Cycles) divides its light by it.
        const bool divided = pivot >= 0 && roles.renderer() == "cycles";
        if (pivot < 0 && kind == "diffuse") pivot = roles.find("albedo");
        std::vector<Lobe> found;
        const int direct = roles.find(kind + "_direct"), indirect = roles.find(kind + "_indirect");
        const int whole = roles.find(kind);
        if (direct >= 0 && indirect >= 0) {
            if (choice.split) {
                found.push_back({kind + " direct", {direct}, pivot, divided});
                found.push_back({kind + " indirect", {indirect}, pivot, divided});
            } else {
                found.push_back({kind, {direct, indirect}, pivot, divided});
            }
        } else if (whole >= 0) {
            found.push_back({kind, {whole}, pivot, divided});
        }
        for (Lobe& lobe : found) {
            if (pivot < 0) {
                context.note(lobe.name + ": no pivot; stays in the remainder");
                continue;
            }
            Lobe lit = lobe;
            std::erase_if(lit.light, black);
            // Light that was divided by a black pivot is black once it is multiplied back.
            if (lit.light.empty() || (divided && black(pivot))) {
                context.note(lobe.name + ": black, skipped");
                if (!black_one) black_one = std::move(lobe);
                continue;
            }
            lobes.push_back(std::move(lit));
        }
    }
    // A list without images would stop the graph at the next node.
    if (lobes.empty() && black_one) lobes.push_back(std::move(*black_one));
    return lobes;
}

} // namespace rayloom
