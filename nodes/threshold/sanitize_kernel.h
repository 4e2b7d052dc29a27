// SPDX-License-Identifier: Apache-2.0
/// \file
/// Replacing pixels that are no usable numbers.
#pragma once

#include "rayloom/image/view.h"

#include <cstddef>
#include <vector>

namespace rayloom
{

/// What stands in for a bad value.
enum class Repair {
    black,      ///< zero
    neighbours, ///< mean of the good values of the same channel nearby
};

struct RepairRule {
    Repair repair = Repair::neighbours;
    int reach = 1; ///< largest distance of a neighbour: 1 looks at 3×3, 2 then at 5×5, …
    /// Per channel: values outside [lowest, highest] are bad, as are NaN and infinities. All finite
    /// values are good with ∓ the largest float.
    std::vector<float> lowest, highest;
};

/// Pixels with at least one bad value, each counted once under the first kind that applies.
struct RepairCounts {
    std::size_t not_finite = 0, too_low = 0, too_high = 0;
};

/// Copies `out.region()` with every bad value replaced: by the mean (summed in double, row by row)
/// of the good ones in the smallest window 3×3, 5×5, … that has any, or zero when none has up to
/// `reach`. Good values pass bit for bit. `in` covers out.region() grown by `reach`, clipped to the
/// data window.
RepairCounts repair_pixels(const ConstImageView& in, const RepairRule& rule, const ImageView& out);

} // namespace rayloom
