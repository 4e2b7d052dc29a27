// SPDX-License-Identifier: Apache-2.0
/// \file
/// The guides of fit.plane and fuse.planes in one padded image, so that their kernels read whole
/// vectors anywhere around a tile without asking where the image ends.
#pragma once

#include "nodes/fuse/planes_kernel.h"

namespace rayloom
{

/// Columns beyond the right edge that whole vectors may touch; at least a vector of any target.
constexpr int plane_tail = 64;
/// A pixel that lies on a boundary still has itself.
constexpr float plane_own_weight = 1e-3f;

/// Planes of guides around the centres, zeros outside the image.
struct PlaneScene {
    ImageBuffer pixels;
    int z = 0, light = 0, variance = 0, source = 0, normal = 0, parts = 0; ///< first channels
    int colours = 0;
    bool has_normal = false;
    bool lacks_normals = false; ///< some pixels have none; channel normal + 3 is 1 there
    int part_pairs = 0;
};

/// Guides over `part` grown by `radius`: `source` is 1 away from boundaries.
PlaneScene make_plane_scene(int radius, const Region& part, const Region& data,
                            const PlaneGuides& guides, int colours);
/// Adds z, its mean over the colours and its variance; multiplies `source` by e^−σ.
void add_plane_light(PlaneScene& scene, const PlaneSettings& settings, const Region& data,
                     const PlaneGuides& guides);
std::size_t plane_scene_bytes(int radius, int colours, int part_channels);

} // namespace rayloom
