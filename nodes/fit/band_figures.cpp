// SPDX-License-Identifier: Apache-2.0
#include "nodes/fit/band_figures.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

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
    // Eight partial sums keep several additions going, and give the same bits however wide vectors
    // are.
    constexpr std::size_t lanes = 8;
    constexpr float most = std::numeric_limits<float>::max();
    std::array<double, lanes> second{}, fourth{};
    std::array<float, lanes> greatest{};
    std::array<std::int32_t, lanes> zeros{};
    const auto add = [&](std::size_t k, float v) {
        const float size = std::fabs(v) <= most ? std::fabs(v) : 0.0f;
        const double square = static_cast<double>(size) * size;
        second[k] += square;
        fourth[k] += square * square;
        greatest[k] = size > greatest[k] ? size : greatest[k];
        zeros[k] += size == 0.0f;
    };
    const std::size_t n = values.size();
    std::size_t i = 0;
    for (; i + lanes <= n; i += lanes)
        for (std::size_t k = 0; k < lanes; ++k) add(k, values[i + k]);
    for (std::size_t k = 0; i < n; ++i, ++k) add(k, values[i]);
    sums[0] += static_cast<double>(n);
    for (std::size_t k = 0; k < lanes; ++k) {
        sums[0] -= zeros[k];
        sums[1] += second[k];
        sums[2] += fourth[k];
        sums[3] = std::max(sums[3], static_cast<double>(greatest[k]));
    }
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

namespace
{
/// Exponent and two bits of the mantissa number a bin; the first is that of 2^−24.
constexpr int bin_shift = 21;
constexpr std::int32_t first_bin = (127 - 24) << 2;
} // namespace

void SizeCounts::add(std::span<const float> values, std::span<double> sums)
{
    std::array<std::int32_t, size> counts{};
    for (const float v : values) {
        const auto bin = (std::bit_cast<std::int32_t>(std::fabs(v)) >> bin_shift) - first_bin;
        counts[static_cast<std::size_t>(std::clamp(bin, 0, static_cast<std::int32_t>(size) - 1))] +=
            v != 0.0f && std::isfinite(v);
    }
    for (std::size_t i = 0; i < size; ++i) sums[i] += counts[i];
}

double SizeCounts::median(std::span<const double> sums)
{
    double total = 0.0, below = 0.0;
    for (const double n : sums.first(size)) total += n;
    if (total == 0.0) return 0.0;
    std::size_t i = 0;
    while (i + 1 < size && below + sums[i] < 0.5 * total) below += sums[i++];
    return static_cast<double>(
        std::bit_cast<float>((first_bin + static_cast<std::int32_t>(i) + 1) << bin_shift));
}

double BandMoments::sampling_error() const
{
    if (!(count > 0.0) || !(second > 0.0)) return 0.0;
    return std::sqrt(std::max(kurtosis() - 1.0, 0.0) / count);
}

} // namespace rayloom
