// SPDX-License-Identifier: Apache-2.0
/// \file
/// An image and what it is compared with, read so that a pixel that is not finite in either has no
/// say in any measure.
#pragma once

#include "rayloom/image/view.h"

#include <cstddef>
#include <vector>

namespace rayloom
{

/// Image d and reference r, both of 1 or of 3 channels (linear radiance; one channel is grey).
/// `window` is the whole picture, whose edges filters mirror or repeat; the views need only hold
/// the pixels that are asked for.
struct ImagePair {
    ConstImageView image, reference;
    Region window;
};

/// One row of a pair in double, planar: [channel][x], always three channels.
class PairRow
{
public:
    /// Room for `width` pixels.
    explicit PairRow(int width);

    /// Reads pixels [x0, x1) of row y. A pixel with a NaN or an infinity in any channel of either
    /// image becomes zero in both and is not good(). Returns the number of such pixels.
    std::size_t load(const ImagePair& pair, int y, int x0, int x1);

    double* image(int channel) { return m_image.data() + offset(channel); }
    double* reference(int channel) { return m_reference.data() + offset(channel); }
    const double* image(int channel) const { return m_image.data() + offset(channel); }
    const double* reference(int channel) const { return m_reference.data() + offset(channel); }
    /// 1 where the pixel counts, else 0.
    const unsigned char* good() const { return m_good.data(); }

private:
    std::ptrdiff_t offset(int channel) const { return channel * m_stride; }

    std::ptrdiff_t m_stride = 0;
    std::vector<double> m_image, m_reference;
    std::vector<unsigned char> m_good;
};

/// Rec. 709 luminance weights.
inline constexpr double luminance_weights[3] = {0.2126, 0.7152, 0.0722};

} // namespace rayloom
