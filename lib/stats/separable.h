// SPDX-License-Identifier: Apache-2.0
/// \file
/// The inner loop of separable filters in double: weighted sums of whole rows.
#pragma once

#include <cstddef>
#include <span>

namespace rayloom
{

/// Symmetry of a filter of 2·r + 1 taps around its centre.
enum class Parity {
    even, ///< w(−k) = w(k)
    odd,  ///< w(−k) = −w(k), so w(0) = 0
};

/// For i in [0, n):
///     even: out[i] = w[0]·rows[r][i] + Σ_{k=1..r} w[k]·(rows[r+k][i] + rows[r−k][i])
///     odd:  out[i] =                   Σ_{k=1..r} w[k]·(rows[r+k][i] − rows[r−k][i])
/// with r = w.size() − 1 and `rows` of 2·r + 1 pointers. A horizontal filter passes one row shifted
/// by 0 … 2·r. The same bits on every SIMD target: terms are added in the order written, multiply
/// and add round apart. `out` must not overlap the rows.
void weighted_row_sum(std::span<const double* const> rows, std::span<const double> w, Parity parity,
                      double* out, std::size_t n);

} // namespace rayloom
