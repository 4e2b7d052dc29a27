// SPDX-License-Identifier: Apache-2.0
/// \file
/// The guides of fit.plane and fuse.planes in one padded image, so that their kernels read whole
/// vectors anywhere around a tile without asking where the image ends.
#pragma once

#include "nodes/fuse/planes_kernel.h"

#include <cstddef>
#include <vector>

namespace rayloom
{

/// Columns beyond the right edge that whole vectors may touch; at least a vector of any target.
constexpr int plane_tail = 64;
/// A pixel that lies on a boundary still has itself.
constexpr float plane_own_weight = 1e-3f;
/// Of a centre on a boundary: little beside others, but where there are no others it is all.
constexpr float plane_boundary_weight = 0.01f;

/// A pixel's planes are left out where a neighbour on the lattice gives others this share of what
/// the pixel would give them.
constexpr float plane_stand_in = 0.5f;

/// Where the columns of a row lie: those with the same remainder of x and `stride` one after the
/// other, so that centres of a lattice, and what is as far from each of them, are whole vectors.
struct PlaneColumns {
    int stride = 1;
    int x0 = 0;                 ///< first column, a multiple of the stride
    std::ptrdiff_t segment = 0; ///< from one remainder's columns to the next's

    int phase(int x) const { return (x - x0) % stride; }
    std::ptrdiff_t at(int x) const { return phase(x) * segment + (x - x0) / stride; }
    /// Place among the columns of `phase` of the first that is not left of x.
    int first(int phase, int x) const { return (x - x0 - phase + stride - 1) / stride; }
    /// The column there.
    int column(int phase, int place) const { return x0 + phase + stride * place; }
};

/// Guides around the centres, zeros outside the image.
struct PlaneScene {
    ImageBuffer pixels;
    Region area;  ///< of the pixels; `pixels` is wider
    Region known; ///< what of it there is in the image, and was asked for; zeros elsewhere
    PlaneColumns columns;
    int source = 0, normal = 0, parts = 0;          ///< first channels
    int z = 0, light = 0, variance = 0, weight = 0; ///< those of add_plane_light()
    int colours = 0;
    bool has_normal = false;
    bool lacks_normals = false; ///< some pixels have none; channel normal + 3 is 1 there
    int part_pairs = 0;
};

/// Guides over `part` grown by settings.max_radius, columns in their order: `source` is what a
/// centre's planes count, 1 away from boundaries. With `colours` there is room for what
/// add_plane_light() adds.
PlaneScene make_plane_scene(const PlaneSettings& settings, const Region& part, const Region& data,
                            const PlaneGuides& guides, int colours);
/// Adds z, its mean over the colours and its variance, and the pivot's root times e^−σ as `weight`.
void add_plane_light(PlaneScene& scene, const PlaneSettings& settings, const Region& data,
                     const PlaneGuides& guides);
/// Puts the columns where scene.columns says.
void separate_columns(PlaneScene& scene);
/// Copies n pixels of a row, the first in column x, to their places in `to`.
void separate_row(const PlaneColumns& columns, const float* from, int x, int n, float* to);
/// The other way round: n pixels from their places in `from`.
void join_row(const PlaneColumns& columns, const float* from, int x, int n, float* to);
/// For every phase the way from a column to the one dx away, dx from −reach to reach.
std::vector<std::ptrdiff_t> column_steps(const PlaneColumns& columns, int reach);
std::size_t plane_scene_bytes(const PlaneSettings& settings, int colours, int part_channels);

} // namespace rayloom
