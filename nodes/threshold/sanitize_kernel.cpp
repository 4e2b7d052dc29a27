// SPDX-License-Identifier: Apache-2.0
#include "nodes/threshold/sanitize_kernel.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace rayloom
{
namespace
{

/// False for NaN too.
inline bool good(float v, float lo, float hi) { return v >= lo && v <= hi; }

bool all_good(const float* v, std::size_t n, float lo, float hi)
{
    int bad = 0;
    for (std::size_t i = 0; i < n; ++i) bad |= !(v[i] >= lo) | !(v[i] <= hi);
    return bad == 0;
}

float mean_of_neighbours(const ConstImageView& in, int channel, int x, int y, int reach, float lo,
                         float hi)
{
    const Region& all = in.region();
    for (int r = 1; r <= reach; ++r) {
        const Region window = Region{x - r, y - r, x + r + 1, y + r + 1}.intersect(all);
        double sum = 0.0;
        int n = 0;
        for (int yy = window.y0; yy < window.y1; ++yy) {
            const float* row = in.ptr(channel, window.x0, yy);
            for (int i = 0; i < window.width(); ++i)
                if (good(row[i], lo, hi)) {
                    sum += static_cast<double>(row[i]);
                    ++n;
                }
        }
        if (n > 0) return static_cast<float>(sum / n);
    }
    return 0.0f;
}

} // namespace

RepairCounts repair_pixels(const ConstImageView& in, const RepairRule& rule, const ImageView& out)
{
    const Region& region = out.region();
    const auto width = static_cast<std::size_t>(region.width());
    enum Kind : unsigned char { fine, high, low, not_finite }; // the larger one counts
    std::vector<unsigned char> kinds;
    RepairCounts counts;
    for (int y = region.y0; y < region.y1; ++y) {
        bool row_is_fine = true;
        for (int c = 0; c < out.channels(); ++c) {
            const auto k = static_cast<std::size_t>(c);
            const float lo = rule.lowest[k], hi = rule.highest[k];
            const float* from = in.ptr(c, region.x0, y);
            float* to = out.row(c, y);
            if (to != from) std::memcpy(to, from, width * sizeof(float));
            if (all_good(from, width, lo, hi)) continue;
            if (row_is_fine) kinds.assign(width, fine);
            row_is_fine = false;
            for (std::size_t i = 0; i < width; ++i) {
                const float v = from[i];
                if (good(v, lo, hi)) continue;
                const unsigned char kind = !std::isfinite(v) ? not_finite : v < lo ? low : high;
                kinds[i] = std::max(kinds[i], kind);
                to[i] = rule.repair == Repair::black
                            ? 0.0f
                            : mean_of_neighbours(in, c, region.x0 + static_cast<int>(i), y,
                                                 rule.reach, lo, hi);
            }
        }
        if (row_is_fine) continue;
        for (const unsigned char kind : kinds) {
            counts.not_finite += kind == not_finite;
            counts.too_low += kind == low;
            counts.too_high += kind == high;
        }
    }
    return counts;
}

} // namespace rayloom
