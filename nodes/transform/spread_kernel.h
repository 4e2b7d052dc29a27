// SPDX-License-Identifier: Apache-2.0
/// \file
/// A smooth kernel of any width at a fixed price a scale, and energy shared out by it.
#pragma once

#include "rayloom/image/view.h"

#include <cstddef>

namespace rayloom
{

/// Pixels the kernel K reaches: 2·(1 + 2 + … + 2^(scale−1)).
inline constexpr int spread_reach(int scale) { return 2 * ((1 << scale) - 1); }

/// out = f · K(n / K f) for one channel, with f = max(image, 0) and n = reference, both mirrored
/// beyond `window`; `image` covers out.region() grown by twice spread_reach(), `reference` by once,
/// both mapped back into the window.
void restore_energy(int scale, const Region& window, ConstImageView image, ConstImageView reference,
                    ImageView out);
/// out = image · K n / K f for one channel, else as restore_energy(); both inputs cover
/// out.region() grown by spread_reach().
void restore_local_mean(int scale, const Region& window, ConstImageView image,
                        ConstImageView reference, ImageView out);
std::size_t restore_energy_scratch(int scale, const Region& region);

} // namespace rayloom
