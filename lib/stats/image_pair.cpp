// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/image_pair.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

namespace rayloom
{

namespace
{
// On the bits, so that the compiler can test a vector at a time.
unsigned not_finite(float v)
{
    constexpr std::uint32_t exponent = 0x7f800000u;
    return (std::bit_cast<std::uint32_t>(v) & exponent) == exponent ? 1u : 0u;
}
} // namespace

PairRow::PairRow(int width)
    : m_stride(width), m_image(static_cast<std::size_t>(width) * 3),
      m_reference(static_cast<std::size_t>(width) * 3), m_good(static_cast<std::size_t>(width))
{
}

std::size_t PairRow::load(const ImagePair& pair, int y, int x0, int x1)
{
    const int n = x1 - x0;
    const int channels = pair.image.channels();
    unsigned doubt = 0;
    for (int c = 0; c < 3; ++c) {
        const float* d = pair.image.ptr(std::min(c, channels - 1), x0, y);
        const float* r = pair.reference.ptr(std::min(c, channels - 1), x0, y);
        double* image_row = image(c);
        double* reference_row = reference(c);
        for (int i = 0; i < n; ++i) {
            image_row[i] = static_cast<double>(d[i]);
            reference_row[i] = static_cast<double>(r[i]);
        }
        if (c < channels)
            for (int i = 0; i < n; ++i) doubt |= not_finite(d[i]) | not_finite(r[i]);
    }
    std::fill_n(m_good.begin(), n, static_cast<unsigned char>(1));
    if (doubt == 0) return 0;

    std::size_t bad = 0;
    for (int i = 0; i < n; ++i) {
        bool finite = true;
        for (int c = 0; c < 3; ++c)
            finite = finite && std::isfinite(image(c)[i]) && std::isfinite(reference(c)[i]);
        if (finite) continue;
        m_good[static_cast<std::size_t>(i)] = 0;
        ++bad;
        for (int c = 0; c < 3; ++c) image(c)[i] = reference(c)[i] = 0.0;
    }
    return bad;
}

} // namespace rayloom
