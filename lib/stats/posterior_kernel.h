// SPDX-License-Identifier: Apache-2.0
/// \file
/// The inner loops of the posterior mean: its integrand, many points at a time, and reading the
/// tabulated function. The same bits on every SIMD target.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace rayloom
{

/// The integrand's exponent g(c) = −|c/a|^p_c − |y−c|^p_n in units of s_n, y ≥ 0.
struct PosteriorExponent {
    double y, inverse_a, signal_p, noise_p;
};
/// g of each c; relative error of the powers 1e-13.
void posterior_exponents(const PosteriorExponent& exponent, std::span<const double> c,
                         std::span<double> g);

/// Kronrod's rule of 15 points and the Gauss rule of 7 inside it, over one interval.
struct PosteriorInterval {
    double lo = 0.0, hi = 0.0;
    double mass = 0.0, first = 0.0;             ///< ∫ e^(g − peak), ∫ c e^(g − peak)
    double mass_error = 0.0, first_error = 0.0; ///< Kronrod − Gauss
};
PosteriorInterval posterior_interval(const PosteriorExponent& exponent, double peak, double lo,
                                     double hi);

/// A function of |y| given by cubics: 2^shift segments in each octave of |y|/scale, so that the
/// leading bits of |y|/scale are the number of a segment.
struct CubicTable {
    /// One segment: value/scale as a cubic of the place t ∈ [0, 1) in it.
    struct Cubic {
        float c0, c1, c2, c3;
    };
    float scale = 1.0f, inverse_scale = 1.0f;
    int shift = 0;
    int first_exponent = 0; ///< the first octave begins at 2^first_exponent
    float slope = 1.0f;     ///< value/y below it
    float end = 0.0f;       ///< of the last octave
    float end_loss = 0.0f;  ///< beyond it, what is taken away from y/scale
    std::span<const Cubic> cubics;
};
/// The function of each value, odd and at most |y|; `out` may be `in`.
void read_cubic_table(const CubicTable& table, std::span<const float> in, std::span<float> out);

} // namespace rayloom
