// SPDX-License-Identifier: Apache-2.0
/// \file
/// The work of fit.plane and fuse.planes on planar float views: weighted planes through the squares
/// around pixels and through their quadrants, with a radius that grows until the noise is low
/// enough, and the weighted sum of all planes that cover a pixel (003_fb3ee135f07a6099.txt,
/// equations 10 to 13).
///
/// A lane is a centre (fit) or a written pixel (fuse), and all it does is in an order that depends
/// on nothing but the pixel: neither the region asked for nor the SIMD target changes a bit.
#pragma once

#include "rayloom/image/view.h"

#include <cstddef>
#include <functional>
#include <vector>

namespace rayloom
{

enum class PlaneRange {
    mean,  ///< |z − ⟨z⟩| / ⟨z⟩, as printed
    noise, ///< |z − ⟨z⟩| / (⟨z⟩ + standard deviation of z)
};
enum class PlaneBlend {
    min, ///< the quadrant's weight falls as the planes differ
    max, ///< the quadrant's weight grows as the planes differ, as printed
};

struct PlaneSettings {
    int min_radius = 2;  ///< 5×5 pixels
    int max_radius = 15; ///< at most max_plane_radius
    float growth = 0.5f; ///< share of the radius by which the next is larger; at least 1 pixel
    float range = 1.0f;  ///< k of equation 10
    PlaneRange range_scale = PlaneRange::mean;
    float target_noise = 0.02f; ///< relative standard error at which growing stops
    float max_noise = 8.0f;     ///< pixels with more relative noise are left out
    float variation = 0.3f;     ///< allowed relative difference of Z and a Z_m …
    float confidence = 2.0f;    ///< … beyond this many standard errors of Z_m
    PlaneBlend blend = PlaneBlend::max;
    int stride = 3; ///< of the centres that grow beyond `dense`, 1 to max_plane_stride
    int dense = 3;  ///< half-size up to which all centres grow, at least max_plane_stride − 1
};

constexpr int max_plane_radius = 64;
constexpr int max_plane_stride = 3;
/// Most (id, coverage) pairs of `parts` that are looked at.
constexpr int max_plane_parts = 6;

/// Guides of both stages; an empty view is one that is absent.
struct PlaneGuides {
    ConstImageView image;    ///< z: 1 or 3 channels
    ConstImageView variance; ///< of z: 1 channel, or one for each of z
    ConstImageView normal;   ///< 3 channels; zero or not finite: no normal
    ConstImageView boundary; ///< 1 channel, 0 to 1
    ConstImageView parts;    ///< pairs of id and coverage
    ConstImageView pivot;    ///< 1 channel, or one for each of z; a pixel counts by its root
    ConstImageView marked;   ///< one channel for each of z; not 0: z is no light there
};

/// Channels of the coefficient image: radius, relative noise, then for the square and its quadrants
/// (right-lower, left-lower, right-upper, left-upper; y grows downwards) a, b, c of each colour.
constexpr int plane_coefficients(int colours) { return 2 + 15 * colours; }

/// Pixels read around a centre beyond its square.
constexpr int plane_fit_reach(const PlaneSettings& s) { return s.max_radius + 2; }

/// The radii that are tried, one after the other.
std::vector<int> plane_radii(const PlaneSettings& settings);

std::size_t fit_planes_scratch(const PlaneSettings& settings, int colours, int part_channels);
std::size_t fuse_planes_scratch(const PlaneSettings& settings, int colours, int part_channels);

/// Fills `out` (plane_coefficients() channels). Inputs cover its region grown by plane_fit_reach(),
/// clipped to `data`. `each_row` may throw to stop.
/// \return sum of the radii chosen.
double fit_planes(const PlaneSettings& settings, const Region& data, const PlaneGuides& guides,
                  ImageView out, const std::function<void()>& each_row);

/// Fills `out` (1 or 3 channels) from coefficients and guides that cover its region grown by
/// max_radius, clipped to `data`. `guides.image`, `.variance` and `.marked` are not read.
void fuse_planes(const PlaneSettings& settings, const Region& data, ConstImageView coefficients,
                 const PlaneGuides& guides, ImageView out, const std::function<void()>& each_row);

} // namespace rayloom
