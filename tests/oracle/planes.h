// SPDX-License-Identifier: Apache-2.0
/// \file
/// The pivot-image filter in plain double, written from equations 10 to 13 of
/// 003_fb3ee135f07a6099.txt, one pixel and one plane at a time.
#pragma once

#include "tests/oracle/histogram_fusion.h"

#include <array>
#include <optional>

namespace rayloom::oracle
{

struct PlaneOptions {
    int min_radius = 2, max_radius = 15;
    double growth = 0.5;
    double range = 1.0;
    bool range_by_noise = false;
    double target_noise = 0.02, max_noise = 8.0, variation = 0.3, confidence = 2.0;
    bool blend_max = false;
    int stride = 3, dense = 3;
};

struct PlaneInput {
    Raster<double> z, variance;
    std::optional<Raster<double>> normal, boundary, parts, pivot;
    int x0 = 0, y0 = 0; ///< coordinates of the first pixel: the lattice begins at 0
};

/// Of one centre: the square, then quadrants right-lower, left-lower, right-upper, left-upper; each
/// colour's a, b, c. The radius is 0 where the centre may not grow on: it has itself alone.
struct CentrePlanes {
    int radius = 0;
    double noise = 0.0;
    std::array<std::vector<std::array<double, 3>>, 5> planes;
};

/// Whether a centre may grow beyond options.dense: it lies on the lattice, or none of the (up to
/// four) nearest on it gives others half of what it would.
bool grows_on(const PlaneInput& in, const PlaneOptions& options, int x, int y);
/// w_n · w_part of two pixels.
double guide_weight(const PlaneInput& in, int x, int y, int u, int v);
CentrePlanes fit_centre(const PlaneInput& in, const PlaneOptions& options, int x, int y);
/// What a plane of one size is made of: its system, and both answers to it without any guard.
struct PlaneSystem {
    /// Largest over smallest eigenvalue of Σ w (x, y, 1)ᵀ(x, y, 1), in pixels.
    double condition = 0.0;
    /// How wide the pixels are spread, over what a plane asks for: below 1 the mean takes its
    /// place.
    double spread = 0.0;
    std::vector<std::array<double, 3>> plane; ///< a, b, c of each colour, solved in long double
    std::vector<double> mean;                 ///< weighted, of each colour
};
/// Of the square and the quadrants around one centre, as in CentrePlanes.
std::array<PlaneSystem, 5> plane_systems(const PlaneInput& in, const PlaneOptions& options, int x,
                                         int y, int radius);
/// All centres, row by row.
std::vector<CentrePlanes> fit_all(const PlaneInput& in, const PlaneOptions& options);
Raster<double> fuse_all(const PlaneInput& in, const PlaneOptions& options,
                        const std::vector<CentrePlanes>& centres);

} // namespace rayloom::oracle
