// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/restore_mean.h"

#include "tests/oracle/plain_nodes.h"

#include <algorithm>

namespace rayloom::oracle
{

Raster<double> spread(Raster<double> image, int scale)
{
    static constexpr double taps[] = {1.0, 4.0, 6.0, 4.0, 1.0};
    for (int s = 0; s < scale; ++s) {
        const Raster<double> in = image;
        image = make_raster(in, in.channels, [&](int c, int x, int y) {
            double sum = 0.0;
            for (int j = -2; j <= 2; ++j)
                for (int i = -2; i <= 2; ++i)
                    sum += taps[i + 2] * taps[j + 2] / 256.0 *
                           in.at(c, mirrored_index(x + i * (1 << s), in.width),
                                 mirrored_index(y + j * (1 << s), in.height));
            return sum;
        });
    }
    return image;
}

Raster<double> restore_share(const Raster<double>& image, const Raster<double>& reference,
                             int scale)
{
    const auto light = [&](int c, int x, int y) { return std::max(image.at(c, x, y), 0.0); };
    const Raster<double> mean = spread(make_raster(image, image.channels, light), scale);
    const auto lit = [&](int c, int x, int y) { return mean.at(c, x, y) > 1e-30; };
    const Raster<double> share =
        spread(make_raster(image, image.channels,
                           [&](int c, int x, int y) {
                               return lit(c, x, y) ? reference.at(c, x, y) / mean.at(c, x, y) : 0.0;
                           }),
               scale);
    return make_raster(image, image.channels, [&](int c, int x, int y) {
        return light(c, x, y) * share.at(c, x, y) + (lit(c, x, y) ? 0.0 : reference.at(c, x, y));
    });
}

} // namespace rayloom::oracle
