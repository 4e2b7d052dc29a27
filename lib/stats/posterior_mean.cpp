// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/posterior_mean.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace rayloom
{
std::string to_string(SignalStatus status)
{
    switch (status) {
    case SignalStatus::fitted: return "fitted";
    case SignalStatus::shape_low: return "shape at 0.3";
    case SignalStatus::shape_high: return "shape at 4";
    case SignalStatus::no_signal: return "all noise";
    }
    return {};
}

SignalFit fit_signal(double second, double fourth, const GeneralisedLaplacian& noise,
                     double sampling_error)
{
    const double noise_second = noise.variance();
    const double signal_second = second - noise_second;
    if (!(signal_second > sampling_error * second)) return {};
    const double signal_fourth =
        fourth - noise.fourth_moment() - 6.0 * signal_second * noise_second;
    // Noise of the wrong shape can leave less than nothing: shorter tails than any shape has.
    const GeneralisedLaplacianFit fit = fit_generalised_laplacian(
        signal_second, std::max(signal_fourth, signal_second * signal_second), least_shape,
        greatest_shape);
    const SignalStatus status = !fit.clamped                   ? SignalStatus::fitted
                                : fit.density.p == least_shape ? SignalStatus::shape_low
                                                               : SignalStatus::shape_high;
    return {fit.density, status};
}

// ------------------------------------------------------------------------------- posterior mean

namespace
{

/// g'(c) for 0 < c < y.
double slope(const PosteriorExponent& g, double c)
{
    return g.noise_p * std::pow(g.y - c, g.noise_p - 1.0) -
           g.signal_p * g.inverse_a * std::pow(c * g.inverse_a, g.signal_p - 1.0);
}
/// −g''(c) for 0 < c < y.
double curvature(const PosteriorExponent& g, double c)
{
    return g.noise_p * (g.noise_p - 1.0) * std::pow(g.y - c, g.noise_p - 2.0) +
           g.signal_p * (g.signal_p - 1.0) * g.inverse_a * g.inverse_a *
               std::pow(c * g.inverse_a, g.signal_p - 2.0);
}

/// Of the integrand's maximum, what is below e^-negligible of it is left out.
constexpr double negligible = 42.0;

/// Adds b ± width·4^k inside [lo, hi].
void grade(std::vector<double>& edges, double b, double width, double lo, double hi)
{
    edges.push_back(b);
    for (double d = width; d < hi - lo; d *= 4.0) {
        if (b + d < hi) edges.push_back(b + d);
        if (b - d > lo) edges.push_back(b - d);
    }
}

/// ĉ/s_n for y/s_n ≥ 0 and a = s_c/s_n.
double unit_posterior_mean(double y, double a, double signal_p, double noise_p)
{
    if (y == 0.0) return 0.0;
    const PosteriorExponent g{y, 1.0 / a, signal_p, noise_p};

    // Maxima of g lie at its cusps, 0 and y, or between them. Two convex halves have none between.
    std::array<double, 4> modes{};
    std::size_t mode_count = 0;
    if (signal_p > 1.0 || noise_p > 1.0) {
        constexpr int steps = 24;
        double before = y * 1e-9, slope_before = slope(g, before);
        for (int i = 1; i <= steps && mode_count < modes.size(); ++i) {
            // Denser towards both ends, where the two powers turn.
            const double t = static_cast<double>(i) / steps;
            const double x = i == steps ? y * (1.0 - 1e-9) : y * t * t * (3.0 - 2.0 * t);
            const double slope_here = slope(g, x);
            if (slope_before > 0.0 && slope_here <= 0.0) {
                double lo = before, hi = x;
                for (int k = 0;
                     k < 60 &&
                     hi - lo > 1e-3 / std::sqrt(std::max(1e-300, curvature(g, 0.5 * (lo + hi))));
                     ++k) {
                    const double m = 0.5 * (lo + hi);
                    (slope(g, m) > 0.0 ? lo : hi) = m;
                }
                modes[mode_count++] = 0.5 * (lo + hi);
            }
            before = x;
            slope_before = slope_here;
        }
    }
    const double reach = 2.0 * std::min(a * std::pow(negligible, 1.0 / signal_p) + y,
                                        y + std::pow(negligible, 1.0 / noise_p));
    const double lo = -reach, hi = y + reach;
    // How far from each cusp the integrand falls to 1/e, by its own power and by the other's slope.
    const double at_zero = std::min(a, 1.0 / (noise_p * std::pow(std::max(y, 1.0), noise_p - 1.0)));
    const double at_y =
        std::min(1.0, a / (signal_p * std::pow(std::max(y / a, 1.0), signal_p - 1.0)));
    std::vector<double> edges;
    edges.reserve(128);
    edges.push_back(lo);
    edges.push_back(hi);
    grade(edges, 0.0, (signal_p < 1.0 ? 1.0 / 1024.0 : 0.25) * at_zero, lo, hi);
    grade(edges, y, (noise_p < 1.0 ? 1.0 / 1024.0 : 0.25) * at_y, lo, hi);
    for (std::size_t i = 0; i < mode_count; ++i)
        grade(edges, modes[i], 1.0 / std::sqrt(std::max(1e-300, curvature(g, modes[i]))), lo, hi);
    std::ranges::sort(edges);

    // The edges hold both cusps and all modes, so the integrand's maximum is among them.
    std::vector<double> exponents(edges.size());
    posterior_exponents(g, edges, exponents);
    const double peak = *std::ranges::max_element(exponents);

    std::vector<PosteriorInterval> intervals;
    intervals.reserve(edges.size() + 64);
    double mass = 0.0, first = 0.0;
    for (std::size_t i = 1; i < edges.size(); ++i) {
        const bool counts = std::max(exponents[i - 1], exponents[i]) > peak - negligible;
        if (!counts || edges[i] <= edges[i - 1]) continue;
        intervals.push_back(posterior_interval(g, peak, edges[i - 1], edges[i]));
        mass += intervals.back().mass;
        first += intervals.back().first;
    }
    // What an interval's error does to the quotient: ∫ (c − ĉ) e^g is what has to be right.
    constexpr double tolerance = 1e-7;
    for (std::size_t i = 0; i < intervals.size() && intervals.size() < 20000; ++i) {
        const PosteriorInterval old = intervals[i];
        const double centre = first / mass;
        if (std::fabs(old.first_error - centre * old.mass_error) <= tolerance * mass) continue;
        const double middle = 0.5 * (old.lo + old.hi);
        if (middle <= old.lo || middle >= old.hi) continue;
        intervals.push_back(posterior_interval(g, peak, old.lo, middle));
        const PosteriorInterval left = intervals.back();
        intervals.push_back(posterior_interval(g, peak, middle, old.hi));
        const PosteriorInterval right = intervals.back();
        mass += left.mass + right.mass - old.mass;
        first += left.first + right.first - old.first;
        intervals[i].mass = intervals[i].first = 0.0;
    }
    mass = first = 0.0;
    for (const PosteriorInterval& i : intervals) {
        mass += i.mass;
        first += i.first;
    }
    return std::clamp(first / mass, 0.0, y);
}

/// Where the scales differ this much one of the two is as good as certain.
constexpr double greatest_scale_ratio = 1e9;

} // namespace

double posterior_mean(double y, const GeneralisedLaplacian& signal,
                      const GeneralisedLaplacian& noise)
{
    if (noise.s <= 0.0 || signal.s > greatest_scale_ratio * noise.s) return y;
    if (signal.s <= 0.0 || noise.s > greatest_scale_ratio * signal.s) return 0.0;
    const double mean = noise.s * unit_posterior_mean(std::fabs(y) / noise.s, signal.s / noise.s,
                                                      signal.p, noise.p);
    return std::copysign(mean, y);
}

// ------------------------------------------------------------------------------- table

namespace
{

/// The table's first octave begins at 2^least_exponent s_n; ĉ is a straight line below.
constexpr int least_exponent = -14;
constexpr int least_shift = 2, greatest_shift = 10;
constexpr double interpolation_tolerance = 4e-5;

} // namespace

PosteriorMeanTable::PosteriorMeanTable(const GeneralisedLaplacian& signal,
                                       const GeneralisedLaplacian& noise, double greatest)
{
    if (noise.s <= 0.0 || signal.s > greatest_scale_ratio * noise.s) return;
    if (signal.s <= 0.0 || noise.s > greatest_scale_ratio * signal.s) {
        m_kind = Kind::zero;
        return;
    }
    m_kind = Kind::table;
    m_table.first_exponent = least_exponent;
    m_table.scale = static_cast<float>(noise.s);
    m_table.inverse_scale = static_cast<float>(1.0 / noise.s);
    const double ratio = signal.s / noise.s;
    const auto mean = [&](double y) { return unit_posterior_mean(y, ratio, signal.p, noise.p); };

    const int octaves = std::clamp(
        static_cast<int>(std::ceil(std::log2(std::max(greatest / noise.s, 1.0)))) - least_exponent,
        1, 100);
    double start = std::exp2(least_exponent);
    double at_start = mean(start);
    m_table.slope = static_cast<float>(at_start / start);
    int shift = least_shift;
    std::vector<std::vector<std::array<double, 4>>> pieces; // of each octave
    for (int o = 0; o < octaves; ++o, start *= 2.0) {
        // Samples at start·(1 + i/n); doubled until those between are met by the cubics.
        shift = std::max(least_shift, shift - 1);
        std::vector<double> sample;
        const auto place = [&](std::size_t i, std::size_t n) {
            return start * (1.0 + static_cast<double>(i) / static_cast<double>(n));
        };
        const auto cubic = [&](std::size_t i) {
            // Lagrange through four neighbours, shifted inwards at the octave's ends.
            const std::size_t n = sample.size() - 1;
            const std::size_t k = std::clamp<std::size_t>(i, 1, n - 2) - 1;
            const double f0 = sample[k], f1 = sample[k + 1], f2 = sample[k + 2], f3 = sample[k + 3];
            const double d1 = f1 - f0, d2 = f2 - 2.0 * f1 + f0, d3 = f3 - 3.0 * f2 + 3.0 * f1 - f0;
            // Newton's form in u = i − k + t, expanded about t = 0.
            const double j = static_cast<double>(i - k);
            const double b2 = 0.5 * d2, b3 = d3 / 6.0;
            return std::array<double, 4>{
                f0 + j * d1 + j * (j - 1.0) * b2 + j * (j - 1.0) * (j - 2.0) * b3,
                d1 + (2.0 * j - 1.0) * b2 + (3.0 * j * j - 6.0 * j + 2.0) * b3,
                b2 + (3.0 * j - 3.0) * b3, b3};
        };
        const auto at_half = [&](const std::array<double, 4>& c) {
            return c[0] + 0.5 * (c[1] + 0.5 * (c[2] + 0.5 * c[3]));
        };
        std::size_t n = std::size_t{1} << shift;
        sample.resize(n + 1);
        sample[0] = at_start;
        for (std::size_t i = 1; i <= n; ++i) sample[i] = mean(place(i, n));
        for (;;) {
            std::vector<double> finer(2 * n + 1);
            double worst = 0.0;
            for (std::size_t i = 0; i <= n; ++i) finer[2 * i] = sample[i];
            for (std::size_t i = 0; i < n; ++i) {
                finer[2 * i + 1] = mean(place(2 * i + 1, 2 * n));
                worst = std::max(worst, std::fabs(at_half(cubic(i)) - finer[2 * i + 1]));
            }
            sample = std::move(finer);
            n *= 2;
            ++shift;
            if (worst <= interpolation_tolerance || shift >= greatest_shift) break;
        }
        std::vector<std::array<double, 4>>& octave = pieces.emplace_back();
        for (std::size_t i = 0; i < n; ++i) {
            std::array<double, 4> c = cubic(i);
            // Where noise is log-concave the curve rises: a cubic that turns inside its segment
            // gives way to the straight line.
            const double disc = c[2] * c[2] - 3.0 * c[1] * c[3];
            bool turns = c[1] * (c[1] + 2.0 * c[2] + 3.0 * c[3]) < 0.0;
            if (!turns && disc > 0.0 && c[3] != 0.0)
                for (const double root : {(-c[2] - std::sqrt(disc)) / (3.0 * c[3]),
                                          (-c[2] + std::sqrt(disc)) / (3.0 * c[3])})
                    turns = turns || (root > 0.0 && root < 1.0);
            if (turns && noise.p >= 1.0) c = {sample[i], sample[i + 1] - sample[i], 0.0, 0.0};
            octave.push_back(c);
        }
        at_start = sample[n];
    }
    m_table.end = static_cast<float>(start);
    // All octaves get as many segments as the one that needs most: a cubic is cut in cubics.
    std::size_t segments = 1;
    for (const auto& octave : pieces) segments = std::max(segments, octave.size());
    m_table.shift = std::countr_zero(segments);
    m_cubics.reserve(segments * pieces.size());
    for (const auto& octave : pieces)
        for (std::size_t i = 0; i < segments; ++i) {
            const double r = static_cast<double>(octave.size()) / static_cast<double>(segments);
            const std::size_t parts = segments / octave.size();
            const double t = r * static_cast<double>(i % parts);
            const auto& [c0, c1, c2, c3] = octave[i / parts];
            m_cubics.push_back({static_cast<float>(c0 + t * (c1 + t * (c2 + t * c3))),
                                static_cast<float>(r * (c1 + t * (2.0 * c2 + t * 3.0 * c3))),
                                static_cast<float>(r * r * (c2 + t * 3.0 * c3)),
                                static_cast<float>(r * r * r * c3)});
        }
    m_table.end_loss = static_cast<float>(start - at_start);
}

float PosteriorMeanTable::operator()(float y) const
{
    float value = 0.0f;
    apply({&y, 1}, {&value, 1});
    return value;
}

void PosteriorMeanTable::apply(std::span<const float> in, std::span<float> out) const
{
    switch (m_kind) {
    case Kind::identity: std::ranges::copy(in, out.begin()); break;
    case Kind::zero: std::ranges::fill(out, 0.0f); break;
    case Kind::table: {
        CubicTable table = m_table;
        table.cubics = m_cubics;
        read_cubic_table(table, in, out);
        break;
    }
    }
}

} // namespace rayloom
