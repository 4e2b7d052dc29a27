// SPDX-License-Identifier: Apache-2.0
/// \file
/// Pixel rectangles in display space (as EXR addresses them: origins may be negative).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>

namespace rayloom
{

/// Pixels a filter reads beyond the pixel it writes, per side.
struct Halo {
    int left = 0, right = 0, up = 0, down = 0;

    static constexpr Halo all(int n) { return {n, n, n, n}; }
    bool none() const { return left == 0 && right == 0 && up == 0 && down == 0; }
    friend bool operator==(const Halo&, const Halo&) = default;
};

/// Half-open rectangle [x0, x1) × [y0, y1). Empty when either side is.
struct Region {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;

    int width() const { return std::max(0, x1 - x0); }
    int height() const { return std::max(0, y1 - y0); }
    bool empty() const { return x1 <= x0 || y1 <= y0; }
    std::size_t pixels() const
    {
        return static_cast<std::size_t>(width()) * static_cast<std::size_t>(height());
    }

    bool contains(int x, int y) const { return x >= x0 && x < x1 && y >= y0 && y < y1; }
    /// Whether all of `other` lies inside; an empty region lies inside everything.
    bool contains(const Region& other) const
    {
        return other.empty() ||
               (other.x0 >= x0 && other.x1 <= x1 && other.y0 >= y0 && other.y1 <= y1);
    }
    Region intersect(const Region& o) const
    {
        const Region r{std::max(x0, o.x0), std::max(y0, o.y0), std::min(x1, o.x1),
                       std::min(y1, o.y1)};
        return r.empty() ? Region{} : r;
    }
    /// Smallest region that holds both; an empty one adds nothing.
    Region hull(const Region& o) const
    {
        if (empty()) return o;
        if (o.empty()) return *this;
        return {std::min(x0, o.x0), std::min(y0, o.y0), std::max(x1, o.x1), std::max(y1, o.y1)};
    }
    Region grown(const Halo& h) const
    {
        if (empty()) return {};
        return {x0 - h.left, y0 - h.up, x1 + h.right, y1 + h.down};
    }
    Region shifted(int dx, int dy) const { return {x0 + dx, y0 + dy, x1 + dx, y1 + dy}; }

    /// "WxH+X+Y", the way oiiotool prints windows.
    std::string text() const;
    friend bool operator==(const Region&, const Region&) = default;
};

} // namespace rayloom
