// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/posterior_mean.h"

#include <boost/math/quadrature/gauss_kronrod.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace rayloom::oracle
{

double posterior_mean(double y, double signal_s, double signal_p, double noise_s, double noise_p)
{
    const auto exponent = [&](double c) {
        return -std::pow(std::fabs(c / signal_s), signal_p) -
               std::pow(std::fabs((y - c) / noise_s), noise_p);
    };
    // Everything within 50 of the highest exponent lies in here.
    const double reach = 2.0 * std::fabs(y) + std::min(signal_s * std::pow(50.0, 1.0 / signal_p),
                                                       noise_s * std::pow(50.0, 1.0 / noise_p)) *
                                                  2.0;
    std::vector<double> edges{-reach, reach};
    for (const double cusp : {0.0, y}) {
        edges.push_back(cusp);
        for (double d = 1e-7 * std::min(signal_s, noise_s); d < reach; d *= 2.2)
            for (const double edge : {cusp - d, cusp + d})
                if (std::fabs(edge) < reach) edges.push_back(edge);
    }
    // A mode between the cusps can be narrower than any grid: edges close in on it.
    for (int i = 1; i < 60; ++i) edges.push_back(y * i / 60.0);
    double best = *std::ranges::max_element(edges, {}, exponent);
    for (double step = std::fabs(y) / 60.0; step > 1e-9 * std::fabs(y); step *= 0.5) {
        for (const double c : {best - step, best + step}) {
            edges.push_back(c);
            if (exponent(c) > exponent(best)) best = c;
        }
    }
    edges.push_back(best);
    std::ranges::sort(edges);
    const double top = exponent(best);
    double mass = 0.0, first = 0.0;
    using Rule = boost::math::quadrature::gauss_kronrod<double, 31>;
    for (std::size_t i = 1; i < edges.size(); ++i) {
        const double lo = edges[i - 1], hi = edges[i];
        if (hi <= lo || std::max(exponent(lo), exponent(hi)) < top - 60.0) continue;
        const auto weight = [&](double c) { return std::exp(exponent(c) - top); };
        mass += Rule::integrate(weight, lo, hi, 6, 1e-9);
        first += Rule::integrate([&](double c) { return c * weight(c); }, lo, hi, 6, 1e-9);
    }
    return first / mass;
}

} // namespace rayloom::oracle
