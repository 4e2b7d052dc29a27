// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/quantiles.h"

#include "rayloom/core/error.h"

#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

#include <algorithm>
#include <string>

namespace rayloom
{

namespace
{
void check_alpha(double alpha)
{
    if (!(alpha > 0.0 && alpha < 1.0))
        throw NodeError("alpha must lie between 0 and 1 (0.01 is a confidence of 99 %), not " +
                        std::to_string(alpha));
}
} // namespace

double student_t_factor(double samples, double alpha)
{
    check_alpha(alpha);
    if (!(samples >= 2.0))
        throw NodeError("one sample has no confidence interval; render at least two samples per "
                        "pixel with separate statistics");
    const boost::math::students_t distribution(samples - 1.0);
    return boost::math::quantile(boost::math::complement(distribution, 0.5 * alpha));
}

StudentTable::StudentTable(double alpha, int max_samples) : m_alpha(alpha)
{
    check_alpha(alpha);
    if (max_samples < 2) throw NodeError("a table of Student factors needs at least two samples");
    m_factors.reserve(static_cast<std::size_t>(max_samples) - 1);
    for (int n = 2; n <= max_samples; ++n) m_factors.push_back(student_t_factor(n, alpha));
}

double welch_degrees(double a, double n_a, double b, double n_b)
{
    const double sum = a + b;
    if (!(sum > 0.0)) return std::min(n_a, n_b) - 1.0;
    const double pa = a / sum, pb = b / sum;
    return 1.0 / (pa * pa / (n_a - 1.0) + pb * pb / (n_b - 1.0));
}

double normal_quantile(double p)
{
    check_alpha(p);
    return boost::math::quantile(boost::math::normal(), p);
}

double chi_squared_quantile(double p, double degrees)
{
    if (!(degrees > 0.0)) throw NodeError("χ² needs more than zero degrees of freedom");
    if (!(p >= 0.0 && p < 1.0)) throw NodeError("a probability below 1 is needed for a quantile");
    return boost::math::quantile(boost::math::chi_squared(degrees), p);
}

double chi_squared_tail(double x, double degrees)
{
    if (!(degrees > 0.0)) throw NodeError("χ² needs more than zero degrees of freedom");
    return boost::math::cdf(
        boost::math::complement(boost::math::chi_squared(degrees), std::max(x, 0.0)));
}

} // namespace rayloom
