// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/histogram_fusion.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace rayloom::oracle
{

namespace
{

int mirrored(int i, int n)
{
    while (i < 0 || i >= n) i = i < 0 ? -1 - i : 2 * n - 1 - i;
    return i;
}

/// Patch half-size of a pixel: `radius`, less where the border is nearer.
int half_size(int x, int y, int width, int height, int radius)
{
    return std::min({radius, x, y, width - 1 - x, height - 1 - y});
}

template <class Real>
struct Candidate {
    int dx = 0, dy = 0;
    Real distance = 0;
};

} // namespace

template <class Real>
PatchDistance<Real> patch_distance(const Raster<Real>& histogram, int x, int y, int dx, int dy,
                                   int radius)
{
    PatchDistance<Real> d;
    const int count = histogram.channels - 1;
    for (int ty = -radius; ty <= radius; ++ty) {
        for (int tx = -radius; tx <= radius; ++tx) {
            const int ax = x + tx, ay = y + ty, bx = ax + dx, by = ay + dy;
            const Real na = histogram.at(count, ax, ay), nb = histogram.at(count, bx, by);
            if (!(na > 0) || !(nb > 0)) continue;
            const Real a = std::sqrt(nb / na), b = std::sqrt(na / nb);
            for (int i = 0; i < count; ++i) {
                const Real ha = histogram.at(i, ax, ay), hb = histogram.at(i, bx, by);
                if (!(ha + hb > 1)) continue;
                const Real t = a * ha - b * hb;
                d.sum += t * t / (ha + hb);
                ++d.bins;
            }
        }
    }
    return d;
}

template <class Real>
Raster<Real> fuse_histogram(const Raster<Real>& image, const Raster<Real>& histogram,
                            const FusionSettings& settings, int alpha, Raster<Real>* matches)
{
    const int width = image.width, height = image.height, channels = image.channels;
    const int b = settings.window_radius;
    const Real infinity = std::numeric_limits<Real>::infinity();
    Raster<Real> sum(width, height, channels), weight(width, height, 1);
    if (matches) *matches = Raster<Real>(width, height, 1);

    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            const int w = half_size(x, y, width, height, settings.patch_radius);
            std::vector<Candidate<Real>> accepted, rejected;
            for (int qy = std::max(y - b, w); qy <= std::min(y + b, height - 1 - w); ++qy) {
                for (int qx = std::max(x - b, w); qx <= std::min(x + b, width - 1 - w); ++qx) {
                    if (qx == x && qy == y) continue;
                    const auto d = patch_distance(histogram, x, y, qx - x, qy - y, w);
                    const Real distance = d.bins > 0 ? d.sum / static_cast<Real>(d.bins) : infinity;
                    const Candidate<Real> candidate{qx - x, qy - y, distance};
                    (distance < static_cast<Real>(settings.kappa) ? accepted : rejected)
                        .push_back(candidate);
                }
            }
            const auto wanted = static_cast<std::size_t>(settings.min_patches);
            if (accepted.size() < wanted) {
                std::stable_sort(
                    rejected.begin(), rejected.end(),
                    [](const auto& p, const auto& q) { return p.distance < q.distance; });
                for (const auto& candidate : rejected)
                    if (accepted.size() < wanted && candidate.distance < infinity)
                        accepted.push_back(candidate);
            }
            accepted.push_back({0, 0, 0});
            const Real share = Real(1) / static_cast<Real>(accepted.size());
            if (matches) matches->at(0, x, y) = static_cast<Real>(accepted.size());

            for (const auto& candidate : accepted) {
                for (int ty = -w; ty <= w; ++ty) {
                    for (int tx = -w; tx <= w; ++tx) {
                        const int zx = x + tx, zy = y + ty;
                        const int fx = zx + candidate.dx, fy = zy + candidate.dy;
                        const Real opacity = alpha < 0 ? Real(1) : image.at(alpha, fx, fy);
                        if (!(opacity > 0)) continue;
                        // The colour is premultiplied: opacity · (colour / opacity).
                        weight.at(0, zx, zy) += share * opacity;
                        for (int c = 0; c < channels; ++c)
                            if (c != alpha) sum.at(c, zx, zy) += share * image.at(c, fx, fy);
                    }
                }
            }
        }
    }
    Raster<Real> out = image;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < channels; ++c) {
                const Real opacity = alpha < 0 ? Real(1) : image.at(alpha, x, y);
                if (c != alpha && opacity > 0 && weight.at(0, x, y) > 0)
                    out.at(c, x, y) = opacity * sum.at(c, x, y) / weight.at(0, x, y);
            }
    return out;
}

Raster<double> downsample(const Raster<double>& image, int s)
{
    const int block = 1 << s;
    const double sigma = 0.55 * std::sqrt(std::pow(4.0, s) - 1.0);
    const int radius = static_cast<int>(std::ceil(sigma * std::sqrt(4.0 * std::log(10.0))));
    Raster<double> out((image.width + block - 1) / block, (image.height + block - 1) / block,
                       image.channels);
    const auto gaussian = [&](double d) { return std::exp(-d * d / (2.0 * sigma * sigma)); };
    for (int c = 0; c < image.channels; ++c)
        for (int y = 0; y < out.height; ++y)
            for (int x = 0; x < out.width; ++x) {
                const double cx = block * (x + 0.5), cy = block * (y + 0.5);
                const int px = static_cast<int>(std::floor(cx)),
                          py = static_cast<int>(std::floor(cy));
                double sum = 0.0, norm = 0.0;
                for (int j = py - radius; j <= py + radius; ++j)
                    for (int i = px - radius; i <= px + radius; ++i) {
                        const double g = gaussian(i + 0.5 - cx) * gaussian(j + 0.5 - cy);
                        sum += g * image.at(c, mirrored(i, image.width), mirrored(j, image.height));
                        norm += g;
                    }
                out.at(c, x, y) = sum / norm;
            }
    return out;
}

void conserve_count(const Raster<double>& full, Raster<double>& level)
{
    const auto total = [](const Raster<double>& p) {
        double sum = 0.0;
        for (int y = 0; y < p.height; ++y)
            for (int x = 0; x < p.width; ++x) sum += p.at(p.channels - 1, x, y);
        return sum;
    };
    const double factor = total(full) / total(level);
    for (double& v : level.values) v *= factor;
}

namespace
{

/// Calls `visit(i, j, weight)` for the 4 × 4 pixels of a width × height image that U makes the
/// pixel (x, y) of one of `to_width` × `to_height` from, mirrored ones included.
template <class Visit>
void for_each_tap(int width, int height, int to_width, int to_height, int x, int y,
                  const Visit& visit)
{
    // Keys' cubic convolution kernel with a = −1/2.
    const auto keys = [](double d) {
        d = std::abs(d);
        if (d < 1.0) return 1.5 * d * d * d - 2.5 * d * d + 1.0;
        if (d < 2.0) return -0.5 * d * d * d + 2.5 * d * d - 4.0 * d + 2.0;
        return 0.0;
    };
    const double sx = (x + 0.5) * width / to_width - 0.5;
    const double sy = (y + 0.5) * height / to_height - 0.5;
    const int px = static_cast<int>(std::floor(sx)), py = static_cast<int>(std::floor(sy));
    for (int j = py - 1; j <= py + 2; ++j)
        for (int i = px - 1; i <= px + 2; ++i)
            visit(mirrored(i, width), mirrored(j, height), keys(sx - i) * keys(sy - j));
}

} // namespace

Raster<double> upsample(const Raster<double>& image, int width, int height)
{
    Raster<double> out(width, height, image.channels);
    for (int c = 0; c < image.channels; ++c)
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x)
                for_each_tap(image.width, image.height, width, height, x, y,
                             [&](int i, int j, double weight) {
                                 out.at(c, x, y) += weight * image.at(c, i, j);
                             });
    return out;
}

Raster<double> recombine(std::span<const Raster<double>> levels, RecombineLimit limit)
{
    Raster<double> result = levels.back();
    for (std::size_t l = levels.size() - 1; l-- > 0;) {
        const Raster<double>& fine = levels[l];
        const Raster<double> coarse = result;
        const Raster<double> low = downsample(fine, 1);
        result = fine;
        for (int c = 0; c < fine.channels; ++c)
            for (int y = 0; y < fine.height; ++y)
                for (int x = 0; x < fine.width; ++x) {
                    const double u = fine.at(c, x, y);
                    double least = u, most = u, value = u;
                    for_each_tap(coarse.width, coarse.height, fine.width, fine.height, x, y,
                                 [&](int i, int j, double weight) {
                                     const double d = low.at(c, i, j);
                                     double share = 1.0;
                                     if (limit == RecombineLimit::share && d > 0.0)
                                         share = std::min(1.0, 2.0 * std::max(u, 0.0) / d);
                                     value += weight * share * (coarse.at(c, i, j) - d);
                                     least = std::min(least, coarse.at(c, i, j));
                                     most = std::max(most, coarse.at(c, i, j));
                                 });
                    for (int j = std::max(0, y - 1); j <= std::min(fine.height - 1, y + 1); ++j)
                        for (int i = std::max(0, x - 1); i <= std::min(fine.width - 1, x + 1);
                             ++i) {
                            least = std::min(least, fine.at(c, i, j));
                            most = std::max(most, fine.at(c, i, j));
                        }
                    result.at(c, x, y) =
                        limit == RecombineLimit::none ? value : std::clamp(value, least, most);
                }
    }
    return result;
}

void add_sample(std::span<double> histogram, std::span<const double> colour, int bins, double gamma,
                double max_value)
{
    for (std::size_t c = 0; c < colour.size(); ++c) {
        double* bin = histogram.data() + c * static_cast<std::size_t>(bins);
        const double v = std::min(std::pow(std::max(colour[c], 0.0), 1.0 / gamma) / max_value, 2.0);
        const double f = v * (bins - 2);
        if (f < bins - 2) {
            const int low = static_cast<int>(f);
            bin[low] += 1.0 - (f - low);
            bin[low + 1] += f - low;
        } else {
            bin[bins - 2] += 1.0 - (v - 1.0);
            bin[bins - 1] += v - 1.0;
        }
    }
    histogram[colour.size() * static_cast<std::size_t>(bins)] += 1.0;
}

template PatchDistance<double> patch_distance(const Raster<double>&, int, int, int, int, int);
template PatchDistance<float> patch_distance(const Raster<float>&, int, int, int, int, int);
template Raster<double> fuse_histogram(const Raster<double>&, const Raster<double>&,
                                       const FusionSettings&, int, Raster<double>*);
template Raster<float> fuse_histogram(const Raster<float>&, const Raster<float>&,
                                      const FusionSettings&, int, Raster<float>*);

} // namespace rayloom::oracle
