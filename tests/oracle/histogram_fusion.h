// SPDX-License-Identifier: Apache-2.0
/// \file
/// Ray histogram fusion written plainly from its equations (004_ae1655312894f2a2.txt, Algorithms 1
/// and 2): every patch pair pixel by pixel and bin by bin. Slow on purpose. `Real` is double for
/// the oracle and float for the plain version speed is compared with.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace rayloom::oracle
{

/// Pixels [y][x][channel].
template <class Real>
struct Raster {
    Raster() = default;
    Raster(int w, int h, int c)
        : width(w), height(h), channels(c),
          values(static_cast<std::size_t>(w) * static_cast<std::size_t>(h) *
                 static_cast<std::size_t>(c))
    {
    }
    Real& at(int c, int x, int y) { return values[index(c, x, y)]; }
    Real at(int c, int x, int y) const { return values[index(c, x, y)]; }

    int width = 0, height = 0, channels = 0;
    std::vector<Real> values;

private:
    std::size_t index(int c, int x, int y) const
    {
        return (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                static_cast<std::size_t>(x)) *
                   static_cast<std::size_t>(channels) +
               static_cast<std::size_t>(c);
    }
};

struct FusionSettings {
    double kappa = 1.0;
    int window_radius = 6; ///< b of the paper
    int patch_radius = 1;  ///< w of the paper
    int min_patches = 0;   ///< nearest patches kept besides the patch itself
};

/// Pooled χ² of two patches and the number of bins that entered it (equations 3 and 4).
template <class Real>
struct PatchDistance {
    Real sum = 0;
    int bins = 0;
};

/// Distance of the patches of half-size `radius` centred on (x, y) and (x + dx, y + dy); the last
/// channel of `histogram` is the sample count.
template <class Real>
PatchDistance<Real> patch_distance(const Raster<Real>& histogram, int x, int y, int dx, int dy,
                                   int radius);

/// Algorithm 1. `alpha` is the index of the alpha channel of `image`, −1 when it has none.
/// `matches`, when given, receives the number of accepted patches per pixel, its own included.
template <class Real>
Raster<Real> fuse_histogram(const Raster<Real>& image, const Raster<Real>& histogram,
                            const FusionSettings& settings, int alpha = -1,
                            Raster<Real>* matches = nullptr);

/// D_s: Gaussian of 0.55·√(4^s − 1) px sampled at the centres of 2^s × 2^s blocks.
Raster<double> downsample(const Raster<double>& image, int s);
/// Multiplies every channel by (sum of the last channel of `full`) / (its own sum of it).
void conserve_count(const Raster<double>& full, Raster<double>& level);
/// U: Keys' bicubic to a given size.
Raster<double> upsample(const Raster<double>& image, int width, int height);
enum class RecombineLimit { none, range, share };
/// Algorithm 2, lines 7 to 9, from the coarsest level to the finest. Not in the paper: with `share`
/// coarse pixel k gives pixel x no more than min(1, 2·u(x) / D(u)(k)) of its change; with `range`
/// and `share` each value is brought between those of the 3 × 3 pixels of u around it and the
/// 4 × 4 of the coarser result it is interpolated from.
Raster<double> recombine(std::span<const Raster<double>> levels,
                         RecombineLimit limit = RecombineLimit::none);

/// Adds one colour sample to a histogram of `bins` bins a channel and a count.
void add_sample(std::span<double> histogram, std::span<const double> colour, int bins, double gamma,
                double max_value);

} // namespace rayloom::oracle
