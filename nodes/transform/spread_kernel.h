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

/// K of `in`, one channel over r grown by spread_reach(), in place of it, over r. The others are
/// scratch.
void spread(int scale, const Region& r, ImageBuffer& in, ImageBuffer& between, ImageBuffer& other);

/// One channel each. f = max(image, 0), n = reference and w = max(weight, 0) (1 where `weight` is
/// null) are mirrored beyond `window`.
struct EnergyImages {
    ConstImageView image, reference;
    const ConstImageView* weight = nullptr;
    float offset = 0.0f; ///< balance_energy(): added to f and n meanwhile
};

/// out = f · K(w n / K(w f)): Σ w·out = Σ w·n. `image` and `weight` cover out.region() grown by
/// twice spread_reach(), `reference` by once, all mapped back into the window. Where K(w f) is 0
/// the reference stays.
void restore_energy(int scale, const Region& window, const EnergyImages& images, ImageView out);
/// out = f + f/K(w f) · K(w (n − f) / K u) with u = w f / K(w f), not below 0: f itself where it is
/// n, and Σ w·out = Σ w·n but for what was below 0; n where w is 0. As restore_energy(), but
/// `image` and `weight` cover three times spread_reach().
void balance_energy(int scale, const Region& window, const EnergyImages& images, ImageView out);
/// out = f · K(w n) / K(w f); everything covers once spread_reach().
void restore_local_mean(int scale, const Region& window, const EnergyImages& images, ImageView out);
/// Bytes any of them allocates for a region.
std::size_t restore_energy_scratch(int scale, const Region& region);

} // namespace rayloom
