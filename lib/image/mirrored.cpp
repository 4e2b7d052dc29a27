// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/mirrored.h"

#include "rayloom/image/border.h"

#include <algorithm>

namespace rayloom
{

Region mirrored_region(const Region& region, const Region& window)
{
    const IndexRange x = border_range(region.x0, region.x1, window.x0, window.x1, Border::mirror);
    const IndexRange y = border_range(region.y0, region.y1, window.y0, window.y1, Border::mirror);
    return {x.begin, y.begin, x.end, y.end};
}

void load_mirrored_row(const ConstImageView& from, const Region& window, int y,
                       const Region& region, float* to)
{
    const auto mirror_x = [&](int x) {
        return border_index(x, window.x0, window.x1, Border::mirror);
    };
    const int source = border_index(y, window.y0, window.y1, Border::mirror);
    const int lo = std::clamp(window.x0, region.x0, region.x1);
    const int hi = std::clamp(window.x1, lo, region.x1);
    for (int x = region.x0; x < lo; ++x) to[x - region.x0] = from.at(0, mirror_x(x), source);
    if (lo < hi) std::copy_n(from.ptr(0, lo, source), hi - lo, to + (lo - region.x0));
    for (int x = hi; x < region.x1; ++x) to[x - region.x0] = from.at(0, mirror_x(x), source);
}

} // namespace rayloom
