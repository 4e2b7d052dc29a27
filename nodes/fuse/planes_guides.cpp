// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/planes_guides.h"

#include "rayloom/core/colour_channels.h"

#include <string>

namespace rayloom
{

int first_of_run(const std::vector<int>& channels, const char* port)
{
    for (std::size_t i = 1; i < channels.size(); ++i)
        if (channels[i] != channels[0] + static_cast<int>(i))
            throw NodeError("the colour channels of input '" + std::string(port) +
                            "' must stand together and in order; take them with "
                            "transform.layer first");
    return channels[0];
}

void PlaneGuidePorts::plan(PlanContext& context, int halo)
{
    for (const char* port : {"normal", "boundary", "parts", "pivot"})
        if (context.has(port)) {
            context.require_same_window("image", port);
            context.needs(port, Halo::all(halo));
        }
    if (context.has("normal")) {
        const ImageDesc& normal = context.input("normal");
        m_normal = normal.channel("X") >= 0 ? normal.channel("X") : 0;
        if (m_normal + 3 > normal.channel_count())
            throw NodeError("input 'normal' has " + std::to_string(normal.channel_count()) +
                            " channels; a normal has three, X, Y and Z");
    }
    if (context.has("pivot")) {
        matching_colours(context, "image", "pivot", ColourCount::same_or_one);
        const std::vector<int> colours = context.input("pivot").colour();
        m_pivot = first_of_run(colours, "pivot");
        m_pivots = static_cast<int>(colours.size());
    }
    if (!context.has("parts")) {
        context.note("no parts: every pixel may share with every other (weight 1)");
        return;
    }
    m_part_channels = context.input("parts").channel_count();
    if (m_part_channels < 2 || m_part_channels % 2 != 0)
        throw NodeError("input 'parts' has " + std::to_string(m_part_channels) +
                        " channels; pairs of id and coverage are needed (transform.parts)");
}

PlaneGuides PlaneGuidePorts::views(const TileContext& context) const
{
    PlaneGuides guides;
    if (context.has("normal")) guides.normal = context.input("normal").channel_range(m_normal, 3);
    if (context.has("boundary")) guides.boundary = context.input("boundary");
    if (context.has("parts")) guides.parts = context.input("parts");
    if (context.has("pivot"))
        guides.pivot = context.input("pivot").channel_range(m_pivot, m_pivots);
    return guides;
}

} // namespace rayloom
