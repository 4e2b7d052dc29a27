// SPDX-License-Identifier: Apache-2.0
/// \file
/// The guides that fit.plane and fuse.planes both take.
#pragma once

#include "nodes/fuse/planes_kernel.h"
#include "rayloom/core/registry.h"

#include <vector>

namespace rayloom
{

/// The colour channels as one view; they are neighbours in every image there is. Throws NodeError
/// when they are not.
int first_of_run(const std::vector<int>& channels, const char* port);

/// Ports `normal`, `boundary`, `parts` and `pivot` of a node.
class PlaneGuidePorts
{
public:
    template <class Params>
    static void declare(Declaration<Params>& d)
    {
        d.input("normal", "surface normal, 3 channels; zero where there is none").optional();
        d.input("boundary", "1 on boundaries of objects (threshold.boundary)").optional();
        d.input("parts", "pairs of id and coverage (transform.parts)").optional();
        d.input("pivot", "what `image` was divided by, an albedo: as many colour channels, or one")
            .optional();
    }
    /// Checks what is connected against `image`, and asks for `halo` around it. Notes what is
    /// absent.
    void plan(PlanContext& context, int halo);
    PlaneGuides views(const TileContext& context) const;
    int part_channels() const { return m_part_channels; }

private:
    int m_normal = 0; ///< first of three channels
    int m_part_channels = 0;
    int m_pivot = 0, m_pivots = 0;
};

} // namespace rayloom
