// SPDX-License-Identifier: Apache-2.0
/// \file
/// Sums whose bits do not depend on the number of threads.
#pragma once

#include <cstddef>
#include <span>

namespace rayloom
{

/// Pairwise sum: halves are summed apart down to runs of 64 terms, so that the rounding error grows
/// with log n. The order is fixed by the number of terms alone.
inline double pairwise_sum(std::span<const double> values)
{
    if (values.size() <= 64) {
        double sum = 0.0;
        for (const double v : values) sum += v;
        return sum;
    }
    const std::size_t half = values.size() / 2;
    return pairwise_sum(values.first(half)) + pairwise_sum(values.subspan(half));
}

/// Folds `count` records of `size` numbers, stored one after another, into the first one by
/// combine(into, other), as a balanced tree. Precondition: count ≥ 1.
template <class Combine>
void tree_combine(std::span<double> records, std::size_t size, const Combine& combine)
{
    const std::size_t count = records.size() / size;
    if (count <= 1) return;
    const std::size_t half = (count + 1) / 2;
    tree_combine(records.first(half * size), size, combine);
    tree_combine(records.subspan(half * size), size, combine);
    combine(records.first(size), std::span<const double>(records.subspan(half * size, size)));
}

} // namespace rayloom
