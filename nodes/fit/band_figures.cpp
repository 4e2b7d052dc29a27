// SPDX-License-Identifier: Apache-2.0
#include "nodes/fit/band_figures.h"

#include <algorithm>
#include <cmath>

namespace rayloom
{

GeneralisedLaplacian noise_of(const Table& figures, std::size_t channel)
{
    return {figures.number("s_n", channel), figures.number("p_n", channel)};
}

GeneralisedLaplacian signal_of(const Table& figures, std::size_t channel)
{
    return {figures.number("s_c", channel), figures.number("p_c", channel)};
}

Region over_image(const SteerableBand& band, const Region& window)
{
    const Halo halo = steerable_halo(band);
    return {window.x0 + halo.left, window.y0 + halo.up, window.x1 - halo.right,
            window.y1 - halo.down};
}

void BandMoments::add(std::span<const float> values, std::span<double> sums)
{
    double second = 0.0, fourth = 0.0;
    float greatest = 0.0f;
    for (const float v : values) {
        const double square = static_cast<double>(v) * v;
        second += square;
        fourth += square * square;
        greatest = std::max(greatest, std::fabs(v));
    }
    sums[0] += static_cast<double>(values.size());
    sums[1] += second;
    sums[2] += fourth;
    sums[3] = std::max(sums[3], static_cast<double>(greatest));
}

void BandMoments::add_difference(std::span<const float> a, std::span<const float> b, float scale,
                                 std::span<double> sums)
{
    double second = 0.0, fourth = 0.0;
    float greatest = 0.0f;
    for (std::size_t i = 0; i < a.size(); ++i) {
        const float v = scale * (a[i] - b[i]);
        const double square = static_cast<double>(v) * v;
        second += square;
        fourth += square * square;
        greatest = std::max(greatest, std::fabs(v));
    }
    sums[0] += static_cast<double>(a.size());
    sums[1] += second;
    sums[2] += fourth;
    sums[3] = std::max(sums[3], static_cast<double>(greatest));
}

void BandMoments::combine(std::span<double> into, std::span<const double> other)
{
    for (std::size_t i = 0; i < into.size(); ++i)
        into[i] = i % size == 3 ? std::max(into[i], other[i]) : into[i] + other[i];
}

BandMoments::BandMoments(std::span<const double> sums)
    : count(sums[0]), second(count > 0.0 ? sums[1] / count : 0.0),
      fourth(count > 0.0 ? sums[2] / count : 0.0), greatest(sums[3])
{
}

double BandMoments::sampling_error() const
{
    if (!(count > 0.0) || !(second > 0.0)) return 0.0;
    return std::sqrt(std::max(fourth / second / second - 1.0, 0.0) / count);
}

} // namespace rayloom
