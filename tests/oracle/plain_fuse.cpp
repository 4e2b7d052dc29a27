// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/plain_nodes.h"

#include <algorithm>
#include <cmath>

namespace rayloom::oracle
{

PlainResult plain_sum(const PlainInput& in)
{
    const Raster<double>&direct = in.image("direct"), &indirect = in.image("indirect");
    PlainResult out;
    out.images["image"] = {make_raster(
        direct, 3, [&](int c, int x, int y) { return direct.at(c, x, y) + indirect.at(c, x, y); })};
    return out;
}

PlainResult plain_residual(const PlainInput& in)
{
    const Raster<double>&f = in.image("filtered"), &z = in.image("original"),
          &variance = in.image("variance");
    // Around a pixel, as far as the image goes.
    const auto each_near = [&](int x, int y, int radius, const auto& visit) {
        for (int v = std::max(0, y - radius); v <= std::min(f.height - 1, y + radius); ++v)
            for (int u = std::max(0, x - radius); u <= std::min(f.width - 1, x + radius); ++u)
                visit(u, v);
    };
    const Raster<double> share = make_raster(f, 1, [&](int, int x, int y) {
        double change = 0.0, noise = 0.0;
        each_near(x, y, 1, [&](int u, int v) {
            for (int k = 0; k < 3; ++k) {
                change += (z.at(k, u, v) - f.at(k, u, v)) * (z.at(k, u, v) - f.at(k, u, v));
                noise += std::max(variance.at(k, u, v), 0.0);
            }
        });
        if (noise <= 0.0) return 1.0;
        return change > 2.0 * noise ? 1.0 - 2.0 * noise / change : 0.0;
    });
    PlainResult out;
    out.images["image"] = {make_raster(f, 3, [&](int c, int x, int y) {
        double around = 0.0, count = 0.0;
        each_near(x, y, 2, [&](int u, int v) {
            around += share.at(0, u, v);
            count += 1.0;
        });
        const double s = share.at(0, x, y) * std::min(1.0, around / count / 0.5);
        return f.at(c, x, y) + s * (z.at(c, x, y) - f.at(c, x, y));
    })};
    return out;
}

} // namespace rayloom::oracle
