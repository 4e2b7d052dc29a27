// SPDX-License-Identifier: Apache-2.0
/// \file
/// Entries of the table of docs/numbers.md: how far a kernel is from its definition in double.
#pragma once

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <limits>
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
        const double against =
            m_scale > 0.0 ? m_scale : std::max(std::fabs(truth), double(FLT_MIN));
        m_worst = std::max(m_worst, std::fabs(value - truth) / against);
        int exponent = 0;
        std::frexp(against, &exponent);
        m_ulp =
            std::max(m_ulp, std::fabs(value - truth) / std::ldexp(1.0, exponent - FLT_MANT_DIG));
        if (!std::isfinite(value)) m_worst = std::numeric_limits<double>::infinity();
    }
    double relative() const { return m_worst; }
    double ulp() const { return m_ulp; }

private:
    double m_scale, m_worst = 0.0, m_ulp = 0.0;
};

struct Entry {
    std::string kernel, input, against;
    Error error;
    double bound;
    std::string reason;
};

using Table = std::vector<Entry>;
inline const char* const itself = "value";
inline const char* const largest = "largest value";

/// Nodes that work pixel by pixel or on small windows, and sums: error_budget_nodes.cpp.
void add_node_entries(Table& table);

} // namespace rayloom::test::budget
