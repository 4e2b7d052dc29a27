// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/plain_nodes.h"
#include "tests/oracle/restore_mean.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

namespace rayloom::oracle
{

namespace
{

/// Channels from `first` on, as an image.
Raster<double> picked(const Raster<double>& image, int first, int channels)
{
    return make_raster(image, channels,
                       [&](int c, int x, int y) { return image.at(first + c, x, y); });
}

/// Mean of value(u, v) over the square of half-size `radius` around (x, y), clipped at the border.
template <class Value>
double square_mean(const Raster<double>& like, int radius, int x, int y, const Value& value)
{
    double sum = 0.0;
    int n = 0;
    for (int v = std::max(0, y - radius); v <= std::min(like.height - 1, y + radius); ++v)
        for (int u = std::max(0, x - radius); u <= std::min(like.width - 1, x + radius); ++u) {
            sum += value(u, v);
            ++n;
        }
    return sum / n;
}

/// The median of the positive values as transform.log has it: the middle of its 1/32 of an octave.
double median_of_positive(const Raster<double>& image)
{
    std::vector<double> positive;
    for (const double v : image.values)
        if (v > 0.0) positive.push_back(v);
    if (positive.empty()) return 0.0;
    std::ranges::sort(positive);
    const double median = positive[(positive.size() + 1) / 2 - 1];
    const double octave = std::exp2(std::floor(std::log2(median)));
    return octave * (1.0 + (std::floor(32.0 * (median / octave - 1.0)) + 0.5) / 32.0);
}

Raster<double> log_of_image(const Raster<double>& image, double epsilon)
{
    return make_raster(image, image.channels, [&](int c, int x, int y) {
        return std::log(std::max(image.at(c, x, y), 0.0) + epsilon);
    });
}

} // namespace

PlainResult plain_demodulate(const PlainInput& in)
{
    const Raster<double>&image = in.image("radiance"), &pivot = in.image("albedo");
    double sum = 0.0, n = 0.0;
    for (const double p : pivot.values)
        if (std::isfinite(p) && p > 0.0) {
            sum += p;
            n += 1.0;
        }
    const double limit = n > 0.0 ? 0.001 * sum / n : 0.0;
    const auto divides = [&](int c, int x, int y) {
        return std::isfinite(pivot.at(c, x, y)) && pivot.at(c, x, y) > limit;
    };
    PlainResult out;
    out.images["image"] = {make_raster(image, 3, [&](int c, int x, int y) {
        return divides(c, x, y) ? image.at(c, x, y) / pivot.at(c, x, y) : image.at(c, x, y);
    })};
    out.images["marked"] = {
        make_raster(image, 3, [&](int c, int x, int y) { return divides(c, x, y) ? 0.0 : 1.0; })};
    return out;
}

PlainResult plain_modulate(const PlainInput& in)
{
    const Raster<double>&light = in.image("light"), &pivot = in.image("albedo");
    PlainResult out;
    out.images["image"] = {make_raster(
        light, 3, [&](int c, int x, int y) { return light.at(c, x, y) * pivot.at(c, x, y); })};
    return out;
}

PlainResult plain_log(const PlainInput& in)
{
    const Raster<double>& image = in.image("image");
    PlainResult out;
    out.images["image"] = {log_of_image(image, 1e-4 * median_of_positive(image))};
    return out;
}

PlainResult plain_exp(const PlainInput& in)
{
    const Raster<double>& image = in.image("image");
    const double epsilon = 1e-4 * median_of_positive(image);
    const Raster<double> log = log_of_image(image, epsilon);
    PlainResult out;
    out.images["image"] = {make_raster(image, 3, [&](int c, int x, int y) {
        return std::max(std::exp(log.at(c, x, y)) - epsilon, 0.0);
    })};
    return out;
}

PlainResult plain_flash(const PlainInput& in)
{
    const Raster<double>&partial = in.image("partial"), &unit = in.image("flash_unit");
    PlainResult out;
    out.images["image"] = {make_raster(partial, 3, [&](int c, int x, int y) {
        return partial.at(c, x, y) + 3.0 * unit.at(c, x, y);
    })};
    return out;
}

PlainResult plain_half_buffers(const PlainInput& in)
{
    const Raster<double>&a = in.image("a"), &b = in.image("b");
    PlainResult out;
    out.images["mean"] = {make_raster(
        a, 3, [&](int c, int x, int y) { return 0.5 * (a.at(c, x, y) + b.at(c, x, y)); })};
    out.images["variance"] = {make_raster(a, 3, [&](int c, int x, int y) {
        return square_mean(a, 2, x, y, [&](int u, int v) {
            const double half = 0.5 * (a.at(c, u, v) - b.at(c, u, v));
            return half * half;
        });
    })};
    return out;
}

PlainResult plain_halves(const PlainInput& in)
{
    const std::vector<Raster<double>>& stack = in.list("stack");
    const std::size_t n = stack.size();
    // Of an odd number the last image is half in either.
    const auto half = [&](std::size_t first) {
        return make_raster(stack[0], 3, [&](int c, int x, int y) {
            double sum = 0.0, weight = 0.0;
            for (std::size_t i = 0; i < n; ++i) {
                const bool shared = n % 2 == 1 && i + 1 == n;
                const double share = shared ? 0.5 : i % 2 == first ? 1.0 : 0.0;
                sum += share * stack[i].at(c, x, y);
                weight += share;
            }
            return sum / weight;
        });
    };
    PlainResult out;
    out.images["a"] = {half(0)};
    out.images["b"] = {half(1)};
    out.images["mean"] = {make_raster(stack[0], 3, [&](int c, int x, int y) {
        double sum = 0.0;
        for (const auto& image : stack) sum += image.at(c, x, y);
        return sum / static_cast<double>(n);
    })};
    return out;
}

PlainResult plain_statistics(const PlainInput& in)
{
    const std::vector<Raster<double>>& stack = in.list("stack");
    const auto n = static_cast<double>(stack.size());
    const Raster<double> mean = make_raster(stack[0], 3, [&](int c, int x, int y) {
        double sum = 0.0;
        for (const auto& image : stack) sum += image.at(c, x, y);
        return sum / n;
    });
    PlainResult out;
    out.images["variance"] = {make_raster(stack[0], 3, [&](int c, int x, int y) {
        double sum = 0.0;
        for (const auto& image : stack)
            sum += (image.at(c, x, y) - mean.at(c, x, y)) * (image.at(c, x, y) - mean.at(c, x, y));
        return sum / (n - 1.0);
    })};
    out.images["mean"] = {mean};
    return out;
}

PlainResult plain_histogram(const PlainInput& in)
{
    constexpr int bins = 20;
    const std::vector<Raster<double>>& stack = in.list("stack");
    Raster<double> histogram(stack[0].width, stack[0].height, 3 * bins + 1);
    for (int y = 0; y < histogram.height; ++y)
        for (int x = 0; x < histogram.width; ++x) {
            std::vector<double> counts(static_cast<std::size_t>(histogram.channels), 0.0);
            for (const auto& image : stack) {
                const double colour[] = {image.at(0, x, y), image.at(1, x, y), image.at(2, x, y)};
                add_sample(counts, colour, bins, 2.2, 2.5);
            }
            for (int c = 0; c < histogram.channels; ++c)
                histogram.at(c, x, y) = counts[static_cast<std::size_t>(c)];
        }
    PlainResult out;
    out.images["image"] = {histogram};
    return out;
}

// `render` holds Combined, DiffDir, DiffInd and DiffCol, three channels each.

PlainResult plain_layer(const PlainInput& in)
{
    PlainResult out;
    out.images["image"] = {picked(in.image("render"), 3, 3)};
    return out;
}

PlainResult plain_layers(const PlainInput& in)
{
    PlainResult out;
    out.images["layers"] = {picked(in.image("render"), 3, 3), picked(in.image("render"), 6, 3)};
    return out;
}

PlainResult plain_pass(const PlainInput& in)
{
    PlainResult out;
    out.images["image"] = {picked(in.image("render"), 0, 3)};
    return out;
}

PlainResult plain_lobes(const PlainInput& in)
{
    const Raster<double>& render = in.image("render");
    PlainResult out;
    out.images["radiance"] = {make_raster(render, 3, [&](int c, int x, int y) {
        return (render.at(3 + c, x, y) + render.at(6 + c, x, y)) * render.at(9 + c, x, y);
    })};
    return out;
}

PlainResult plain_merge_layers(const PlainInput& in)
{
    const Raster<double>&direct = in.image("direct"), &indirect = in.image("indirect");
    PlainResult out;
    out.images["image"] = {make_raster(direct, 6, [&](int c, int x, int y) {
        return c < 3 ? direct.at(c, x, y) : indirect.at(c - 3, x, y);
    })};
    return out;
}

PlainResult plain_merge_lobes(const PlainInput& in)
{
    const Raster<double>&render = in.image("render"), &beauty = in.image("beauty"),
          &lobe = in.image("lobe");
    Raster<double> merged = render;
    for (int y = 0; y < render.height; ++y)
        for (int x = 0; x < render.width; ++x)
            for (int c = 0; c < 3; ++c) {
                merged.at(c, x, y) = beauty.at(c, x, y);
                const double pivot = render.at(9 + c, x, y);
                if (!(pivot > 0.0)) continue;
                const double direct = render.at(3 + c, x, y), indirect = render.at(6 + c, x, y);
                const double light = lobe.at(c, x, y) / pivot;
                const double both = direct + indirect;
                merged.at(3 + c, x, y) = both > 0.0 ? light * (direct / both) : light;
                merged.at(6 + c, x, y) = both > 0.0 ? light * (indirect / both) : 0.0;
            }
    PlainResult out;
    out.images["image"] = {merged};
    return out;
}

PlainResult plain_local_variance(const PlainInput& in)
{
    const Raster<double>& image = in.image("image");
    // E min(h², v²) / E h² of two normal second differences that share their centre.
    const double smaller = 1.0 - 2.0 / std::numbers::pi * std::sqrt(1.0 - 4.0 / 9.0);
    PlainResult out;
    out.images["image"] = {make_raster(image, 3, [&](int c, int x, int y) {
        return square_mean(image, 3, x, y, [&](int u, int v) {
            const auto at = [&](int i, int j) {
                return image.at(c, mirrored_index(i, image.width), mirrored_index(j, image.height));
            };
            const double h = 2.0 * at(u, v) - at(u - 1, v) - at(u + 1, v);
            const double w = 2.0 * at(u, v) - at(u, v - 1) - at(u, v + 1);
            return std::min(h * h, w * w) / 6.0 / smaller;
        });
    })};
    return out;
}

PlainResult plain_parts(const PlainInput& in)
{
    const Raster<double>& ids = in.image("ids");
    PlainResult out;
    out.images["image"] = {make_raster(ids, 2, [&](int c, int x, int y) {
        return c == 1 ? 1.0 : ids.at(0, x, y) * 4096.0 + ids.at(1, x, y);
    })};
    return out;
}

PlainResult plain_remainder(const PlainInput& in)
{
    const Raster<double>&beauty = in.image("beauty"), &direct = in.image("direct");
    PlainResult out;
    out.images["image"] = {make_raster(
        beauty, 3, [&](int c, int x, int y) { return beauty.at(c, x, y) - direct.at(c, x, y); })};
    return out;
}

PlainResult plain_restore_mean(const PlainInput& in)
{
    PlainResult out;
    out.images["image"] = {restore_share(in.image("image"), in.image("reference"), 3)};
    return out;
}

PlainResult plain_sequence(const PlainInput& in)
{
    PlainResult out;
    out.images["frames"] = in.list("before");
    out.images["frames"].push_back(in.image("frame"));
    return out;
}

} // namespace rayloom::oracle
