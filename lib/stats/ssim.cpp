// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/ssim.h"

#include "rayloom/stats/separable.h"

#include <algorithm>
#include <cmath>

namespace rayloom
{

double srgb_encode(double linear)
{
    return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1.0 / 2.4) - 0.055;
}

Ssim::Ssim()
{
    constexpr double deviation = 1.5;
    double sum = 0.0;
    for (int k = 0; k <= radius; ++k) {
        m_taps.push_back(std::exp(-(k * k) / (2.0 * deviation * deviation)));
        sum += (k == 0 ? 1.0 : 2.0) * m_taps.back();
    }
    for (double& w : m_taps) w /= sum;
}

void Ssim::rows(const ImagePair& pair, int y0, int y1, double* out, unsigned char* good) const
{
    constexpr double c1 = 0.01 * 0.01, c2 = 0.03 * 0.03;
    const Region& window = pair.window;
    const int full = window.width(), n = full - 2 * radius;
    const auto width = static_cast<std::size_t>(full);

    // Grey x and y and their products, [row][x, y, x², y², xy][column]. In double and below 1 the
    // moments lose nothing that shows next to c2 when the squared means are taken off.
    constexpr int planes = 5;
    const int top = y0 - radius;
    std::vector<double> grey(static_cast<std::size_t>(y1 - y0 + 2 * radius) * planes * width);
    const auto plane_row = [&](int y, int plane) {
        return grey.data() +
               (static_cast<std::size_t>(y - top) * planes + static_cast<std::size_t>(plane)) *
                   width;
    };
    PairRow row(full);
    for (int y = top; y < y1 + radius; ++y) {
        row.load(pair, y, window.x0, window.x1);
        for (int which = 0; which < 2; ++which) {
            double* to = plane_row(y, which);
            for (int x = 0; x < full; ++x) {
                double luminance = 0.0;
                for (int c = 0; c < 3; ++c)
                    luminance +=
                        luminance_weights[c] *
                        std::clamp((which == 0 ? row.image(c) : row.reference(c))[x], 0.0, 1.0);
                to[x] = srgb_encode(luminance);
            }
        }
        const double *a = plane_row(y, 0), *b = plane_row(y, 1);
        double *aa = plane_row(y, 2), *bb = plane_row(y, 3), *ab = plane_row(y, 4);
        for (int x = 0; x < full; ++x) {
            aa[x] = a[x] * a[x];
            bb[x] = b[x] * b[x];
            ab[x] = a[x] * b[x];
        }
        if (y >= y0 && y < y1)
            std::copy_n(row.good() + radius, n, good + static_cast<std::ptrdiff_t>(y - y0) * n);
    }

    std::vector<double> down(width);
    std::vector<double> mean(static_cast<std::size_t>(planes) * static_cast<std::size_t>(n));
    std::array<const double*, 2 * radius + 1> pointers;
    for (int y = y0; y < y1; ++y) {
        for (int plane = 0; plane < planes; ++plane) {
            for (int k = 0; k <= 2 * radius; ++k)
                pointers[static_cast<std::size_t>(k)] = plane_row(y - radius + k, plane);
            weighted_row_sum(pointers, m_taps, Parity::even, down.data(), width);
            for (int k = 0; k <= 2 * radius; ++k)
                pointers[static_cast<std::size_t>(k)] = down.data() + k;
            weighted_row_sum(pointers, m_taps, Parity::even,
                             mean.data() + static_cast<std::ptrdiff_t>(plane) * n,
                             static_cast<std::size_t>(n));
        }
        double* to = out + static_cast<std::ptrdiff_t>(y - y0) * n;
        for (int x = 0; x < n; ++x) {
            const double* m = mean.data() + x;
            const double ma = m[0], mb = m[n];
            const double va = m[2 * n] - ma * ma, vb = m[3 * n] - mb * mb, cov = m[4 * n] - ma * mb;
            to[x] = (2.0 * ma * mb + c1) * (2.0 * cov + c2) /
                    ((ma * ma + mb * mb + c1) * (va + vb + c2));
        }
    }
}

} // namespace rayloom
