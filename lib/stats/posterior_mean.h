// SPDX-License-Identifier: Apache-2.0
/// \file
/// A signal seen through noise, both generalised Laplacians: the signal's fit, and its mean given
/// what is seen (001_6a300dc64642895d.txt, equations (7)-(18)).
#pragma once

#include "rayloom/stats/generalised_laplacian.h"
#include "rayloom/stats/posterior_kernel.h"

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace rayloom
{

/// Shapes are kept in this range: outside of it the fourth moment of any image says next to
/// nothing about p.
inline constexpr double least_shape = 0.3;
inline constexpr double greatest_shape = 4.0;

enum class SignalStatus {
    fitted,     ///< both moments are met
    shape_low,  ///< tails longer than p = 0.3 gives: p clamped, s meets the second moment
    shape_high, ///< tails shorter than p = 4 gives: p clamped, s meets the second moment
    no_signal,  ///< nothing is left after the noise's second moment is taken away: s = 0
};
/// "fitted", "shape at 0.3", "shape at 4", "all noise".
std::string to_string(SignalStatus status);

struct SignalFit {
    GeneralisedLaplacian density{0.0, 2.0};
    SignalStatus status = SignalStatus::no_signal;
};
/// The distribution of c in y = c + n from the moments of y and the distribution of the
/// independent noise n (s = 0: none), equation (12). `sampling_error` is the relative standard
/// error of `second`: less than that much signal cannot be told from none.
SignalFit fit_signal(double second, double fourth, const GeneralisedLaplacian& noise,
                     double sampling_error = 0.0);

/// Posterior mean ĉ(y) = ∫ p_n(y−c) p_c(c) c dc / ∫ p_n(y−c) p_c(c) dc, equation (11), by adaptive
/// Gauss–Kronrod quadrature of the integrand scaled by its maximum, split at its cusps (0 and y)
/// and at its modes. Error ≤ 1e-6 s_n for p in [0.3, 4].
double posterior_mean(double y, const GeneralisedLaplacian& signal,
                      const GeneralisedLaplacian& noise);

/// The posterior mean as a function that costs a few operations a call: cubics between samples
/// that lie evenly in each octave of |y|, as many as the tolerance asks for.
class PosteriorMeanTable
{
public:
    /// The identity.
    PosteriorMeanTable() = default;
    /// Good for |y| ≤ greatest; the error of operator() is at most 1e-4 s_n + 1e-7 |y| there. Half
    /// of the first may be interpolation, the second is that of a float.
    PosteriorMeanTable(const GeneralisedLaplacian& signal, const GeneralisedLaplacian& noise,
                       double greatest);

    /// ĉ(y). Odd. Beyond `greatest` what is taken away from |y| stays what it was there.
    float operator()(float y) const;
    /// The same for a row; `out` may be `in`.
    void apply(std::span<const float> in, std::span<float> out) const;

    bool identity() const { return m_kind == Kind::identity; }
    bool zero() const { return m_kind == Kind::zero; }
    std::size_t samples() const { return m_cubics.size(); }

private:
    enum class Kind { identity, zero, table };
    Kind m_kind = Kind::identity;
    CubicTable m_table; ///< its span is filled in where it is used
    std::vector<CubicTable::Cubic> m_cubics;
};

} // namespace rayloom
