// SPDX-License-Identifier: Apache-2.0
/// \file
/// The guides that fit.plane and fuse.planes both take.
#pragma once

#include "nodes/fuse/planes_kernel.h"
#include "rayloom/core/registry.h"

#include <array>

namespace rayloom
{

/// Ports `normal`, `boundary` and `parts` of a node.
class PlaneGuidePorts
{
public:
    template <class Params>
    static void declare(Declaration<Params>& d)
    {
        d.input("normal", "surface normal, 3 channels; zero where there is none").optional();
        d.input("boundary", "1 on boundaries of objects (threshold.boundary)").optional();
        d.input("parts", "pairs of id and coverage (transform.parts)").optional();
    }
    /// Checks what is connected against `image`, and asks for `halo` around it. Notes what is
    /// absent.
    void plan(PlanContext& context, int halo);
    PlaneGuides views(const TileContext& context) const;
    int part_channels() const { return m_part_channels; }

private:
    int m_normal = 0; ///< first of three channels
    int m_part_channels = 0;
};

} // namespace rayloom
