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
    PlainResult out;
    out.images["image"] = {make_raster(f, 3, [&](int c, int x, int y) {
        double change = 0.0, noise = 0.0;
        for (int v = std::max(0, y - 1); v <= std::min(f.height - 1, y + 1); ++v)
            for (int u = std::max(0, x - 1); u <= std::min(f.width - 1, x + 1); ++u)
                for (int k = 0; k < 3; ++k) {
                    change += (z.at(k, u, v) - f.at(k, u, v)) * (z.at(k, u, v) - f.at(k, u, v));
                    noise += std::max(variance.at(k, u, v), 0.0);
                }
        const double share = change > 2.0 * noise ? 1.0 - 2.0 * noise / change : 0.0;
        return f.at(c, x, y) + share * (z.at(c, x, y) - f.at(c, x, y));
    })};
    return out;
}

} // namespace rayloom::oracle
