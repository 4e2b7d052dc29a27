// SPDX-License-Identifier: Apache-2.0
/// \file
/// FLIP, a model of the difference a person sees when two images alternate in place.
///
/// LDR-FLIP: Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, "FLIP: A Difference
/// Evaluator for Alternating Images", HPG 2020. HDR-FLIP: Andersson, Nilsson, Shirley,
/// Akenine-Möller, "Visualizing Errors in Rendered High Dynamic Range Images", Eurographics 2021
/// short papers. Constants: docs/measures.md.
#pragma once

#include "rayloom/stats/image_pair.h"

#include <array>
#include <string_view>
#include <vector>

namespace rayloom
{

/// Pixels per degree of a 0.7 m wide, 3840 pixel wide monitor seen from 0.7 m: 67.02.
inline constexpr double flip_pixels_per_degree = 3840.0 * 3.14159265358979323846 / 180.0;

/// The curve from scene radiance to the display.
enum class ToneMapper {
    none,     ///< clamp to [0, 1]
    aces,     ///< fit of the ACES filmic curve per channel
    hable,    ///< Hable's filmic curve per channel, white at 11.2
    reinhard, ///< c / (1 + luminance)
};
/// "none", "aces", "hable", "reinhard".
const char* tone_mapper_name(ToneMapper mapper);

/// How radiance is brought to the display's linear [0, 1]: multiplied by 2^stops, then the curve.
struct Exposure {
    ToneMapper mapper = ToneMapper::none;
    double stops = 0.0;
};

/// Exposures HDR-FLIP looks through, shortest to longest, evenly spaced.
struct ExposureRange {
    double start = 0.0, stop = 0.0; ///< stops
    int count = 1;

    double at(int i) const
    {
        return count > 1 ? start + i * ((stop - start) / (count - 1)) : start;
    }
};

/// The published choice: from the exposure that maps the largest luminance of the reference to
/// 0.85 to the one that does so with the median luminance, at most one stop apart, at least two.
/// Negative values count as zero. Where the median is zero (more than half the picture black) the
/// median of the positive luminances is used; a black reference gives one exposure at 0.
/// `luminance` is reordered. Precondition: mapper is not none.
ExposureRange flip_exposures(std::span<double> luminance, ToneMapper mapper);

/// Computes FLIP for one viewing distance.
class Flip
{
public:
    explicit Flip(double pixels_per_degree = flip_pixels_per_degree);

    /// Pixels read beyond a pixel on each side; the window's edge pixels repeat.
    int radius() const { return m_radius; }

    /// FLIP in [0, 1] of every pixel of `region`, row after row, `stride` doubles apart. The views
    /// must hold region grown by radius() inside the window. The value of a pixel does not depend
    /// on the region asked for. Pixels that are not finite read as black in both images.
    void error(const ImagePair& pair, const Region& region, const Exposure& exposure, double* out,
               std::ptrdiff_t stride) const;

private:
    using Taps = std::vector<double>;

    int m_radius = 0;
    Taps m_achromatic, m_red_green; ///< 1-D halves of the contrast sensitivity filters
    std::array<Taps, 2> m_blue_yellow;
    std::array<double, 2> m_blue_yellow_share{};
    Taps m_gauss, m_edge, m_point; ///< feature detectors: one across, the other along
};

} // namespace rayloom
