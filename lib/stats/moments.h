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

/// Power sums about the mean up to the fourth, for fits by moments (Pébay 2008).
struct Moments4 {
    std::int64_t count = 0;
    double mean = 0.0;
    double m2 = 0.0, m3 = 0.0, m4 = 0.0; ///< Σ (x − mean)^k

    void add(double x)
    {
        Moments4 one;
        one.count = 1;
        one.mean = x;
        merge(one);
    }
    void merge(const Moments4& other)
    {
        if (other.count == 0) return;
        if (count == 0) {
            *this = other;
            return;
        }
        const double na = static_cast<double>(count), nb = static_cast<double>(other.count);
        const double n = na + nb, d = other.mean - mean, dn = d / n;
        m4 += other.m4 + d * dn * dn * dn * na * nb * (na * na - na * nb + nb * nb) +
              6.0 * dn * dn * (na * na * other.m2 + nb * nb * m2) +
              4.0 * dn * (na * other.m3 - nb * m3);
        m3 += other.m3 + d * dn * dn * na * nb * (na - nb) + 3.0 * dn * (na * other.m2 - nb * m2);
        m2 += other.m2 + d * dn * na * nb;
        mean += nb * dn;
        count += other.count;
    }
    /// Mean of (x − mean)^2 and of (x − mean)^4.
    double second() const { return count > 0 ? m2 / static_cast<double>(count) : 0.0; }
    double fourth() const { return count > 0 ? m4 / static_cast<double>(count) : 0.0; }
};

} // namespace rayloom
