// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/planes.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace rayloom::oracle
{

namespace
{

constexpr double own_weight = 1e-3, boundary_weight = 0.01;

/// The next size that is tried; a last one that would be little larger is the largest itself.
int next_radius(const PlaneOptions& o, int r)
{
    const int next = r + std::max(1, static_cast<int>(o.growth * r));
    const bool near_end = next > o.max_radius || (o.growth > 0.0 && 6 * next > 5 * o.max_radius);
    return r < o.max_radius && near_end ? o.max_radius : next;
}

double light_of(const Raster<double>& z, int x, int y)
{
    double sum = 0.0;
    for (int c = 0; c < z.channels; ++c) sum += z.at(c, x, y);
    return sum / z.channels;
}

/// Variance of the mean of the colours, whose noise is taken to be fully correlated.
double variance_of(const Raster<double>& v, int x, int y)
{
    double sum = 0.0;
    for (int c = 0; c < v.channels; ++c) sum += std::sqrt(std::max(0.0, v.at(c, x, y)));
    return std::pow(sum / v.channels, 2);
}

/// The root of the pivot's brightest colour.
double pivot_weight(const PlaneInput& in, int x, int y)
{
    if (!in.pivot) return 1.0;
    double most = 0.0;
    for (int c = 0; c < in.pivot->channels; ++c) most = std::max(most, in.pivot->at(c, x, y));
    return std::sqrt(std::min(most, 1.0));
}

/// Of a centre's planes: that of its pivot, and little on boundaries.
double centre_weight(const PlaneInput& in, int x, int y)
{
    const double open = in.boundary ? 1.0 - in.boundary->at(0, x, y) : 1.0;
    return std::max(open, boundary_weight) * pivot_weight(in, x, y);
}

/// e^−σ, 0 for pixels that are left out.
double source_weight(const PlaneInput& in, const PlaneOptions& o, int x, int y)
{
    double light = 0.0, variance = 0.0;
    int n = 0;
    for (int v = std::max(0, y - 2); v <= std::min(in.z.height - 1, y + 2); ++v)
        for (int u = std::max(0, x - 2); u <= std::min(in.z.width - 1, x + 2); ++u) {
            light += light_of(in.z, u, v);
            variance += variance_of(in.variance, u, v);
            ++n;
        }
    const double sigma =
        variance > 0.0 && light > 0.0 ? std::sqrt(variance / n) / (light / n) : 0.0;
    if (sigma > o.max_noise) return 0.0;
    return pivot_weight(in, x, y) * std::exp(-sigma);
}

struct Sample {
    double dx, dy, weight, variance;
    std::vector<double> z;
};

struct Fitted {
    std::vector<std::array<double, 3>> plane;
    double light = 0.0, variance = 0.0;
};

Fitted fit(const std::vector<Sample>& samples, int colours)
{
    Fitted result;
    result.plane.assign(static_cast<std::size_t>(colours), {0.0, 0.0, 0.0});
    Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
    double noise = 0.0;
    for (const Sample& s : samples) {
        const Eigen::Vector3d p(s.dx, s.dy, 1.0);
        m += s.weight * p * p.transpose();
        noise += s.weight * s.weight * s.variance;
    }
    const double sum = m(2, 2);
    const double x = m(0, 2) / sum, y = m(1, 2) / sum;
    const double xx = m(0, 0) - x * x * sum, yy = m(1, 1) - y * y * sum, xy = m(0, 1) - x * y * sum;
    const bool spread = samples.size() >= 3 && xx > 0.1 * sum && yy > 0.1 * sum &&
                        xx * yy - xy * xy > 0.01 * xx * yy;
    double inverse = 1.0 / sum;
    if (spread) inverse = m.inverse()(2, 2);
    for (int c = 0; c < colours; ++c) {
        Eigen::Vector3d right = Eigen::Vector3d::Zero();
        for (const Sample& s : samples)
            right += s.weight * s.z[static_cast<std::size_t>(c)] * Eigen::Vector3d(s.dx, s.dy, 1.0);
        Eigen::Vector3d k(0.0, 0.0, right(2) / sum);
        if (spread) k = m.fullPivLu().solve(right);
        result.plane[static_cast<std::size_t>(c)] = {k(0), k(1), k(2)};
        result.light += k(2) / colours;
    }
    result.variance = noise / sum * inverse;
    return result;
}

/// The pixels of the square and of its quadrants, with their weights (equation 10).
std::array<std::vector<Sample>, 5> samples_around(const PlaneInput& in, const PlaneOptions& o,
                                                  int x, int y, int r)
{
    struct Pixel {
        int dx, dy;
        double guide;
    };
    std::vector<Pixel> pixels;
    double weights = 0.0, mean = 0.0, variance = 0.0;
    for (int dy = -r; dy <= r; ++dy)
        for (int dx = -r; dx <= r; ++dx) {
            const int u = x + dx, v = y + dy;
            if (u < 0 || v < 0 || u >= in.z.width || v >= in.z.height) continue;
            double guide = guide_weight(in, x, y, u, v) * source_weight(in, o, u, v);
            if (dx == 0 && dy == 0) guide = std::max(guide, own_weight);
            if (guide <= 0.0) continue;
            pixels.push_back({dx, dy, guide});
            weights += guide;
            mean += guide * light_of(in.z, u, v);
            variance += guide * variance_of(in.variance, u, v);
        }
    mean /= weights;
    const double scale = mean + (o.range_by_noise ? std::sqrt(variance / weights) : 0.0);
    std::array<std::vector<Sample>, 5> samples;
    for (const Pixel& p : pixels) {
        const int u = x + p.dx, v = y + p.dy;
        const double range =
            scale > 0.0 ? o.range * std::abs(light_of(in.z, u, v) - mean) / scale : 0.0;
        Sample s{static_cast<double>(p.dx),
                 static_cast<double>(p.dy),
                 p.guide *
                     std::exp(-range - (p.dx * p.dx + p.dy * p.dy) / static_cast<double>(r * r)),
                 variance_of(in.variance, u, v),
                 {}};
        for (int c = 0; c < in.z.channels; ++c) s.z.push_back(in.z.at(c, u, v));
        samples[0].push_back(s);
        for (int q = 0; q < 4; ++q) {
            const bool in_x = (q & 1) != 0 ? p.dx <= 0 : p.dx >= 0;
            const bool in_y = (q & 2) != 0 ? p.dy <= 0 : p.dy >= 0;
            if (in_x && in_y) samples[static_cast<std::size_t>(q + 1)].push_back(s);
        }
    }
    return samples;
}

} // namespace

double guide_weight(const PlaneInput& in, int x, int y, int u, int v)
{
    double weight = 1.0;
    if (in.normal) {
        double dot = 0.0, a = 0.0, b = 0.0;
        for (int c = 0; c < 3; ++c) {
            dot += in.normal->at(c, x, y) * in.normal->at(c, u, v);
            a += std::pow(in.normal->at(c, x, y), 2);
            b += std::pow(in.normal->at(c, u, v), 2);
        }
        const bool has_a = std::isfinite(a) && a > 0.0025, has_b = std::isfinite(b) && b > 0.0025;
        if (has_a != has_b) return 0.0;
        if (has_a) {
            dot /= std::sqrt(a * b);
            weight *= dot > 0.5 ? std::pow(dot, 4) : 0.0;
        }
    }
    if (in.parts) {
        double shared = 0.0;
        for (int i = 0; i < in.parts->channels; i += 2)
            for (int j = 0; j < in.parts->channels; j += 2)
                if (in.parts->at(i, x, y) == in.parts->at(j, u, v))
                    shared += std::min(in.parts->at(i + 1, x, y), in.parts->at(j + 1, u, v));
        weight *= std::min(1.0, shared);
    }
    return weight;
}

bool grows_on(const PlaneInput& in, const PlaneOptions& o, int x, int y)
{
    const auto on_lattice = [&](int u, int v) {
        return (u + in.x0) % o.stride == 0 && (v + in.y0) % o.stride == 0;
    };
    if (o.stride == 1) return true;
    if (centre_weight(in, x, y) <= 0.0) return false;
    if (on_lattice(x, y)) return true;
    for (int v = y - o.stride + 1; v < y + o.stride; ++v)
        for (int u = x - o.stride + 1; u < x + o.stride; ++u) {
            if (u < 0 || v < 0 || u >= in.z.width || v >= in.z.height || !on_lattice(u, v))
                continue;
            if (guide_weight(in, x, y, u, v) * centre_weight(in, u, v) >=
                0.5 * centre_weight(in, x, y))
                return false;
        }
    return true;
}

CentrePlanes fit_centre(const PlaneInput& in, const PlaneOptions& o, int x, int y)
{
    const int colours = in.z.channels;
    CentrePlanes result;
    for (int r = o.min_radius; r <= o.max_radius; r = next_radius(o, r)) {
        const std::array<std::vector<Sample>, 5> samples = samples_around(in, o, x, y, r);
        std::array<Fitted, 5> fits;
        for (std::size_t i = 0; i < 5; ++i) fits[i] = fit(samples[i], colours);
        bool uneven = false;
        for (std::size_t i = 1; i < 5; ++i)
            uneven = uneven || std::abs(fits[0].light - fits[i].light) >
                                   o.variation * std::abs(fits[0].light) +
                                       o.confidence * std::sqrt(fits[i].variance);
        if (uneven && r > o.min_radius) break;
        result.radius = r;
        const double error = std::sqrt(fits[0].variance), level = std::abs(fits[0].light);
        result.noise = level > 0.0 ? error / level : 0.0;
        for (std::size_t i = 0; i < 5; ++i) result.planes[i] = fits[i].plane;
        if (uneven || error <= o.target_noise * level) break;
        if (r < o.max_radius && next_radius(o, r) > o.dense && !grows_on(in, o, x, y)) {
            result.radius = 0;
            break;
        }
    }
    return result;
}

std::array<PlaneSystem, 5> plane_systems(const PlaneInput& in, const PlaneOptions& o, int x, int y,
                                         int radius)
{
    using Matrix = Eigen::Matrix<long double, 3, 3>;
    using Vector = Eigen::Matrix<long double, 3, 1>;
    std::array<PlaneSystem, 5> systems;
    const std::array<std::vector<Sample>, 5> samples = samples_around(in, o, x, y, radius);
    for (std::size_t i = 0; i < 5; ++i) {
        PlaneSystem& system = systems[i];
        Matrix m = Matrix::Zero();
        for (const Sample& s : samples[i]) {
            const Vector p(s.dx, s.dy, 1.0);
            m += s.weight * p * p.transpose();
        }
        const auto values = Eigen::SelfAdjointEigenSolver<Matrix>(m).eigenvalues();
        system.condition = static_cast<double>(values(2) / std::max(values(0), 1e-30L));
        const long double sum = m(2, 2), xx = m(0, 0) - m(0, 2) * m(0, 2) / sum,
                          yy = m(1, 1) - m(1, 2) * m(1, 2) / sum,
                          xy = m(0, 1) - m(0, 2) * m(1, 2) / sum;
        system.spread = static_cast<double>(
            std::min({10 * xx / sum, 10 * yy / sum, 100 * (1 - xy * xy / (xx * yy))}));
        for (std::size_t c = 0; c < static_cast<std::size_t>(in.z.channels); ++c) {
            Vector right = Vector::Zero();
            for (const Sample& s : samples[i]) right += s.weight * s.z[c] * Vector(s.dx, s.dy, 1.0);
            const Vector k = m.fullPivLu().solve(right);
            system.plane.push_back(
                {static_cast<double>(k(0)), static_cast<double>(k(1)), static_cast<double>(k(2))});
            system.mean.push_back(static_cast<double>(right(2) / sum));
        }
    }
    return systems;
}

std::vector<CentrePlanes> fit_all(const PlaneInput& in, const PlaneOptions& o)
{
    std::vector<CentrePlanes> all;
    for (int y = 0; y < in.z.height; ++y)
        for (int x = 0; x < in.z.width; ++x) all.push_back(fit_centre(in, o, x, y));
    return all;
}

Raster<double> fuse_all(const PlaneInput& in, const PlaneOptions& o,
                        const std::vector<CentrePlanes>& centres)
{
    const int width = in.z.width, height = in.z.height, colours = in.z.channels;
    Raster<double> sums(width, height, colours), weights(width, height, 1);
    // As the paper has it: each centre adds to every pixel of its square.
    for (int cy = 0; cy < height; ++cy)
        for (int cx = 0; cx < width; ++cx) {
            const CentrePlanes& k = centres[static_cast<std::size_t>(cy * width + cx)];
            const double source = centre_weight(in, cx, cy);
            for (int dy = -k.radius; dy <= k.radius; ++dy)
                for (int dx = -k.radius; dx <= k.radius; ++dx) {
                    const int x = cx + dx, y = cy + dy;
                    if (x < 0 || y < 0 || x >= width || y >= height) continue;
                    const bool own = dx == 0 && dy == 0;
                    double guide = guide_weight(in, x, y, cx, cy) * source;
                    if (own) guide = k.radius > 0 ? std::max(guide, own_weight) : own_weight;
                    std::vector<int> quadrants;
                    for (int q = 0; q < 4; ++q)
                        if (((q & 1) != 0 ? dx <= 0 : dx >= 0) &&
                            ((q & 2) != 0 ? dy <= 0 : dy >= 0))
                            quadrants.push_back(q);
                    for (const int q : quadrants) {
                        const auto value = [&](int plane, int c) {
                            const auto& p = k.planes[static_cast<std::size_t>(plane)]
                                                    [static_cast<std::size_t>(c)];
                            return p[0] * dx + p[1] * dy + p[2];
                        };
                        double whole = 0.0, part = 0.0;
                        for (int c = 0; c < colours; ++c) {
                            whole += value(0, c);
                            part += value(q + 1, c);
                        }
                        const bool positive = whole > 0.0 && part > 0.0;
                        const double ratio =
                            positive ? std::pow(std::min(whole / part, part / whole), 8) : 0.0;
                        double w = guide / static_cast<double>(quadrants.size()) *
                                   (own ? std::max(ratio, own_weight) : ratio);
                        if (!(w > 0.0)) continue;
                        double wm = 0.0;
                        if (positive) wm = o.blend_max ? 1.0 / ratio : ratio;
                        weights.at(0, x, y) += w;
                        for (int c = 0; c < colours; ++c)
                            sums.at(c, x, y) +=
                                w * (value(0, c) + wm * value(q + 1, c)) / (1.0 + wm);
                    }
                }
        }
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < colours; ++c)
                sums.at(c, x, y) = std::max(0.0, sums.at(c, x, y) / weights.at(0, x, y));
    return sums;
}

} // namespace rayloom::oracle
