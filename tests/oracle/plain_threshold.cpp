// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/plain_nodes.h"

#include <boost/math/distributions/students_t.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace rayloom::oracle
{

PlainResult plain_interval(const PlainInput& in)
{
    const Raster<double>&mean = in.image("mean"), &variance = in.image("variance"),
          &count = in.image("count");
    std::map<double, double> factors;
    const auto half_width = [&](int c, int x, int y) {
        const double n = std::floor(count.at(0, x, y));
        if (!factors.contains(n))
            factors[n] = boost::math::quantile(
                boost::math::complement(boost::math::students_t(n - 1.0), 0.5 * (1.0 - 0.99)));
        return factors[n] * std::sqrt(std::max(variance.at(c, x, y), 0.0) / count.at(0, x, y));
    };
    PlainResult out;
    out.images["low"] = {make_raster(
        mean, 3, [&](int c, int x, int y) { return mean.at(c, x, y) - half_width(c, x, y); })};
    out.images["high"] = {make_raster(
        mean, 3, [&](int c, int x, int y) { return mean.at(c, x, y) + half_width(c, x, y); })};
    return out;
}

PlainResult plain_sanitize(const PlainInput& in)
{
    const Raster<double>& image = in.image("image");
    PlainResult out;
    out.images["image"] = {make_raster(image, 3, [&](int c, int x, int y) {
        if (std::isfinite(image.at(c, x, y))) return image.at(c, x, y);
        for (int r = 1; r <= 3; ++r) {
            double sum = 0.0;
            int good = 0;
            for (int v = std::max(0, y - r); v <= std::min(image.height - 1, y + r); ++v)
                for (int u = std::max(0, x - r); u <= std::min(image.width - 1, x + r); ++u)
                    if (std::isfinite(image.at(c, u, v))) {
                        sum += image.at(c, u, v);
                        ++good;
                    }
            if (good > 0) return sum / good;
        }
        return 0.0;
    })};
    return out;
}

PlainResult plain_outlier(const PlainInput& in)
{
    const Raster<double>&image = in.image("image"), &low = in.image("low");
    const auto factor = [&](int x, int y) {
        double most = 0.0;
        for (int c = 0; c < 3; ++c) {
            if (!(image.at(c, x, y) > 0.0)) return 1.0;
            std::vector<double> around;
            for (int v = std::max(0, y - 3); v <= std::min(image.height - 1, y + 3); ++v)
                for (int u = std::max(0, x - 3); u <= std::min(image.width - 1, x + 3); ++u)
                    if (u != x || v != y) around.push_back(image.at(c, u, v));
            std::sort(around.rbegin(), around.rend());
            const double rank = std::ceil(0.2 * static_cast<double>(around.size()) - 1e-6);
            const double cap =
                std::max(around[static_cast<std::size_t>(rank) - 1], low.at(c, x, y));
            most = std::max(most, cap / image.at(c, x, y));
        }
        return std::min(most, 1.0);
    };
    PlainResult out;
    out.images["image"] = {make_raster(
        image, 3, [&](int c, int x, int y) { return image.at(c, x, y) * factor(x, y); })};
    out.images["excess"] = {make_raster(
        image, 3, [&](int c, int x, int y) { return image.at(c, x, y) * (1.0 - factor(x, y)); })};
    return out;
}

PlainResult plain_boundary(const PlainInput& in)
{
    const Raster<double>&depth = in.image("depth"), &normal = in.image("normal");
    const auto inside = [&](int x, int y) {
        return x >= 0 && y >= 0 && x < depth.width && y < depth.height;
    };
    const auto has_depth = [](double z) { return z > 0.0 && z < 1e9; };
    const auto differ = [&](int x, int y, int dx, int dy) {
        std::array<double, 3> dots{}; // of the pair, and of each with itself
        for (int c = 0; c < 3; ++c) {
            const double a = normal.at(c, x, y), b = normal.at(c, x + dx, y + dy);
            dots[0] += a * b;
            dots[1] += a * a;
            dots[2] += b * b;
        }
        // Shorter than a twentieth is no normal.
        const bool has_a = dots[1] > 0.0025, has_b = dots[2] > 0.0025;
        if (has_a != has_b) return true;
        const double angle =
            has_a ? std::acos(std::clamp(dots[0] / std::sqrt(dots[1] * dots[2]), -1.0, 1.0)) : 0.0;
        if (angle > std::numbers::pi / 3.0) return true;
        const double a = depth.at(0, x, y), b = depth.at(0, x + dx, y + dy);
        if (has_depth(a) != has_depth(b)) return true;
        const double leap = std::abs(a - b);
        if (!has_depth(a) || !(leap > 0.05 * std::min(a, b))) return false;
        double slope = 0.0;
        if (inside(x - dx, y - dy) && has_depth(depth.at(0, x - dx, y - dy)))
            slope = std::abs(depth.at(0, x - dx, y - dy) - a);
        if (inside(x + 2 * dx, y + 2 * dy) && has_depth(depth.at(0, x + 2 * dx, y + 2 * dy)))
            slope = std::max(slope, std::abs(depth.at(0, x + 2 * dx, y + 2 * dy) - b));
        return leap > 2.0 * slope;
    };
    PlainResult out;
    out.images["boundary"] = {make_raster(depth, 1, [&](int, int x, int y) {
        for (const auto& [dx, dy] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}})
            if (inside(x + dx, y + dy) && differ(x, y, dx, dy)) return 1.0;
        return 0.0;
    })};
    return out;
}

} // namespace rayloom::oracle
