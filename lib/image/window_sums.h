// SPDX-License-Identifier: Apache-2.0
/// \file
/// Sums and means over windows along a row.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>

namespace rayloom
{

/// to[i] ← Σ values[j] over first + i − radius ≤ j ≤ first + i + radius, as far as there are
/// values, added from left to right. Preconditions: first ≥ 0; first + to.size() ≤ values.size().
template <class T>
void window_sums(std::span<const T> values, int first, int radius, std::span<T> to)
{
    const int n = static_cast<int>(values.size()), count = static_cast<int>(to.size());
    const auto cut = [&](int i) {
        T sum = 0;
        const int last = std::min(first + i + radius, n - 1);
        for (int j = std::max(first + i - radius, 0); j <= last; ++j)
            sum += values[static_cast<std::size_t>(j)];
        to[static_cast<std::size_t>(i)] = sum;
    };
    // Windows that are whole are summed side by side.
    const int begin = std::clamp(radius - first, 0, count);
    const int end = std::clamp(n - radius - first, begin, count);
    for (int i = 0; i < begin; ++i) cut(i);
    for (int i = end; i < count; ++i) cut(i);
    if (begin == end) return;
    T* const sums = to.data() + begin;
    const T* const left = values.data() + (first + begin - radius);
    std::fill_n(sums, end - begin, T(0));
    for (int k = 0; k <= 2 * radius; ++k)
        for (int i = 0; i < end - begin; ++i) sums[i] += left[i + k];
}

/// Means over squares: values are sums over `rows` rows, to[i] ← the sum of window_sums() over the
/// number of pixels it holds, rows · (values in the window). Preconditions: those of window_sums(),
/// rows ≥ 1, radius ≥ 0.
inline void window_means(std::span<const double> values, int rows, int first, int radius,
                         std::span<double> to)
{
    window_sums(values, first, radius, to);
    const int n = static_cast<int>(values.size());
    for (int i = 0; i < static_cast<int>(to.size()); ++i) {
        const int begin = std::max(first + i - radius, 0),
                  end = std::min(first + i + radius + 1, n);
        to[static_cast<std::size_t>(i)] /= static_cast<double>(rows * (end - begin));
    }
}

} // namespace rayloom
