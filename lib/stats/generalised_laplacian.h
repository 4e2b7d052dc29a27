// SPDX-License-Identifier: Apache-2.0
/// \file
/// The generalised Laplacian f(x; s, p) = exp(−|x/s|^p) / Z, Z = 2(s/p)Γ(1/p), of
/// 001_6a300dc64642895d.txt: its moments and its fit by moments (MATH.md, section 3).
#pragma once

namespace rayloom
{

struct GeneralisedLaplacian {
    double s = 1.0; ///< scale, > 0
    double p = 2.0; ///< shape, > 0; 2 is Gaussian with σ = s/√2, 1 is Laplacian

    /// E x² = s²Γ(3/p)/Γ(1/p).
    double variance() const;
    /// E x⁴ = s⁴Γ(5/p)/Γ(1/p).
    double fourth_moment() const;
    /// Natural logarithm of the density at x.
    double log_density(double x) const;
    /// P(|X| ≤ x), x ≥ 0.
    double probability_within(double x) const;
};

/// E x⁴ / (E x²)² = Γ(5/p)Γ(1/p)/Γ(3/p)²: falls from ∞ at p → 0 to 9/5 at p → ∞; 3 at p = 2.
double generalised_laplacian_kurtosis(double p);

/// A fit and whether its shape had to be cut to the allowed range.
struct GeneralisedLaplacianFit {
    GeneralisedLaplacian density;
    bool clamped = false;
};

/// The density with the given second and fourth moments, shape cut to [min_p, max_p]; the second
/// moment is always met. Throws NodeError unless both moments are positive and finite.
GeneralisedLaplacianFit fit_generalised_laplacian(double variance, double fourth_moment,
                                                  double min_p = 0.3, double max_p = 4.0);

} // namespace rayloom
