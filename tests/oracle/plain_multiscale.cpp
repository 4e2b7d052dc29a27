// SPDX-License-Identifier: Apache-2.0
#include "nodes/multiscale/steerable_kernel.h"
#include "tests/oracle/plain_nodes.h"
#include "tests/oracle/steerable.h"

#include <cmath>

namespace rayloom::oracle
{

int mirrored_index(int i, int n)
{
    while (i < 0 || i >= n) i = i < 0 ? -1 - i : 2 * n - 1 - i;
    return i;
}

PlainResult plain_pyramid(const PlainInput& in)
{
    const Raster<double>& image = in.image("image");
    PlainResult out;
    out.images["levels"] = {image, downsample(image, 1)};
    return out;
}

PlainResult plain_recombine(const PlainInput& in)
{
    const std::vector<Raster<double>> levels{in.image("fine"), downsample(in.image("other"), 1)};
    PlainResult out;
    out.images["image"] = {recombine(levels, RecombineLimit::share)};
    return out;
}

namespace
{

constexpr int levels = 3;

double band_at(const SteerableBand& band, const PixelFunction& image, int x, int y)
{
    switch (band.kind) {
    case SteerableBand::Kind::high: return steerable_high(image, x, y);
    case SteerableBand::Kind::low: return steerable_low(image, band.level, x, y);
    case SteerableBand::Kind::oriented: break;
    }
    return steerable_oriented(image, band.level, band.orientation, x, y);
}

Raster<double> plain_band(const SteerableBand& band, const Raster<double>& image)
{
    const Halo halo = steerable_halo(band);
    Raster<double> out(image.width + halo.left + halo.right, image.height + halo.up + halo.down,
                       image.channels);
    for (int c = 0; c < out.channels; ++c) {
        const PixelFunction pixel = [&](int x, int y) {
            return image.at(c, mirrored_index(x, image.width), mirrored_index(y, image.height));
        };
        for (int y = 0; y < out.height; ++y)
            for (int x = 0; x < out.width; ++x)
                out.at(c, x, y) = band_at(band, pixel, x - halo.left, y - halo.up);
    }
    return out;
}

} // namespace

PlainResult plain_steerable(const PlainInput& in)
{
    PlainResult out;
    for (int i = 0; i < steerable_band_count(levels); ++i)
        out.images["bands"].push_back(plain_band(steerable_band(i, levels), in.image("image")));
    return out;
}

PlainResult plain_steerable_inverse(const PlainInput& in)
{
    const Raster<double>& image = in.image("image");
    Raster<double> sum(image.width, image.height, image.channels);
    for (int i = 0; i < steerable_band_count(levels); ++i) {
        const SteerableBand band = steerable_band(i, levels);
        const Halo halo = steerable_halo(band);
        Raster<double> pixels = plain_band(band, image);
        // Magnitudes: bands that no image has.
        for (double& v : pixels.values) v = std::abs(v);
        // The adjoint: what the band answers to a single pixel, turned round. The high-pass is
        // added as it is; the scale of the oriented bands counts twice, in the band and its answer.
        const int reach = band.kind == SteerableBand::Kind::high ? 0 : 1 << band.level;
        Raster<double> answer(2 * reach + 1, 2 * reach + 1, 1);
        const PixelFunction impulse = [](int x, int y) { return x == 0 && y == 0 ? 1.0 : 0.0; };
        double scale = 1.0;
        if (band.kind == SteerableBand::Kind::oriented)
            scale = 1.0 / (2.0 * std::pow(4.0, band.level - 1));
        for (int y = -reach; y <= reach; ++y)
            for (int x = -reach; x <= reach; ++x)
                answer.at(0, x + reach, y + reach) = band.kind == SteerableBand::Kind::high
                                                         ? 1.0
                                                         : scale * band_at(band, impulse, x, y);
        for (int c = 0; c < sum.channels; ++c)
            for (int y = 0; y < sum.height; ++y)
                for (int x = 0; x < sum.width; ++x)
                    for (int v = -reach; v <= reach; ++v)
                        for (int u = -reach; u <= reach; ++u) {
                            const double weight = answer.at(0, u + reach, v + reach);
                            if (weight != 0.0)
                                sum.at(c, x, y) +=
                                    weight * pixels.at(c, x + u + halo.left, y + v + halo.up);
                        }
    }
    PlainResult out;
    out.images["image"] = {sum};
    return out;
}

} // namespace rayloom::oracle
