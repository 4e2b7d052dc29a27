// SPDX-License-Identifier: Apache-2.0
/// \file
/// The energy stage (transform.restore_mean) as its page says it, in double.
#pragma once

#include "tests/oracle/histogram_fusion.h"

namespace rayloom::oracle
{

/// K of an image: [1 4 6 4 1]/16 along x and y at distances 1, 2, …, 2^(scale − 1), one after the
/// other, of the mirrored image.
Raster<double> spread(Raster<double> image, int scale);

/// f·K(n / K f), mode `share`: f the positive part of `image`, n the reference. Where K f vanishes
/// the reference stays.
Raster<double> restore_share(const Raster<double>& image, const Raster<double>& reference,
                             int scale);

} // namespace rayloom::oracle
