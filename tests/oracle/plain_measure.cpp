// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/plain_nodes.h"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace rayloom::oracle
{

namespace
{

using Colour = Eigen::Vector3d;

/// One channel.
using Plane = Raster<double>;

double clamped(double v) { return std::clamp(v, 0.0, 1.0); }

double luminance(const Raster<double>& image, int x, int y)
{
    return 0.2126 * clamped(image.at(0, x, y)) + 0.7152 * clamped(image.at(1, x, y)) +
           0.0722 * clamped(image.at(2, x, y));
}

double to_srgb(double v)
{
    return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1.0 / 2.4) - 0.055;
}

/// The full two-dimensional sum over an odd square kernel, edge pixels repeated.
Plane correlated(const Plane& in, const Plane& kernel)
{
    const int r = kernel.width / 2;
    return make_raster(in, 1, [&](int, int x, int y) {
        double sum = 0.0;
        for (int j = -r; j <= r; ++j)
            for (int i = -r; i <= r; ++i)
                sum += kernel.at(0, i + r, j + r) * in.at(0, std::clamp(x + i, 0, in.width - 1),
                                                          std::clamp(y + j, 0, in.height - 1));
        return sum;
    });
}

/// SSIM of Wang et al. 2004: Gaussian window of 11×11 with σ = 1.5, K₁ = 0.01, K₂ = 0.03, on the
/// luminance through sRGB's transfer; the mean over all windows inside the image.
double plain_ssim(const Raster<double>& image, const Raster<double>& reference)
{
    constexpr int r = 5;
    const auto grey = [](const Raster<double>& from) {
        return make_raster(from, 1,
                           [&](int, int x, int y) { return to_srgb(luminance(from, x, y)); });
    };
    const Plane a = grey(image), b = grey(reference);
    double total = 0.0, norm = 0.0;
    int windows = 0;
    const auto weight = [](int i, int j) { return std::exp(-(i * i + j * j) / (2.0 * 1.5 * 1.5)); };
    for (int j = -r; j <= r; ++j)
        for (int i = -r; i <= r; ++i) norm += weight(i, j);
    for (int y = r; y < a.height - r; ++y)
        for (int x = r; x < a.width - r; ++x, ++windows) {
            double mean_a = 0.0, mean_b = 0.0, aa = 0.0, bb = 0.0, ab = 0.0;
            for (int j = -r; j <= r; ++j)
                for (int i = -r; i <= r; ++i) {
                    mean_a += weight(i, j) / norm * a.at(0, x + i, y + j);
                    mean_b += weight(i, j) / norm * b.at(0, x + i, y + j);
                }
            for (int j = -r; j <= r; ++j)
                for (int i = -r; i <= r; ++i) {
                    const double da = a.at(0, x + i, y + j) - mean_a;
                    const double db = b.at(0, x + i, y + j) - mean_b;
                    aa += weight(i, j) / norm * da * da;
                    bb += weight(i, j) / norm * db * db;
                    ab += weight(i, j) / norm * da * db;
                }
            total += (2.0 * mean_a * mean_b + 1e-4) * (2.0 * ab + 9e-4) /
                     ((mean_a * mean_a + mean_b * mean_b + 1e-4) * (aa + bb + 9e-4));
        }
    return total / windows;
}

/// LDR-FLIP of Andersson et al. 2020 at the distance its authors suggest.
class Flip
{
public:
    Flip()
    {
        m_to_xyz << 10135552.0 / 24577794, 8788810.0 / 24577794, 4435075.0 / 24577794,
            2613072.0 / 12288897, 8788810.0 / 12288897, 887015.0 / 12288897, 1425312.0 / 73733382,
            8788810.0 / 73733382, 70074185.0 / 73733382;
        m_white = m_to_xyz * Colour::Ones();
        m_contrast = {contrast_kernel({{1.0, 0.0047}}), contrast_kernel({{1.0, 0.0053}}),
                      contrast_kernel({{34.1, 0.04}, {13.5, 0.025}})};
        const double deviation = 0.5 * 0.082 * pixels_per_degree;
        m_edge = feature_kernel(deviation, [](double x, double) { return -x; });
        m_point =
            feature_kernel(deviation, [](double x, double s) { return x * x / (s * s) - 1.0; });
    }

    Plane map(const Raster<double>& image, const Raster<double>& reference) const
    {
        const Seen a = see(image), b = see(reference);
        const double most =
            std::pow(hyab(hunt_lab(Colour(0, 1, 0)), hunt_lab(Colour(0, 0, 1))), 0.7);
        return make_raster(image, 1, [&](int, int x, int y) {
            const auto colour = [&](const Seen& s) {
                return Colour(s.lab.at(0, x, y), s.lab.at(1, x, y), s.lab.at(2, x, y));
            };
            const double e = std::pow(hyab(colour(a), colour(b)), 0.7);
            const double difference = e < 0.4 * most
                                          ? 0.95 / (0.4 * most) * e
                                          : 0.95 + (e - 0.4 * most) / (most - 0.4 * most) * 0.05;
            const double feature = std::max(std::abs(a.edges.at(0, x, y) - b.edges.at(0, x, y)),
                                            std::abs(a.points.at(0, x, y) - b.points.at(0, x, y)));
            return std::pow(difference, 1.0 - std::sqrt(feature / std::sqrt(2.0)));
        });
    }

private:
    /// A 0.7 m wide screen of 3840 pixels at 0.7 m.
    static constexpr double pixels_per_degree = 3840.0 * std::numbers::pi / 180.0;

    /// What is left of an image after the eye's contrast filters, and its features.
    struct Seen {
        Raster<double> lab;
        Plane edges, points;
    };

    static Plane square(int radius) { return Plane(2 * radius + 1, 2 * radius + 1, 1); }

    static Plane contrast_kernel(const std::vector<std::pair<double, double>>& terms)
    {
        constexpr double pi = std::numbers::pi;
        const int r = static_cast<int>(
            std::ceil(3.0 * std::sqrt(0.04 / (2.0 * pi * pi)) * pixels_per_degree));
        Plane kernel = square(r);
        double sum = 0.0;
        for (int j = -r; j <= r; ++j)
            for (int i = -r; i <= r; ++i) {
                const double d = (i * i + j * j) / pixels_per_degree / pixels_per_degree;
                double& k = kernel.at(0, i + r, j + r);
                for (const auto& [a, b] : terms)
                    k += a * std::sqrt(pi / b) * std::exp(-pi * pi * d / b);
                sum += k;
            }
        for (double& k : kernel.values) k /= sum;
        return kernel;
    }

    template <class Factor>
    static Plane feature_kernel(double deviation, const Factor& factor)
    {
        const int r = static_cast<int>(std::ceil(3.0 * deviation));
        Plane kernel = square(r);
        double positive = 0.0, negative = 0.0;
        for (int j = -r; j <= r; ++j)
            for (int i = -r; i <= r; ++i) {
                const double k = factor(i, deviation) *
                                 std::exp(-(i * i + j * j) / (2.0 * deviation * deviation));
                kernel.at(0, i + r, j + r) = k;
                (k > 0.0 ? positive : negative) += std::abs(k);
            }
        for (double& k : kernel.values) k /= k > 0.0 ? positive : negative;
        return kernel;
    }

    static Plane turned(const Plane& kernel)
    {
        return make_raster(kernel, 1, [&](int, int x, int y) { return kernel.at(0, y, x); });
    }

    Colour hunt_lab(const Colour& rgb) const
    {
        const Colour t = (m_to_xyz * rgb).cwiseQuotient(m_white);
        const double d = 6.0 / 29.0;
        const auto f = [d](double v) {
            return v > d * d * d ? std::cbrt(v) : v / (3.0 * d * d) + 4.0 / 29.0;
        };
        const double lightness = 116.0 * f(t.y()) - 16.0;
        return {lightness, 0.01 * lightness * 500.0 * (f(t.x()) - f(t.y())),
                0.01 * lightness * 200.0 * (f(t.y()) - f(t.z()))};
    }

    static double hyab(const Colour& a, const Colour& b)
    {
        const Colour d = a - b;
        return std::abs(d.x()) + std::hypot(d.y(), d.z());
    }

    Seen see(const Raster<double>& image) const
    {
        std::array<Plane, 3> opponent; // Y Cx Cz
        for (Plane& plane : opponent) plane = Plane(image.width, image.height, 1);
        for (int y = 0; y < image.height; ++y)
            for (int x = 0; x < image.width; ++x) {
                const Colour rgb(clamped(image.at(0, x, y)), clamped(image.at(1, x, y)),
                                 clamped(image.at(2, x, y)));
                const Colour t = (m_to_xyz * rgb).cwiseQuotient(m_white);
                opponent[0].at(0, x, y) = 116.0 * t.y() - 16.0;
                opponent[1].at(0, x, y) = 500.0 * (t.x() - t.y());
                opponent[2].at(0, x, y) = 200.0 * (t.y() - t.z());
            }
        const Plane grey = make_raster(
            image, 1, [&](int, int x, int y) { return (opponent[0].at(0, x, y) + 16.0) / 116.0; });
        const auto length = [&](const Plane& kernel) {
            const Plane h = correlated(grey, kernel), v = correlated(grey, turned(kernel));
            return make_raster(image, 1, [&](int, int x, int y) {
                return std::hypot(h.at(0, x, y), v.at(0, x, y));
            });
        };
        for (std::size_t i = 0; i < 3; ++i) opponent[i] = correlated(opponent[i], m_contrast[i]);
        Seen seen{Raster<double>(image.width, image.height, 3), length(m_edge), length(m_point)};
        const Eigen::Matrix3d to_rgb = m_to_xyz.inverse();
        for (int y = 0; y < image.height; ++y)
            for (int x = 0; x < image.width; ++x) {
                const double t = (opponent[0].at(0, x, y) + 16.0) / 116.0;
                const Colour xyz(t + opponent[1].at(0, x, y) / 500.0, t,
                                 t - opponent[2].at(0, x, y) / 200.0);
                const Colour rgb = (to_rgb * xyz.cwiseProduct(m_white)).cwiseMax(0.0).cwiseMin(1.0);
                const Colour lab = hunt_lab(rgb);
                for (int c = 0; c < 3; ++c) seen.lab.at(c, x, y) = lab(c);
            }
        return seen;
    }

    Eigen::Matrix3d m_to_xyz;
    Colour m_white;
    std::array<Plane, 3> m_contrast;
    Plane m_edge, m_point;
};

} // namespace

PlainResult plain_bound(const PlainInput& in)
{
    const Raster<double>&low = in.image("low"), &high = in.image("high");
    PlainResult out;
    out.images["bound"] = {make_raster(
        low, 3, [&](int c, int x, int y) { return high.at(c, x, y) - low.at(c, x, y); })};
    return out;
}

PlainResult plain_coverage(const PlainInput& in)
{
    const Raster<double>&low = in.image("low"), &high = in.image("high"),
          &reference = in.image("reference"), &image = in.image("image");
    PlainResult out;
    auto& columns = out.tables["figures"];
    const std::array<std::string, 3> names{"R", "G", "B"};
    double all_inside = 0.0, all_bound = 0.0;
    for (int c = 0; c < 3; ++c) {
        double inside = 0.0, bound = 0.0;
        for (int y = 0; y < low.height; ++y)
            for (int x = 0; x < low.width; ++x) {
                const double truth = reference.at(c, x, y);
                const double width = high.at(c, x, y) - low.at(c, x, y);
                inside += low.at(c, x, y) <= truth && truth <= high.at(c, x, y) ? 1.0 : 0.0;
                bound += std::abs(image.at(c, x, y) - truth) <= width ? 1.0 : 0.0;
            }
        const double pixels = low.width * low.height;
        columns["interval_" + names[static_cast<std::size_t>(c)]] = {inside / pixels};
        columns["bound_" + names[static_cast<std::size_t>(c)]] = {bound / pixels};
        all_inside += inside / pixels / 3.0;
        all_bound += bound / pixels / 3.0;
    }
    columns["interval"] = {all_inside};
    columns["bound"] = {all_bound};
    return out;
}

PlainResult plain_channels(const PlainInput& in)
{
    const Raster<double>& image = in.image("image");
    PlainResult out;
    auto& columns = out.tables["figures"];
    const double n = image.width * image.height;
    for (int c = 0; c < 3; ++c) {
        double least = image.at(c, 0, 0), most = least, sum = 0.0, squares = 0.0;
        const auto each = [&](const auto& visit) {
            for (int y = 0; y < image.height; ++y)
                for (int x = 0; x < image.width; ++x) visit(image.at(c, x, y));
        };
        each([&](double v) {
            least = std::min(least, v);
            most = std::max(most, v);
            sum += v;
        });
        each([&](double v) { squares += (v - sum / n) * (v - sum / n); });
        columns["minimum"].push_back(least);
        columns["maximum"].push_back(most);
        columns["mean"].push_back(sum / n);
        columns["deviation"].push_back(std::sqrt(squares / n));
        columns["finite"].push_back(n);
    }
    return out;
}

PlainResult plain_error(const PlainInput& in)
{
    const Raster<double>&image = in.image("image"), &reference = in.image("reference");
    double squares = 0.0, relative = 0.0, smape = 0.0, most = 0.0;
    for (std::size_t i = 0; i < image.values.size(); ++i) {
        const double d = image.values[i], r = reference.values[i];
        squares += (d - r) * (d - r);
        relative += (d - r) * (d - r) / (r * r + 0.01);
        smape += std::abs(d - r) / (std::abs(d) + std::abs(r) + 0.01);
        most = std::max(most, std::abs(d - r));
    }
    const auto n = static_cast<double>(image.values.size());
    const Plane map = Flip().map(image, reference);
    double flip = 0.0;
    for (const double v : map.values) flip += v / static_cast<double>(map.values.size());
    PlainResult out;
    out.images["map"] = {map};
    out.tables["errors"] = {{"rmse", {std::sqrt(squares / n)}},
                            {"relmse", {relative / n}},
                            {"smape", {smape / n}},
                            {"psnr", {-10.0 * std::log10(squares / n)}},
                            {"max_abs_error", {most}},
                            {"ssim", {plain_ssim(image, reference)}},
                            {"flip", {flip}}};
    return out;
}

} // namespace rayloom::oracle
