// SPDX-License-Identifier: Apache-2.0
/// \file
/// Which layers of a multi-layer image play which role, by the names in the renderer maps.
#pragma once

#include "nodes/transform/channel_picks.h"
#include "rayloom/image/renderer_map.h"

#include <string>
#include <string_view>
#include <vector>

namespace rayloom
{

/// The layers of an image read by role. Names alone decide: the image may come from anywhere.
class RenderRoles
{
public:
    /// \param renderer name of a map ("cycles"), or "auto": the map that knows most of the layers.
    /// Throws NodeError for a renderer nobody knows.
    RenderRoles(const ImageDesc& image, const std::string& renderer);

    const std::string& renderer() const { return m_map.name(); }
    /// Index in layers() of the first layer that plays the role, −1 when none does.
    int find(std::string_view role) const;
    /// Every layer that plays the role.
    std::vector<int> find_all(std::string_view role) const;
    const std::vector<LayerChannels>& layers() const { return m_layers; }

private:
    std::vector<LayerChannels> m_layers;
    RendererMap m_map;
};

/// One partial image: light by way of one kind of surface.
struct Lobe {
    std::string name;       ///< "diffuse", "glossy indirect", …
    std::vector<int> light; ///< layers that are added
    int pivot = -1;         ///< layer
    bool divided = false;   ///< the light layers were divided by the pivot
};

struct LobeChoice {
    std::string renderer = "auto";
    bool split = false; ///< direct and indirect light are partial images of their own
};

/// The partial images of a render that `layers` (every layer, in order, as transform.layers gives
/// them) holds. Black ones are left out and noted, and so are those without a pivot.
std::vector<Lobe> find_lobes(PlanContext& context, const LobeChoice& choice,
                             const RenderRoles& roles);

} // namespace rayloom
