// SPDX-License-Identifier: Apache-2.0
/// \file
/// Images mirrored beyond their data window (Border::mirror), for filters that read there.
#pragma once

#include "rayloom/image/view.h"

namespace rayloom
{

/// The part of the window whose pixels the mirrored image shows over `region`.
Region mirrored_region(const Region& region, const Region& window);

/// Row y of channel 0 of the mirrored image over the columns of `region`; `from` covers
/// mirrored_region() of them.
void load_mirrored_row(const ConstImageView& from, const Region& window, int y,
                       const Region& region, float* to);

} // namespace rayloom
