// SPDX-License-Identifier: Apache-2.0
/// \file
/// The one place that says what lies beyond an image's edge.
#pragma once

#include <algorithm>

namespace rayloom
{

/// How a filter reads beyond the edge.
enum class Border {
    mirror, ///< half-sample symmetric: … 1 0 | 0 1 2 … n−1 | n−1 n−2 …
    clamp,  ///< the edge pixel repeats
};

/// Maps any coordinate into [lo, hi); hi > lo.
inline int border_index(int i, int lo, int hi, Border border)
{
    if (i >= lo && i < hi) return i;
    if (border == Border::clamp) return std::clamp(i, lo, hi - 1);
    const int n = hi - lo;
    int k = (i - lo) % (2 * n);
    if (k < 0) k += 2 * n;
    return lo + (k < n ? k : 2 * n - 1 - k);
}

/// The part of [lo, hi) that coordinates [a, b) are mapped into by border_index().
struct IndexRange {
    int begin = 0, end = 0;
};
inline IndexRange border_range(int a, int b, int lo, int hi, Border border)
{
    if (a >= b) return {lo, lo};
    IndexRange r{std::clamp(a, lo, hi - 1), std::clamp(b, lo + 1, hi)};
    if (border == Border::mirror) {
        if (lo - a >= hi - lo || b - hi >= hi - lo) return {lo, hi};
        if (a < lo) r.end = std::max(r.end, std::min(hi, lo + (lo - a)));
        if (b > hi) r.begin = std::min(r.begin, std::max(lo, hi - (b - hi)));
    }
    return r;
}

} // namespace rayloom
