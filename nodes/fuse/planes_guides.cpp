// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/planes_guides.h"

#include <string>

namespace rayloom
{

void PlaneGuidePorts::plan(PlanContext& context, int halo)
{
    for (const char* port : {"normal", "boundary", "parts"})
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
    return guides;
}

} // namespace rayloom
