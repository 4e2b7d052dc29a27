// SPDX-License-Identifier: Apache-2.0
/// \file
/// An oriented multiscale frame: an undecimated high-pass, four orientations at each of L levels,
/// and a low-pass. All filters are differences and averages of a few pixels, so any rectangle of
/// a band can be made from a rectangle of the image.
///
/// With D_h x(i) = x(i + D/2) − x(i − D/2) along a direction and A_D the mean of the four pixels
/// (±D/2, ±D/2), the following holds for every image, because
/// 1 − cos²a cos²b = ½ sin²a + ½ sin²b + ¼ sin²(a + b) + ¼ sin²(a − b):
///
///     1 = A_D* A_D + ⅛ D_0* D_0 + ⅛ D_90* D_90 + 1/16 D_45* D_45 + 1/16 D_135* D_135
///
/// (D_45 and D_135 reach over the diagonal of the same square; * is the adjoint). So the same
/// filters take an image apart and put it together, level after level with D = 2, 4, 8, …, and
/// what each level hands to the next is the mean of a square twice as wide. The first square
/// (D = 1) is taken apart without orientation: the high-pass is x − A_1* A_1 x, and is added back
/// as it is.
///
/// Bands are scaled by √2·2^(level−1), so that independent pixel noise of deviation 1 has about the
/// same deviation in every oriented band (0.354 in the upright ones, 0.25 in the diagonal ones,
/// 0.800 in the high-pass).
///
/// Beyond its edges the image is mirrored. A band covers the image grown by steerable_halo(), which
/// is all that putting the image together again reads: nothing wraps, and reconstruction is as
/// exact at the edges as anywhere.
#pragma once

#include "rayloom/image/view.h"

#include <span>
#include <string>
#include <string_view>

namespace rayloom
{

inline constexpr int steerable_orientations = 4;
inline constexpr int steerable_max_levels = 8;

/// One band of the frame.
struct SteerableBand {
    enum class Kind { high, oriented, low };
    Kind kind = Kind::high;
    int level = 0;       ///< oriented: 1 (finest) to L; low: L
    int orientation = 0; ///< 0: changes along x; 1: along the falling diagonal; 2: along y;
                         ///< 3: along the rising diagonal

    /// Deviation of the band for independent pixel noise of deviation 1.
    double white_noise_gain() const;
    /// "high", "level1.band1" … "level3.band4", "low3".
    std::string name() const;
};

/// Bands of L levels, in the order of the node's list.
int steerable_band_count(int levels);
SteerableBand steerable_band(int index, int levels);
/// What a band is, from the name of one of its channels ("level2.band3.R"); throws NodeError when
/// the channel is not of a band.
SteerableBand band_of_channel(std::string_view channel);
/// "level2.band3.R" → "R".
std::string plain_channel(std::string_view channel);

/// How far a band reaches beyond the image.
Halo steerable_halo(const SteerableBand& band);
/// Pixels of the (mirrored) image that pixels `region` of a band are made of, before mirroring.
Region steerable_need(const SteerableBand& band, const Region& region);

/// Fills `out` (any part of the band's window; one channel) from an image whose window is
/// `window`; `image` covers steerable_need() of it, mirrored back into `window`.
void steerable_analyse(const SteerableBand& band, const Region& window, ConstImageView image,
                       ImageView out);

/// Puts `out` (any part of the image; one channel) together from the bands of that channel, each
/// of which covers `out.region()` grown by steerable_halo().
void steerable_synthesise(int levels, std::span<const ConstImageView> bands, ImageView out);
/// Bytes steerable_synthesise() allocates for a region.
std::size_t steerable_synthesis_scratch(int levels, const Region& region);
std::size_t steerable_analysis_scratch(const SteerableBand& band, const Region& region);

} // namespace rayloom
