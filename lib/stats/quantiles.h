// SPDX-License-Identifier: Apache-2.0
/// \file
/// Quantiles that thresholds are made of.
#pragma once

#include <vector>

namespace rayloom
{

/// t_{α/2, n−1}: half-width, in standard errors of the mean, of the two-sided confidence interval
/// of level 1 − α from n samples. Throws NodeError unless n ≥ 2 and 0 < α < 1.
double student_t_factor(double samples, double alpha);

/// student_t_factor() of one α for many n, built once. Immutable, so any thread may read it.
class StudentTable
{
public:
    /// Throws NodeError unless 0 < alpha < 1 and max_samples ≥ 2.
    StudentTable(double alpha, int max_samples);

    double alpha() const { return m_alpha; }
    /// Factor for n samples; n is cut to [2, max_samples] (beyond it the factor only falls
    /// towards the normal quantile, so the interval stays on the wide side).
    double operator()(int n) const
    {
        const int last = static_cast<int>(m_factors.size()) + 1;
        return m_factors[static_cast<std::size_t>((n < 2 ? 2 : n > last ? last : n) - 2)];
    }
    /// The factors of n = 2, 3, … as floats, for kernels.
    std::vector<float> as_floats() const { return {m_factors.begin(), m_factors.end()}; }

private:
    double m_alpha;
    std::vector<double> m_factors;
};

/// Degrees of freedom of the difference of two means (Welch–Satterthwaite). `a` and `b` are the
/// variances of the means, each estimated from n_a or n_b ≥ 2 samples. With a + b = 0 the smaller
/// of n_a − 1 and n_b − 1.
double welch_degrees(double a, double n_a, double b, double n_b);

/// Quantile of the normal distribution. Throws NodeError unless 0 < p < 1.
double normal_quantile(double p);

/// x with P(χ²_k ≤ x) = p. Throws NodeError unless k > 0 and 0 ≤ p < 1.
double chi_squared_quantile(double p, double degrees);
/// P(χ²_k > x): how likely a distance of at least x is between equal distributions.
double chi_squared_tail(double x, double degrees);

} // namespace rayloom
