// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/flip.h"

#include "rayloom/core/error.h"
#include "rayloom/stats/separable.h"

#include <Eigen/Dense>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace rayloom
{

namespace
{

constexpr double pi = std::numbers::pi;
constexpr double colour_exponent = 0.7; // q_c
constexpr double break_share = 0.4;     // p_c
constexpr double break_value = 0.95;    // p_t
constexpr double feature_width = 0.082; // w, degrees
constexpr double display_target = 0.85; // t of HDR-FLIP

/// One term a·√(π/b)·exp(−π²·x²/b) of a contrast sensitivity function, x in degrees.
struct CsfTerm {
    double a, b;
};
constexpr CsfTerm csf_achromatic{1.0, 0.0047}, csf_red_green{1.0, 0.0053};
constexpr CsfTerm csf_blue_yellow[2] = {{34.1, 0.04}, {13.5, 0.025}};

using Matrix = Eigen::Matrix3d;

/// Linear sRGB to CIE XYZ relative to the white point (so that white is 1, 1, 1).
Matrix rgb_to_relative_xyz()
{
    Matrix m;
    m << 10135552.0 / 24577794.0, 8788810.0 / 24577794.0, 4435075.0 / 24577794.0,
        2613072.0 / 12288897.0, 8788810.0 / 12288897.0, 887015.0 / 12288897.0,
        1425312.0 / 73733382.0, 8788810.0 / 73733382.0, 70074185.0 / 73733382.0;
    for (int i = 0; i < 3; ++i) m.row(i) /= m.row(i).sum();
    return m;
}

/// Relative XYZ to Y, Cx, Cz without the constant −16 of Y: filters sum to one, so it comes and
/// goes unchanged.
Matrix relative_xyz_to_opponent()
{
    Matrix m;
    m << 0.0, 116.0, 0.0, 500.0, -500.0, 0.0, 0.0, 200.0, -200.0;
    return m;
}

/// Plain arrays for the pixel loops.
struct Coefficients {
    double m[3][3];

    explicit Coefficients(const Matrix& from)
    {
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) m[i][j] = from(i, j);
    }
    void apply(double a, double b, double c, double out[3]) const
    {
        for (int i = 0; i < 3; ++i) out[i] = m[i][0] * a + m[i][1] * b + m[i][2] * c;
    }
};

struct Colours {
    Coefficients rgb_to_xyz, rgb_to_opponent, opponent_to_rgb;
    double largest_difference = 0.0; ///< c_max: green against blue, to the power q_c

    Colours();
};

/// Cube root of a positive number of ordinary size, to two units in the last place; a third of the
/// cost of the library's, which caters for every double. A third of the exponent from the bits of
/// the float, then Halley's iteration, which cubes the relative error (4 % → 4e-5 → 4e-14 → none).
double cube_root(double x)
{
    const auto bits = std::bit_cast<std::uint32_t>(static_cast<float>(x));
    double y = static_cast<double>(std::bit_cast<float>(bits / 3 + 0x2a514067u));
    for (int i = 0; i < 3; ++i) {
        const double cube = y * y * y;
        y *= (cube + 2.0 * x) / (2.0 * cube + x);
    }
    return y;
}

double lab_curve(double t)
{
    constexpr double delta = 6.0 / 29.0;
    return t > delta * delta * delta ? cube_root(t) : t / (3.0 * delta * delta) + 4.0 / 29.0;
}

/// Linear sRGB to L*, a*, b* with a*, b* scaled by the Hunt effect.
void hunt_lab(const Coefficients& to_xyz, const double rgb[3], double lab[3])
{
    double xyz[3];
    to_xyz.apply(rgb[0], rgb[1], rgb[2], xyz);
    const double fx = lab_curve(xyz[0]), fy = lab_curve(xyz[1]), fz = lab_curve(xyz[2]);
    lab[0] = 116.0 * fy - 16.0;
    lab[1] = 0.01 * lab[0] * (500.0 * (fx - fy));
    lab[2] = 0.01 * lab[0] * (200.0 * (fy - fz));
}

double hyab(const double p[3], const double q[3])
{
    const double a = p[1] - q[1], b = p[2] - q[2];
    return std::abs(p[0] - q[0]) + std::sqrt(a * a + b * b);
}

Colours::Colours()
    : rgb_to_xyz(rgb_to_relative_xyz()),
      rgb_to_opponent(relative_xyz_to_opponent() * rgb_to_relative_xyz()),
      opponent_to_rgb((relative_xyz_to_opponent() * rgb_to_relative_xyz()).inverse())
{
    const double green[3] = {0.0, 1.0, 0.0}, blue[3] = {0.0, 0.0, 1.0};
    double green_lab[3], blue_lab[3];
    hunt_lab(rgb_to_xyz, green, green_lab);
    hunt_lab(rgb_to_xyz, blue, blue_lab);
    largest_difference = std::pow(hyab(green_lab, blue_lab), colour_exponent);
}

double redistribute(double error, double largest)
{
    const double at = break_share * largest;
    return error < at ? break_value / at * error
                      : break_value + (error - at) / (largest - at) * (1.0 - break_value);
}

/// Coefficients of (k0·x² + k1·x + k2) / (k3·x² + k4·x + k5).
struct RationalCurve {
    double k0, k1, k2, k3, k4, k5;

    double operator()(double x) const
    {
        const double top = k0 * x * x + k1 * x + k2, bottom = k3 * x * x + k4 * x + k5;
        return std::isinf(bottom) ? 1.0 : std::clamp(top / bottom, 0.0, 1.0);
    }
    /// The x ≥ 0 that is mapped to y.
    double inverse(double y) const
    {
        const double a = k0 - k3 * y, b = k1 - k4 * y, c = k2 - k5 * y;
        if (a == 0.0) return -c / b;
        const double p = 0.5 * b / a;
        return -p + std::sqrt(p * p - c / a);
    }
};

RationalCurve tone_curve(ToneMapper mapper)
{
    switch (mapper) {
    case ToneMapper::aces: {
        constexpr double pre = 0.6; // the fit's own exposure, taken out again
        return {pre * pre * 2.51, pre * 0.03, 0.0, pre * pre * 2.43, pre * 0.59, 0.14};
    }
    case ToneMapper::hable: {
        constexpr double a = 0.15, b = 0.50, c = 0.10, d = 0.20, e = 0.02, f = 0.30, white = 11.2;
        constexpr double bias = 2.0;
        const RationalCurve plain{a * f - a * e, c * b * f - b * e, 0.0, a * f, b * f, d * f * f};
        const double scale = (plain.k3 * white * white + plain.k4 * white + plain.k5) /
                             (plain.k0 * white * white + plain.k1 * white + plain.k2);
        return {bias * bias * plain.k0 * scale, bias * plain.k1 * scale, 0.0,
                bias * bias * plain.k3,         bias * plain.k4,         plain.k5};
    }
    case ToneMapper::reinhard: return {0.0, 1.0, 0.0, 0.0, 1.0, 1.0};
    case ToneMapper::none: break;
    }
    return {0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
}

/// Brings rows of linear radiance to the display, in place.
class Display
{
public:
    explicit Display(const Exposure& exposure)
        : m_mapper(exposure.mapper), m_gain(std::exp2(exposure.stops)),
          m_curve(tone_curve(exposure.mapper))
    {
    }
    void map(double* r, double* g, double* b, int n) const
    {
        double* planes[3] = {r, g, b};
        if (m_mapper == ToneMapper::reinhard) {
            for (int i = 0; i < n; ++i) {
                double luminance = 0.0;
                for (int c = 0; c < 3; ++c) {
                    planes[c][i] = m_gain * std::max(planes[c][i], 0.0);
                    luminance += luminance_weights[c] * planes[c][i];
                }
                for (double* plane : planes)
                    plane[i] = std::clamp(plane[i] / (1.0 + luminance), 0.0, 1.0);
            }
        } else if (m_mapper == ToneMapper::none) {
            for (double* plane : planes)
                for (int i = 0; i < n; ++i) plane[i] = std::clamp(m_gain * plane[i], 0.0, 1.0);
        } else {
            for (double* plane : planes)
                for (int i = 0; i < n; ++i) plane[i] = m_curve(m_gain * std::max(plane[i], 0.0));
        }
    }

private:
    ToneMapper m_mapper;
    double m_gain;
    RationalCurve m_curve;
};

/// Half of a symmetric kernel, scaled so that all its taps sum to one.
std::vector<double> unit_sum(std::vector<double> half)
{
    double sum = half[0];
    for (std::size_t k = 1; k < half.size(); ++k) sum += 2.0 * half[k];
    for (double& w : half) w /= sum;
    return half;
}

std::vector<double> csf_taps(const CsfTerm& term, int radius, double pixels_per_degree)
{
    std::vector<double> half;
    for (int k = 0; k <= radius; ++k) {
        const double x = k / pixels_per_degree;
        half.push_back(std::exp(-pi * pi * x * x / term.b));
    }
    return half;
}

double total(const std::vector<double>& half)
{
    double sum = half[0];
    for (std::size_t k = 1; k < half.size(); ++k) sum += 2.0 * half[k];
    return sum;
}

double norm(double a, double b) { return std::sqrt(a * a + b * b); }

} // namespace

const char* tone_mapper_name(ToneMapper mapper)
{
    switch (mapper) {
    case ToneMapper::aces: return "aces";
    case ToneMapper::hable: return "hable";
    case ToneMapper::reinhard: return "reinhard";
    case ToneMapper::none: break;
    }
    return "none";
}

ExposureRange flip_exposures(std::span<double> luminance, ToneMapper mapper)
{
    for (double& y : luminance) y = std::max(y, 0.0);
    const auto median = [](std::span<double> values) {
        const std::size_t upper = values.size() / 2;
        const auto middle = values.begin() + static_cast<std::ptrdiff_t>(upper);
        std::nth_element(values.begin(), middle, values.end());
        if (values.size() % 2 == 1) return *middle;
        return 0.5 * (*middle + *std::max_element(values.begin(), middle));
    };
    if (luminance.empty()) return {};
    const double highest = *std::max_element(luminance.begin(), luminance.end());
    if (highest == 0.0) return {};
    double middle = median(luminance);
    if (middle == 0.0) {
        const auto positive =
            std::partition(luminance.begin(), luminance.end(), [](double y) { return y == 0.0; });
        middle = median({positive, luminance.end()});
    }
    const double x = tone_curve(mapper).inverse(display_target);
    ExposureRange range;
    range.start = std::log2(x / highest);
    range.stop = std::log2(x / middle);
    range.count = std::max(2, static_cast<int>(std::ceil(range.stop - range.start)));
    return range;
}

Flip::Flip(double pixels_per_degree)
{
    if (!(pixels_per_degree >= 1.0 && pixels_per_degree <= 1000.0))
        throw NodeError("FLIP needs 1 to 1000 pixels per degree, not " +
                        std::to_string(pixels_per_degree));
    const double widest =
        std::max({csf_achromatic.b, csf_red_green.b, csf_blue_yellow[0].b, csf_blue_yellow[1].b});
    const int colour_radius =
        static_cast<int>(std::ceil(3.0 * std::sqrt(widest / (2.0 * pi * pi)) * pixels_per_degree));
    m_achromatic = unit_sum(csf_taps(csf_achromatic, colour_radius, pixels_per_degree));
    m_red_green = unit_sum(csf_taps(csf_red_green, colour_radius, pixels_per_degree));

    // A sum of two Gaussians is not separable, each of them is: filter with both, then mix them by
    // their shares of the 2-D kernel's sum.
    double share_sum = 0.0;
    for (std::size_t i = 0; i < 2; ++i) {
        const CsfTerm& term = csf_blue_yellow[i];
        const std::vector<double> half = csf_taps(term, colour_radius, pixels_per_degree);
        m_blue_yellow_share[i] = term.a * std::sqrt(pi / term.b) * total(half) * total(half);
        share_sum += m_blue_yellow_share[i];
        m_blue_yellow[i] = unit_sum(half);
    }
    for (double& share : m_blue_yellow_share) share /= share_sum;

    // Derivatives of a Gaussian along an axis. The published kernels are scaled so that the
    // positive weights sum to 1 and the negative ones to −1; the sign of a weight depends on the
    // coordinate along that axis alone, so the scaled kernel is still a product.
    const double deviation = 0.5 * feature_width * pixels_per_degree;
    const int feature_radius = static_cast<int>(std::ceil(3.0 * deviation));
    std::vector<double> gauss, edge, point;
    for (int k = 0; k <= feature_radius; ++k) {
        const double g = std::exp(-(k * k) / (2.0 * deviation * deviation));
        gauss.push_back(g);
        edge.push_back(-k * g);
        point.push_back((k * k / (deviation * deviation) - 1.0) * g);
    }
    m_gauss = unit_sum(gauss);
    double edge_sum = 0.0, positive = 0.0, negative = 0.0;
    for (std::size_t k = 0; k < edge.size(); ++k) {
        edge_sum += std::abs(edge[k]);
        (point[k] > 0.0 ? positive : negative) += (k == 0 ? 1.0 : 2.0) * std::abs(point[k]);
    }
    for (std::size_t k = 0; k < edge.size(); ++k) {
        m_edge.push_back(edge[k] / edge_sum);
        m_point.push_back(point[k] / (point[k] > 0.0 ? positive : negative));
    }
    m_radius = std::max(colour_radius, feature_radius);
}

void Flip::error(const ImagePair& pair, const Region& region, const Exposure& exposure, double* out,
                 std::ptrdiff_t stride) const
{
    if (region.empty()) return;
    static const Colours colours;
    const Display display(exposure);
    const Region& window = pair.window;
    const Region loaded = region.grown(Halo::all(m_radius)).intersect(window);
    const int left = loaded.x0 - (region.x0 - m_radius); // columns to repeat on each side
    const int n = region.width(), padded = n + 2 * m_radius;
    const auto row_size = static_cast<std::size_t>(padded);

    // Opponent colours of every row, [row][image 0, reference 1][Y, Cx, Cz][x], edges repeated.
    std::vector<double> opponent(static_cast<std::size_t>(loaded.height()) * 6 * row_size);
    PairRow row(loaded.width());
    for (int y = loaded.y0; y < loaded.y1; ++y) {
        row.load(pair, y, loaded.x0, loaded.x1);
        double* to = opponent.data() + static_cast<std::size_t>(y - loaded.y0) * 6 * row_size;
        for (int which = 0; which < 2; ++which) {
            double* rgb[3];
            for (int c = 0; c < 3; ++c) rgb[c] = which == 0 ? row.image(c) : row.reference(c);
            display.map(rgb[0], rgb[1], rgb[2], loaded.width());
            for (int i = 0; i < 3; ++i) {
                double* plane = to + static_cast<std::size_t>(which * 3 + i) * row_size;
                const double* m = colours.rgb_to_opponent.m[i];
                for (int x = 0; x < loaded.width(); ++x)
                    plane[left + x] = m[0] * rgb[0][x] + m[1] * rgb[1][x] + m[2] * rgb[2][x];
                std::fill_n(plane, left, plane[left]);
                const int end = left + loaded.width();
                std::fill(plane + end, plane + padded, plane[end - 1]);
            }
        }
    }

    // Down first, then across: a row of the result then costs the same alone as among others.
    std::vector<double> across(row_size);
    std::vector<const double*> pointers;
    const auto down = [&](int plane, int y, const Taps& taps, Parity parity, double* to) {
        const int r = static_cast<int>(taps.size()) - 1;
        pointers.clear();
        for (int k = -r; k <= r; ++k) {
            const int from = std::clamp(y + k, window.y0, window.y1 - 1) - loaded.y0;
            pointers.push_back(
                opponent.data() +
                (static_cast<std::size_t>(from) * 6 + static_cast<std::size_t>(plane)) * row_size);
        }
        weighted_row_sum(pointers, taps, parity, to, row_size);
    };
    const auto along = [&](const double* from, const Taps& taps, Parity parity, double* to) {
        const int r = static_cast<int>(taps.size()) - 1;
        pointers.clear();
        for (int k = -r; k <= r; ++k) pointers.push_back(from + m_radius + k);
        weighted_row_sum(pointers, taps, parity, to, static_cast<std::size_t>(n));
    };

    // Per image: filtered Y, Cx, Cz (two parts), and the sizes of edges and points.
    const auto width = static_cast<std::size_t>(n);
    std::vector<double> filtered(2 * 4 * width), edges(2 * width), points(2 * width);
    std::vector<double> first(width), second(width);
    for (int y = region.y0; y < region.y1; ++y) {
        for (int which = 0; which < 2; ++which) {
            const int plane = 3 * which;
            double* f = filtered.data() + static_cast<std::size_t>(which) * 4 * width;
            const Taps* taps[4] = {&m_achromatic, &m_red_green, &m_blue_yellow[0],
                                   &m_blue_yellow[1]};
            for (int i = 0; i < 4; ++i) {
                down(plane + std::min(i, 2), y, *taps[i], Parity::even, across.data());
                along(across.data(), *taps[i], Parity::even,
                      f + static_cast<std::size_t>(i) * width);
            }
            double* edge = edges.data() + static_cast<std::size_t>(which) * width;
            double* point = points.data() + static_cast<std::size_t>(which) * width;
            down(plane, y, m_edge, Parity::odd, across.data());
            along(across.data(), m_gauss, Parity::even, edge);
            down(plane, y, m_point, Parity::even, across.data());
            along(across.data(), m_gauss, Parity::even, point);
            down(plane, y, m_gauss, Parity::even, across.data());
            along(across.data(), m_edge, Parity::odd, first.data());
            along(across.data(), m_point, Parity::even, second.data());
            for (std::size_t x = 0; x < width; ++x) {
                edge[x] = norm(edge[x], first[x]);
                point[x] = norm(point[x], second[x]);
            }
        }
        double* result = out + (y - region.y0) * stride;
        for (std::size_t x = 0; x < width; ++x) {
            double lab[2][3];
            for (std::size_t which = 0; which < 2; ++which) {
                const double* f = filtered.data() + which * 4 * width + x;
                double rgb[3];
                colours.opponent_to_rgb.apply(f[0], f[width],
                                              m_blue_yellow_share[0] * f[2 * width] +
                                                  m_blue_yellow_share[1] * f[3 * width],
                                              rgb);
                for (double& v : rgb) v = std::clamp(v, 0.0, 1.0);
                hunt_lab(colours.rgb_to_xyz, rgb, lab[which]);
            }
            const double colour = redistribute(std::pow(hyab(lab[0], lab[1]), colour_exponent),
                                               colours.largest_difference);
            // Y still carries its factor 116; detectors work on Y / 116.
            const double feature = std::max(std::abs(edges[x] - edges[width + x]),
                                            std::abs(points[x] - points[width + x])) /
                                   116.0;
            // q_f = 0.5: a square root.
            result[x] = std::pow(colour, 1.0 - std::sqrt(feature * std::numbers::sqrt2 * 0.5));
        }
    }
}

} // namespace rayloom
