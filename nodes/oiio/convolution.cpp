// SPDX-License-Identifier: Apache-2.0
#include "nodes/oiio/convolution.h"

#include <algorithm>
#include <cstring>

namespace rayloom::oiio
{
namespace
{

// Sums stay in registers over all of the kernel: the compiler's vectors, because it keeps an array
// of floats in memory. Lanes are summed by themselves, so their number changes no bit.
constexpr int lanes = 4;
constexpr int block = 16; // pixels at once
using Lanes = float __attribute__((vector_size(lanes * sizeof(float))));

/// One channel of the pixels a region reads, borders resolved; rows padded to whole blocks.
struct Neighbourhood {
    Region region;
    std::ptrdiff_t stride = 0;
    std::vector<float> pixels;

    Neighbourhood(const Region& r)
        : region(r), stride((r.width() + 2 * block - 1) / block * block),
          pixels(static_cast<std::size_t>(stride) * static_cast<std::size_t>(r.height()))
    {
    }

    void load(const ConstImageView& in, int channel, const Region& data, const Region& display)
    {
        const auto at = [&](int x, int y) {
            if (!data.contains(x, y)) {
                x = std::clamp(x, display.x0, display.x1 - 1);
                y = std::clamp(y, display.y0, display.y1 - 1);
                if (!data.contains(x, y)) return 0.0f;
            }
            return in.at(channel, x, y);
        };
        for (int y = region.y0; y < region.y1; ++y) {
            float* row = pixels.data() + (y - region.y0) * stride;
            const bool inside = y >= data.y0 && y < data.y1;
            const int x0 = inside ? std::clamp(data.x0, region.x0, region.x1) : region.x1;
            const int x1 = inside ? std::clamp(data.x1, x0, region.x1) : region.x1;
            for (int x = region.x0; x < x0; ++x) row[x - region.x0] = at(x, y);
            if (x1 > x0)
                std::memcpy(row + (x0 - region.x0), in.ptr(channel, x0, y),
                            static_cast<std::size_t>(x1 - x0) * sizeof(float));
            for (int x = x1; x < region.x1; ++x) row[x - region.x0] = at(x, y);
        }
    }
};

} // namespace

void convolve(const ConstImageView& in, const Region& data, const Region& display,
              const Kernel& kernel, const ImageView& out)
{
    const Region& region = out.region();
    const Region& k = kernel.window;
    Neighbourhood near(
        {region.x0 + k.x0, region.y0 + k.y0, region.x1 + k.x1 - 1, region.y1 + k.y1 - 1});
    const std::size_t taps = k.pixels();
    for (int c = 0; c < out.channels(); ++c) {
        near.load(in, c, data, display);
        const float* weights =
            kernel.weights.data() + (kernel.channels > 1 ? static_cast<std::size_t>(c) : 0) * taps;
        for (int y = region.y0; y < region.y1; ++y) {
            float* to = out.row(c, y);
            const float* first = near.pixels.data() + (y - region.y0) * near.stride;
            for (int x = 0; x < region.width(); x += block) {
                Lanes sums[block / lanes] = {};
                const float* weight = weights;
                for (int ky = 0; ky < k.height(); ++ky) {
                    const float* pixel = first + ky * near.stride + x;
                    for (int kx = 0; kx < k.width(); ++kx, ++pixel, ++weight) {
                        const Lanes w = {*weight, *weight, *weight, *weight};
                        for (int i = 0; i < block / lanes; ++i) {
                            Lanes p;
                            std::memcpy(&p, pixel + i * lanes, sizeof p);
                            sums[i] += w * p;
                        }
                    }
                }
                float total[block];
                for (int i = 0; i < block / lanes; ++i) sums[i] *= kernel.scale;
                std::memcpy(total, sums, sizeof total);
                const int n = std::min(block, region.width() - x);
                std::copy_n(total, n, to + x);
            }
        }
    }
}

} // namespace rayloom::oiio
