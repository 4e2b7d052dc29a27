// SPDX-License-Identifier: Apache-2.0
#include "nodes/multiscale/steerable_kernel.h"
#include "tests/oracle/plain_nodes.h"
#include "tests/oracle/restore_mean.h"

#include <boost/math/special_functions/gamma.hpp>

#include <algorithm>
#include <cmath>
#include <optional>

namespace rayloom::oracle
{

namespace
{

struct Density {
    double s = 0.0, p = 2.0;
};

double log_gamma(double x) { return boost::math::lgamma(x); }

/// E x²/s² of shape p.
double variance_of_shape(double p) { return std::exp(log_gamma(3.0 / p) - log_gamma(1.0 / p)); }

/// 001_6a300dc64642895d.txt, equations (16) to (18) by bisection: the kurtosis falls with p.
Density fit_density(double second, double fourth)
{
    const double wanted = fourth / (second * second);
    double low = 0.3, high = 4.0;
    for (int step = 0; step < 200; ++step) {
        const double p = 0.5 * (low + high);
        const double kurtosis =
            std::exp(log_gamma(5.0 / p) + log_gamma(1.0 / p) - 2.0 * log_gamma(3.0 / p));
        (kurtosis > wanted ? low : high) = p;
    }
    const double p = 0.5 * (low + high);
    return {std::sqrt(second / variance_of_shape(p)), p};
}

struct Moments {
    double second = 0.0, fourth = 0.0, greatest = 0.0;
    std::vector<double> values; ///< without zeros
};

/// Of a channel of a band, without the margin around the image.
Moments moments_of(const Raster<double>& band, int channel, const Halo& margin)
{
    Moments m;
    for (int y = margin.up; y < band.height - margin.down; ++y)
        for (int x = margin.left; x < band.width - margin.right; ++x)
            if (const double v = band.at(channel, x, y); v != 0.0) m.values.push_back(v);
    for (const double v : m.values) {
        m.second += v * v / static_cast<double>(m.values.size());
        m.fourth += v * v * v * v / static_cast<double>(m.values.size());
        m.greatest = std::max(m.greatest, std::abs(v));
    }
    return m;
}

/// The median of |v| as fit.noise has it: the upper end of its quarter of an octave (octaves cut in
/// four equal parts), from 2^−24 to 2^8.
double median_size(std::vector<double> values)
{
    for (double& v : values) v = std::abs(v);
    std::ranges::sort(values);
    const double median = values[(values.size() + 1) / 2 - 1];
    const double inside = std::clamp(median, std::exp2(-24), std::nextafter(std::exp2(8), 0.0));
    const double octave = std::exp2(std::floor(std::log2(inside)));
    return octave * (1.0 + (std::floor(4.0 * (inside / octave - 1.0)) + 1.0) / 4.0);
}

const Halo& margin_of_band()
{
    static const Halo margin = steerable_halo(band_of_channel("level1.band1.R"));
    return margin;
}

} // namespace

PlainResult plain_flash_intensity(const PlainInput& in)
{
    const auto luminance = [&](const char* name) {
        const Raster<double>& image = in.image(name);
        double sum = 0.0;
        for (int y = 0; y < image.height; ++y)
            for (int x = 0; x < image.width; ++x)
                sum += 0.2126 * image.at(0, x, y) + 0.7152 * image.at(1, x, y) +
                       0.0722 * image.at(2, x, y);
        return sum / image.width / image.height;
    };
    const double missing = luminance("image") - luminance("partial");
    PlainResult out;
    out.tables["fit"] = {{"intensity", {std::max(0.0, missing / luminance("flash_unit"))}},
                         {"image_luminance", {luminance("image")}}};
    return out;
}

PlainResult plain_fit_laplacian(const PlainInput& in)
{
    PlainResult out;
    auto& columns = out.tables["fit"];
    for (int c = 0; c < 3; ++c) {
        const Moments m = moments_of(in.image("band"), c, margin_of_band());
        const Density signal = fit_density(m.second, m.fourth);
        columns["s_c"].push_back(signal.s);
        columns["p_c"].push_back(signal.p);
        columns["deviation"].push_back(std::sqrt(m.second));
        columns["kurtosis"].push_back(m.fourth / m.second / m.second);
        columns["greatest"].push_back(m.greatest);
    }
    return out;
}

PlainResult plain_fit_noise(const PlainInput& in)
{
    PlainResult out;
    auto& columns = out.tables["noise"];
    for (int c = 0; c < 3; ++c) {
        const Moments m = moments_of(in.image("band"), c, {});
        const double shape = std::max(fit_density(m.second, m.fourth).p, 2.0);
        // The high-pass 1 − [1 2 1]ᵀ[1 2 1]/16 makes √(¾² + 4/64 + 4/256) of a pixel's noise.
        const double measured = std::min(std::sqrt(m.second), 6.0 * median_size(m.values));
        const double pixel_variance = measured * measured / (0.5625 + 4.0 / 64.0 + 4.0 / 256.0);
        const double deviation = (1.0 + pixel_variance) * measured;
        columns["p_n"].push_back(shape);
        columns["s_n"].push_back(deviation / std::sqrt(variance_of_shape(shape)));
        columns["deviation"].push_back(deviation);
        columns["kurtosis"].push_back(m.fourth / m.second / m.second);
    }
    return out;
}

PlainResult plain_fit_noise_map(const PlainInput& in)
{
    const Raster<double>& band = in.image("band");
    std::vector<double> mean(3, 0.0);
    for (std::size_t c = 0; c < 3; ++c) {
        const Moments m = moments_of(band, static_cast<int>(c), {});
        for (const double v : m.values)
            mean[c] += std::sqrt(std::abs(v)) / static_cast<double>(m.values.size());
    }
    const Raster<double> size = make_raster(band, 1, [&](int, int x, int y) {
        double sum = 0.0;
        for (int c = 0; c < 3; ++c)
            sum += std::sqrt(std::abs(band.at(c, x, y))) / mean[static_cast<std::size_t>(c)] / 3.0;
        return sum;
    });
    const Raster<double> near = spread(size, 4);
    const Raster<double> count =
        spread(make_raster(size, 1,
                           [&](int c, int x, int y) { return size.at(c, x, y) > 0.0 ? 1.0 : 0.0; }),
               4);
    PlainResult out;
    out.images["map"] = {make_raster(size, 1, [&](int c, int x, int y) {
        return std::clamp(std::pow(near.at(c, x, y) / count.at(c, x, y), 2.0), 0.25, 4.0);
    })};
    return out;
}

PlainResult plain_scale_band(const PlainInput& in)
{
    const Raster<double>& band = in.image("band");
    const Raster<double> map = plain_fit_noise_map(in).images.at("map").front();
    PlainResult out;
    out.images["image"] = {make_raster(
        band, 3, [&](int c, int x, int y) { return band.at(c, x, y) / map.at(0, x, y); })};
    return out;
}

PlainResult plain_band_fit(const PlainInput& in)
{
    constexpr int bins = 101;
    PlainResult out;
    auto& columns = out.tables["error"];
    for (int c = 0; c < 3; ++c) {
        const Moments m = moments_of(in.image("band"), c, margin_of_band());
        const Density signal = fit_density(m.second, m.fourth);
        const double reach = 3.0 * std::sqrt(m.second), width = 2.0 * reach / bins;
        const auto below = [&](double x) { // P(X ≤ x) − ½
            const double within =
                boost::math::gamma_p(1.0 / signal.p, std::pow(std::abs(x) / signal.s, signal.p));
            return std::copysign(0.5 * within, x);
        };
        double sum = 0.0;
        for (int b = 0; b < bins; ++b) {
            const double low = -reach + b * width, high = low + width;
            const auto inside = [&](double v) {
                return std::floor((v + reach) / width) == static_cast<double>(b);
            };
            const double observed = static_cast<double>(std::ranges::count_if(m.values, inside)) /
                                    static_cast<double>(m.values.size()) / width;
            const double fitted = (below(high) - below(low)) / width;
            sum += std::pow((observed - fitted) / fitted, 2);
        }
        columns["s"].push_back(signal.s);
        columns["p"].push_back(signal.p);
        columns["fitting_error"].push_back(std::sqrt(sum / bins));
    }
    return out;
}

} // namespace rayloom::oracle
