// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/colour_map.h"

#include "rayloom/core/parallel.h"
#include "rayloom/stats/ssim.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <vector>

namespace rayloom
{

namespace
{

using Colour = std::array<double, 3>;

/// Bézier curve in CIELAB, chosen by hand inside the sRGB gamut.
constexpr std::array<Colour, 6> control_points = {
    {{3, 2, -8}, {20, 24, -60}, {45, 60, -40}, {66, 42, 40}, {77, 2, 80}, {96, -9, 40}}};

Colour curve(double t)
{
    std::array<Colour, control_points.size()> p = control_points;
    for (std::size_t level = p.size() - 1; level > 0; --level)
        for (std::size_t i = 0; i < level; ++i)
            for (std::size_t c = 0; c < 3; ++c) p[i][c] += t * (p[i + 1][c] - p[i][c]);
    return p[0];
}

std::array<float, 3> srgb_from_lab(const Colour& lab)
{
    const double fy = (lab[0] + 16.0) / 116.0;
    const auto cube = [](double f) {
        constexpr double delta = 6.0 / 29.0;
        return f > delta ? f * f * f : 3.0 * delta * delta * (f - 4.0 / 29.0);
    };
    // Rec. 709 primaries, D65.
    Eigen::Matrix3d to_xyz;
    to_xyz << 0.4124, 0.3576, 0.1805, 0.2126, 0.7152, 0.0722, 0.0193, 0.1192, 0.9505;
    const Eigen::Vector3d white = to_xyz * Eigen::Vector3d::Ones();
    const Eigen::Vector3d xyz(cube(fy + lab[1] / 500.0), cube(fy), cube(fy - lab[2] / 200.0));
    const Eigen::Vector3d rgb = to_xyz.inverse() * xyz.cwiseProduct(white);
    std::array<float, 3> out{};
    for (int c = 0; c < 3; ++c)
        out[static_cast<std::size_t>(c)] =
            static_cast<float>(srgb_encode(std::clamp(rgb[c], 0.0, 1.0)));
    return out;
}

/// The curve's colours at equal distances along it.
class ColourTable
{
public:
    static constexpr std::size_t size = 1025;

    ColourTable()
    {
        constexpr std::size_t steps = 8192;
        std::vector<double> length(steps + 1);
        Colour last = curve(0.0);
        for (std::size_t i = 1; i <= steps; ++i) {
            const Colour next = curve(static_cast<double>(i) / steps);
            length[i] =
                length[i - 1] + std::hypot(next[0] - last[0], next[1] - last[1], next[2] - last[2]);
            last = next;
        }
        std::size_t at = 0;
        for (std::size_t i = 0; i < size; ++i) {
            const double wanted = length.back() * static_cast<double>(i) / (size - 1);
            while (at + 1 < steps && length[at + 1] < wanted) ++at;
            const double part = (wanted - length[at]) / (length[at + 1] - length[at]);
            m_colours[i] = srgb_from_lab(curve((static_cast<double>(at) + part) / steps));
        }
    }
    const std::array<float, 3>& operator[](double value) const
    {
        const double clamped = value > 0.0 ? std::min(value, 1.0) : 0.0;
        return m_colours[static_cast<std::size_t>(std::lround(clamped * (size - 1)))];
    }

private:
    std::array<std::array<float, 3>, size> m_colours;
};

const ColourTable& colour_table()
{
    static const ColourTable table;
    return table;
}

} // namespace

std::array<float, 3> map_colour(double value) { return colour_table()[value]; }

ImageBuffer map_colours(ConstImageView image, double low, double high)
{
    assert(high > low);
    const ColourTable& table = colour_table();
    const Region& region = image.region();
    ImageBuffer out(region, 3);
    parallel_for(region.y0, region.y1, 16, [&](int y) {
        const std::span<const float> from = image.row_span(0, y);
        for (std::size_t x = 0; x < from.size(); ++x) {
            const auto& rgb = table[(static_cast<double>(from[x]) - low) / (high - low)];
            for (int c = 0; c < 3; ++c) out.view().row(c, y)[x] = rgb[static_cast<std::size_t>(c)];
        }
    });
    return out;
}

} // namespace rayloom
