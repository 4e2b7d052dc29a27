// SPDX-License-Identifier: Apache-2.0
/// \file
/// What the samples of one deep pixel make together, front to back ("Interpreting OpenEXR Deep
/// Pixels"; samples whose volumes overlap are taken in the order of their fronts).
#pragma once

#include "rayloom/image/image_desc.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace rayloom
{

/// How much of each sample of a pixel is seen.
class DeepVisibility
{
public:
    /// Looks at a pixel. `alpha` holds the share each sample covers, clamped to 0..1 (NaN counts as
    /// 0); `depth` orders the samples, nearest first, equal ones as they are stored and NaN last;
    /// empty: the order they are stored in.
    void look(std::span<const float> alpha, std::span<const float> depth);

    /// Share of the light behind it that all samples together keep back: Σ Tᵢ αᵢ.
    double coverage() const { return m_coverage; }
    /// Share of a sample's light that reaches the viewer: Tᵢ, product of 1 − α of those before it.
    std::span<const double> transmittance() const { return m_transmittance; }
    /// Index of the nearest sample. Precondition: there is one.
    std::size_t front() const { return m_order.front(); }
    /// Premultiplied values seen together: Σ Tᵢ vᵢ over samples that are seen.
    double flatten(std::span<const float> values) const;

private:
    std::vector<std::uint32_t> m_order;
    std::vector<double> m_transmittance; ///< as stored, not in order
    double m_coverage = 0.0;
};

/// Values of one channel of a pixel that flatten to `target`: each old value times
/// g = target / flattened, at most `max_gain` and 0 where that has no sign or no size, and what is
/// then missing spread by coverage, vᵢ' = g vᵢ + αᵢ (target − g F) / A. Where nothing covers
/// (A = 0), g has no limit, and what is missing goes to the nearest sample, which nothing hides.
/// An old value that is not finite counts as 0. `was` empty: a channel the pixel did not have.
void recolor_samples(const DeepVisibility& seen, std::span<const float> alpha,
                     std::span<const float> was, double target, double max_gain,
                     std::span<float> out);

/// The alpha channel of a deep image. Throws NodeError when there is none.
int require_deep_alpha(const ImageDesc& deep);

/// Colour channels: as ImageDesc::colour(), without depth.
std::vector<int> deep_colour(const ImageDesc& image);

} // namespace rayloom
