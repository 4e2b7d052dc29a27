// SPDX-License-Identifier: Apache-2.0
/// \file
/// Running mean and variance that never subtract two large sums.
#pragma once

#include <cstdint>

namespace rayloom
{

/// Count, mean and sum of squared deviations from the mean (Welford 1962). T is the type sums are
/// kept in: double unless memory forbids.
template <class T = double>
struct Moments {
    std::int64_t count = 0;
    T mean = 0;
    T deviations = 0; ///< Σ (x − mean)², never negative

    void add(T x)
    {
        ++count;
        const T before = x - mean;
        mean += before / static_cast<T>(count);
        deviations += before * (x - mean);
    }
    /// Adds the samples of another set (Chan, Golub, LeVeque 1979).
    void merge(const Moments& other)
    {
        if (other.count == 0) return;
        if (count == 0) {
            *this = other;
            return;
        }
        const T na = static_cast<T>(count), nb = static_cast<T>(other.count), n = na + nb;
        const T difference = other.mean - mean;
        mean += difference * (nb / n);
        deviations += other.deviations + difference * difference * (na * nb / n);
        count += other.count;
    }
    /// Unbiased sample variance; 0 for fewer than two samples.
    T variance() const { return count > 1 ? deviations / static_cast<T>(count - 1) : T{0}; }
    /// Variance of the mean: variance() / count.
    T variance_of_mean() const { return count > 1 ? variance() / static_cast<T>(count) : T{0}; }
};

} // namespace rayloom
