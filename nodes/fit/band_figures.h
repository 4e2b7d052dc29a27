// SPDX-License-Identifier: Apache-2.0
/// \file
/// What the nodes that fit distributions to bands share: moments of a band, and the columns of the
/// tables they hand on (one row a channel).
#pragma once

#include "nodes/multiscale/steerable_kernel.h"
#include "rayloom/core/table.h"
#include "rayloom/stats/posterior_mean.h"

#include <span>

namespace rayloom
{

/// Columns "s_n" and "p_n": the noise of a band's channel.
GeneralisedLaplacian noise_of(const Table& figures, std::size_t channel);
/// Columns "s_c" and "p_c": the signal of a band's channel.
GeneralisedLaplacian signal_of(const Table& figures, std::size_t channel);

/// The part of a band that lies over the image, without the margin that only mirrors it.
Region over_image(const SteerableBand& band, const Region& window);

/// Sums over values v that are zero in the mean: Σ1, Σv², Σv⁴, max |v|. Values that are exactly
/// zero are not counted: they are flat parts of the image (a black background), where there is
/// nothing to tell signal from noise by; nor are values that are not finite.
struct BandMoments {
    static constexpr std::size_t size = 4;
    static void add(std::span<const float> values, std::span<double> sums);
    static void combine(std::span<double> into, std::span<const double> other);

    explicit BandMoments(std::span<const double> sums);
    double count, second, fourth, greatest; ///< second and fourth: means, 0 when count is
    double kurtosis() const { return second > 0.0 ? fourth / second / second : 0.0; }
    /// Relative standard error of `second` as an estimate of the variance.
    double sampling_error() const;
};

/// Counts of values by size, those that are exactly zero or not finite not counted: four bins an
/// octave from 2^−24 to 2^8.
struct SizeCounts {
    static constexpr std::size_t size = 128;
    static void add(std::span<const float> values, std::span<double> sums);
    /// The upper end of the bin that the median of the sizes lies in; 0 when there are none.
    static double median(std::span<const double> sums);
};

} // namespace rayloom
