// SPDX-License-Identifier: Apache-2.0
#include "nodes/multiscale/resample.h"

#include "rayloom/image/border.h"

#include <algorithm>
#include <cmath>

namespace rayloom
{

namespace
{

/// Axis with room for `taps` weights a pixel.
ResampleAxis empty_axis(int begin, int end, int taps)
{
    ResampleAxis axis;
    axis.begin = begin;
    axis.end = end;
    axis.taps = taps;
    const auto n = static_cast<std::size_t>(std::max(0, end - begin) * taps);
    axis.source.reserve(n);
    axis.weight.reserve(n);
    return axis;
}

void find_hull(ResampleAxis& axis)
{
    if (axis.source.empty()) return;
    const auto [low, high] = std::minmax_element(axis.source.begin(), axis.source.end());
    axis.source_begin = *low;
    axis.source_end = *high + 1;
}

double keys(double distance)
{
    const double d = std::abs(distance);
    if (d < 1.0) return (1.5 * d - 2.5) * d * d + 1.0;
    if (d < 2.0) return ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0;
    return 0.0;
}

} // namespace

int decimated_size(int size, int scale)
{
    const int block = 1 << scale;
    return size / block + (size % block != 0 ? 1 : 0);
}

ResampleAxis decimate_axis(int size, int scale, int begin, int end)
{
    const double sigma = 0.55 * std::sqrt(std::pow(4.0, scale) - 1.0);
    const int radius = static_cast<int>(std::ceil(sigma * std::sqrt(4.0 * std::log(10.0))));
    const int taps = 2 * radius + 1;
    // Every centre lies on a pixel edge (scale > 0): the weights are the same for all pixels.
    std::vector<double> gaussian(static_cast<std::size_t>(taps));
    double sum = 0.0;
    for (int k = 0; k < taps; ++k) {
        const double d = (k - radius + 0.5) / sigma;
        sum += gaussian[static_cast<std::size_t>(k)] = std::exp(-0.5 * d * d);
    }
    ResampleAxis axis = empty_axis(begin, end, taps);
    const int block = 1 << scale;
    for (int i = begin; i < end; ++i) {
        const int centre = i * block + block / 2;
        for (int k = 0; k < taps; ++k) {
            axis.source.push_back(border_index(centre + k - radius, 0, size, Border::mirror));
            axis.weight.push_back(static_cast<float>(gaussian[static_cast<std::size_t>(k)] / sum));
        }
    }
    find_hull(axis);
    return axis;
}

ResampleAxis interpolate_axis(int source_size, int size, int begin, int end)
{
    ResampleAxis axis = empty_axis(begin, end, 4);
    for (int i = begin; i < end; ++i) {
        const double at = (i + 0.5) * source_size / size - 0.5;
        const int first = static_cast<int>(std::floor(at)) - 1;
        for (int k = first; k < first + 4; ++k) {
            axis.source.push_back(border_index(k, 0, source_size, Border::mirror));
            axis.weight.push_back(static_cast<float>(keys(at - k)));
        }
    }
    find_hull(axis);
    return axis;
}

void resample(ConstImageView from, const PixelOrigin& from_origin, const ResampleAxis& horizontal,
              const ResampleAxis& vertical, float factor, ImageView to,
              const PixelOrigin& to_origin)
{
    const Region& region = to.region();
    const int columns = horizontal.source_end - horizontal.source_begin;
    if (region.empty()) return;
    std::vector<float> row(static_cast<std::size_t>(columns));
    // Vertically first: that sums whole rows, and leaves the strided sums for the shorter image.
    for (int y = region.y0; y < region.y1; ++y) {
        const auto v = static_cast<std::size_t>((y - to_origin.y - vertical.begin) * vertical.taps);
        for (int c = 0; c < to.channels(); ++c) {
            std::fill(row.begin(), row.end(), 0.0f);
            for (int k = 0; k < vertical.taps; ++k) {
                const std::size_t tap = v + static_cast<std::size_t>(k);
                const float weight = vertical.weight[tap];
                const float* source = from.ptr(c, horizontal.source_begin + from_origin.x,
                                               vertical.source[tap] + from_origin.y);
                for (std::size_t x = 0; x < row.size(); ++x) row[x] += weight * source[x];
            }
            float* out = to.row(c, y);
            for (int x = region.x0; x < region.x1; ++x) {
                const auto h = static_cast<std::size_t>((x - to_origin.x - horizontal.begin) *
                                                        horizontal.taps);
                float sum = 0.0f;
                for (int k = 0; k < horizontal.taps; ++k) {
                    const std::size_t tap = h + static_cast<std::size_t>(k);
                    sum += horizontal.weight[tap] *
                           row[static_cast<std::size_t>(horizontal.source[tap] -
                                                        horizontal.source_begin)];
                }
                out[x - region.x0] = factor * sum;
            }
        }
    }
}

} // namespace rayloom
