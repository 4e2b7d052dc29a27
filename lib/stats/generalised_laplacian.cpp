// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/generalised_laplacian.h"

#include "rayloom/core/error.h"

#include <boost/math/special_functions/gamma.hpp>
#include <boost/math/tools/roots.hpp>

#include <cmath>
#include <cstdint>

namespace rayloom
{

namespace
{
// Γ(1/p) overflows for small p, ratios of Γ do not: everything goes through logarithms. Not
// std::lgamma, which writes to a global.
double log_gamma(double x) { return boost::math::lgamma(x); }
} // namespace

double GeneralisedLaplacian::variance() const
{
    return s * s * std::exp(log_gamma(3.0 / p) - log_gamma(1.0 / p));
}

double GeneralisedLaplacian::fourth_moment() const
{
    return s * s * s * s * std::exp(log_gamma(5.0 / p) - log_gamma(1.0 / p));
}

double GeneralisedLaplacian::log_density(double x) const
{
    return -std::pow(std::abs(x / s), p) - std::log(2.0 * s / p) - log_gamma(1.0 / p);
}

double GeneralisedLaplacian::probability_within(double x) const
{
    return boost::math::gamma_p(1.0 / p, std::pow(x / s, p));
}

double generalised_laplacian_kurtosis(double p)
{
    return std::exp(log_gamma(5.0 / p) + log_gamma(1.0 / p) - 2.0 * log_gamma(3.0 / p));
}

GeneralisedLaplacianFit fit_generalised_laplacian(double variance, double fourth_moment,
                                                  double min_p, double max_p)
{
    if (!(variance > 0.0 && fourth_moment > 0.0 && std::isfinite(variance) &&
          std::isfinite(fourth_moment)))
        throw NodeError("a generalised Laplacian needs a positive variance and fourth moment");
    const double wanted = std::log(fourth_moment) - 2.0 * std::log(variance);
    const auto excess = [wanted](double log_p) {
        return std::log(generalised_laplacian_kurtosis(std::exp(log_p))) - wanted;
    };
    GeneralisedLaplacianFit fit;
    double& p = fit.density.p;
    const double low = std::log(min_p), high = std::log(max_p);
    const double at_low = excess(low), at_high = excess(high);
    if (at_low <= 0.0) { // heavier tails than the smallest shape has
        p = min_p;
        fit.clamped = at_low < 0.0;
    } else if (at_high >= 0.0) {
        p = max_p;
        fit.clamped = at_high > 0.0;
    } else {
        std::uintmax_t steps = 100;
        const auto [a, b] =
            boost::math::tools::toms748_solve(excess, low, high, at_low, at_high,
                                              boost::math::tools::eps_tolerance<double>(48), steps);
        p = std::exp(0.5 * (a + b));
    }
    fit.density.s = 1.0;
    fit.density.s = std::sqrt(variance / fit.density.variance());
    return fit;
}

} // namespace rayloom
