// SPDX-License-Identifier: Apache-2.0
/// \file
/// Entries of the table of docs/numbers.md: how far a kernel is from its definition in double.
#pragma once

#include "tests/stress/soak.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <random>
#include <string>
#include <vector>

namespace rayloom::test::budget
{

/// Largest error so far.
class Error
{
public:
    /// `scale`: what the error is measured against; 0 means the true value itself.
    explicit Error(double scale = 0.0) : m_scale(scale) {}
    void add(double value, double truth)
    {
        add(value, truth, m_scale > 0.0 ? m_scale : std::fabs(truth));
    }
    void add(double value, double truth, double against)
    {
        against = std::max(std::fabs(against), double(FLT_MIN));
        m_worst = std::max(m_worst, std::fabs(value - truth) / against);
        int exponent = 0;
        std::frexp(against, &exponent);
        m_ulp =
            std::max(m_ulp, std::fabs(value - truth) / std::ldexp(1.0, exponent - FLT_MANT_DIG));
        if (!std::isfinite(value)) m_worst = std::numeric_limits<double>::infinity();
        ++m_count;
    }
    double relative() const { return m_worst; }
    double ulp() const { return m_ulp; }
    /// How many values were held against the truth.
    std::size_t count() const { return m_count; }

private:
    double m_scale, m_worst = 0.0, m_ulp = 0.0;
    std::size_t m_count = 0;
};

/// A row of the table. What it is held below is in error_bounds.txt.
struct Entry {
    std::string kernel, input, against;
    Error error;
};

using Table = std::vector<Entry>;
inline const char* const itself = "value";
inline const char* const largest = "largest value";

/// Whether there is time for the long version: `./dev numbers` and `./dev soak`.
inline bool long_version() { return soaking() || std::getenv("RAYLOOM_NUMBERS"); }

/// A number of mean 0 and variance 1, nearly normal, made of sums alone: the same on every machine,
/// whatever its logarithm is.
template <class Random>
double steady_noise(Random& random)
{
    std::uniform_real_distribution<double> unit(-0.5, 0.5);
    double sum = 0.0;
    for (int i = 0; i < 12; ++i) sum += unit(random);
    return sum;
}

/// Nodes that work pixel by pixel or on small windows: error_budget_nodes.cpp.
void add_node_entries(Table& table);
/// Every node that has a plain version, and the deep ones: error_budget_plain.cpp.
void add_plain_entries(Table& table);
/// Sums over many samples: error_budget_sums.cpp.
void add_sum_entries(Table& table);
/// Fits of planes, by condition: error_budget_planes.cpp.
void add_plane_entries(Table& table);

} // namespace rayloom::test::budget
