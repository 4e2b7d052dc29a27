// SPDX-License-Identifier: Apache-2.0
#include "rayloom/stats/error_measures.h"

#include "rayloom/core/error.h"
#include "rayloom/core/parallel.h"
#include "rayloom/stats/sums.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <vector>

namespace rayloom
{

namespace
{

constexpr double relative_floor = 0.01; // keeps dark pixels from ruling relMSE and SMAPE
constexpr double trimmed_share = 0.001;
constexpr int strip_rows = 32;

enum Sum : std::size_t {
    sum_good,
    sum_bad,
    sum_squared,
    sum_squared_clamped,
    sum_relative,
    sum_smape,
    sum_luminance,
    sum_reference_luminance,
    sum_ssim,
    sum_ssim_windows,
    sum_flip,
    sum_flip_pixels,
    max_absolute,
    sum_end
};
static_assert(sum_end == ErrorMeter::sum_count);

double clamp01(double v) { return std::min(std::max(v, 0.0), 1.0); }
double squared(double v) { return v * v; }
double relative_squared(double d, double r) { return squared(d - r) / (r * r + relative_floor); }

/// Sums of one channel of a row. Eight sums run side by side, pixel i in sum i mod 8, so that
/// vectors of any width add the same numbers in the same order.
struct ChannelSums {
    double squared_error, squared_clamped, relative, smape, image, reference, largest;
};

ChannelSums channel_sums(const double* d, const double* r, std::size_t n)
{
    constexpr std::size_t lanes = 8;
    using Lanes = std::array<double, lanes>;
    Lanes sq{}, sc{}, rel{}, sm{}, sd{}, sr{}, mx{};
    const auto add = [&](std::size_t l, double a, double b) {
        const double e = std::abs(a - b);
        sq[l] += e * e;
        sc[l] += squared(clamp01(a) - clamp01(b));
        rel[l] += e * e / (b * b + relative_floor);
        sm[l] += e / (std::abs(a) + std::abs(b) + relative_floor);
        sd[l] += a;
        sr[l] += b;
        mx[l] = e > mx[l] ? e : mx[l];
    };
    std::size_t i = 0;
    for (; i + lanes <= n; i += lanes)
        for (std::size_t l = 0; l < lanes; ++l) add(l, d[i + l], r[i + l]);
    for (; i < n; ++i) add(i % lanes, d[i], r[i]);
    return {pairwise_sum(sq),
            pairwise_sum(sc),
            pairwise_sum(rel),
            pairwise_sum(sm),
            pairwise_sum(sd),
            pairwise_sum(sr),
            *std::max_element(mx.begin(), mx.end())};
}

void check_pair(const ConstImageView& image, const ConstImageView& reference)
{
    if (!(image.region() == reference.region()))
        throw InputError("the image is " + image.region().text() + " but the reference is " +
                         reference.region().text() +
                         "; crop or resize one of them, both must show the same pixels");
    if (image.channels() != reference.channels() ||
        (image.channels() != 1 && image.channels() != 3))
        throw InputError("error measures need one or three channels in both images, not " +
                         std::to_string(image.channels()) + " and " +
                         std::to_string(reference.channels()));
    if (image.region().empty()) throw InputError("the image has no pixels to measure");
}

/// Calls body(y0, y1) for strips of rows, in parallel.
template <class Body>
void for_strips(const Region& region, const Body& body)
{
    const int strips = (region.height() + strip_rows - 1) / strip_rows;
    parallel_for(0, strips, 1, [&](int s) {
        const int y0 = region.y0 + s * strip_rows;
        body(y0, std::min(y0 + strip_rows, region.y1));
    });
}

/// Exposures of HDR-FLIP for a reference: given, or from its luminances.
ExposureRange hdr_exposures(const ImagePair& pair, const ErrorOptions& options)
{
    if (options.tone_mapper == ToneMapper::none)
        throw NodeError("HDR-FLIP needs a tone mapper: aces, hable or reinhard");
    if (options.exposures) return *options.exposures;
    const Region& region = pair.window;
    const auto width = static_cast<std::size_t>(region.width());
    constexpr double left_out = -1.0;
    std::vector<double> luminance(region.pixels());
    for_strips(region, [&](int y0, int y1) {
        PairRow row(region.width());
        for (int y = y0; y < y1; ++y) {
            row.load(pair, y, region.x0, region.x1);
            double* to = luminance.data() + static_cast<std::size_t>(y - region.y0) * width;
            for (std::size_t x = 0; x < width; ++x) {
                to[x] = left_out;
                if (row.good()[x] == 0) continue;
                double sum = 0.0;
                for (int c = 0; c < 3; ++c)
                    sum += luminance_weights[c] * std::max(row.reference(c)[x], 0.0);
                to[x] = sum;
            }
        }
    });
    std::erase(luminance, left_out);
    return flip_exposures(luminance, options.tone_mapper);
}

/// HDR-FLIP of rows [y0, y1): the largest LDR-FLIP over the exposures.
void hdr_flip_rows(const Flip& flip, const ImagePair& pair, const ExposureRange& exposures,
                   ToneMapper mapper, int y0, int y1, std::vector<double>& out)
{
    const Region rows{pair.window.x0, y0, pair.window.x1, y1};
    std::vector<double> one(rows.pixels());
    out.assign(rows.pixels(), 0.0);
    for (int i = 0; i < exposures.count; ++i) {
        flip.error(pair, rows, {mapper, exposures.at(i)}, one.data(), rows.width());
        for (std::size_t p = 0; p < one.size(); ++p) out[p] = std::max(out[p], one[p]);
    }
}

/// The k-th largest of the values, k ≥ 1, in one pass that looks twice at few of them.
double kth_largest(std::span<const double> values, std::size_t k)
{
    std::vector<double> top;
    top.reserve(2 * k);
    double bound = -std::numeric_limits<double>::infinity();
    const auto cut = [&] {
        std::nth_element(top.begin(), top.begin() + static_cast<std::ptrdiff_t>(k - 1), top.end(),
                         std::greater<>());
        top.resize(k);
        bound = top.back();
    };
    for (const double v : values) {
        if (!(v > bound)) continue;
        top.push_back(v);
        if (top.size() == 2 * k) cut();
    }
    if (top.size() >= k) cut();
    return bound;
}

/// Mean of all but the largest `trimmed_share` of the values, of which `count` are not negative;
/// the negative ones are no values. Which of several equal values are dropped makes no difference,
/// so the result does not depend on how the threshold was found. `width` values make a row.
double trimmed_mean(std::span<const double> values, std::size_t width, std::size_t count)
{
    const auto dropped = static_cast<std::size_t>(trimmed_share * static_cast<double>(count));
    const double threshold =
        dropped == 0 ? std::numeric_limits<double>::infinity() : kth_largest(values, dropped);
    const std::size_t rows = values.size() / width;
    std::vector<double> sums(rows);
    std::vector<std::size_t> below(rows);
    parallel_for(std::size_t{0}, rows, std::size_t{32}, [&](std::size_t y) {
        std::array<double, 8> lanes{};
        const std::span<const double> row = values.subspan(y * width, width);
        for (std::size_t x = 0; x < width; ++x) {
            const bool keep = row[x] >= 0.0 && row[x] < threshold;
            lanes[x % 8] += keep ? row[x] : 0.0;
            below[y] += keep ? 1 : 0;
        }
        sums[y] = pairwise_sum(lanes);
    });
    const std::size_t kept = count - dropped;
    const std::size_t strictly = std::accumulate(below.begin(), below.end(), std::size_t{0});
    // Those at the threshold that stay.
    const double ties = kept > strictly ? static_cast<double>(kept - strictly) * threshold : 0.0;
    return (pairwise_sum(sums) + ties) / static_cast<double>(kept);
}

} // namespace

Table ErrorMeasures::table() const
{
    Table t;
    t.set("pixels", static_cast<double>(pixels));
    t.set("non_finite_pixels", static_cast<double>(non_finite_pixels));
    const auto set = [&t](const char* name, double value) {
        if (!std::isnan(value)) t.set(name, value);
    };
    set("rmse", rmse);
    set("relmse", relmse);
    set("relmse_trimmed", relmse_trimmed);
    set("psnr", psnr);
    set("psnr_clamped", psnr_clamped);
    set("smape", smape);
    set("max_abs_error", max_abs_error);
    set("brightness_ratio", brightness_ratio);
    set("ssim", ssim);
    set("flip", flip);
    set("hdr_flip", hdr_flip);
    if (!std::isnan(hdr_flip)) {
        t.set("hdr_flip_start_exposure", hdr_flip_exposures.start);
        t.set("hdr_flip_stop_exposure", hdr_flip_exposures.stop);
        t.set("hdr_flip_exposures", static_cast<double>(hdr_flip_exposures.count));
    }
    return t;
}

ErrorMeter::ErrorMeter(const ErrorOptions& options)
    : m_options(options), m_flip(options.pixels_per_degree)
{
}

int ErrorMeter::halo_rows() const
{
    return std::max(m_options.ssim ? Ssim::radius : 0, m_options.flip ? m_flip.radius() : 0);
}

void ErrorMeter::add_rows(const ImagePair& pair, int y0, int y1, std::span<double> sums) const
{
    const Region& window = pair.window;
    const auto width = static_cast<std::size_t>(window.width());
    const auto height = static_cast<std::size_t>(y1 - y0);
    const auto row_sums = [&](int y) {
        return sums.subspan(static_cast<std::size_t>(y - y0) * sum_count, sum_count);
    };
    std::vector<unsigned char> good(width * height);

    PairRow row(window.width());
    for (int y = y0; y < y1; ++y) {
        const std::size_t bad = row.load(pair, y, window.x0, window.x1);
        std::copy_n(row.good(), width, good.data() + static_cast<std::size_t>(y - y0) * width);
        const auto s = row_sums(y);
        s[sum_good] += static_cast<double>(width - bad);
        s[sum_bad] += static_cast<double>(bad);
        const int channels = pair.image.channels();
        for (int c = 0; c < channels; ++c) {
            const ChannelSums one = channel_sums(row.image(c), row.reference(c), width);
            s[sum_squared] += one.squared_error;
            s[sum_squared_clamped] += one.squared_clamped;
            s[sum_relative] += one.relative;
            s[sum_smape] += one.smape;
            const double weight = channels == 3 ? luminance_weights[c] : 1.0;
            s[sum_luminance] += weight * one.image;
            s[sum_reference_luminance] += weight * one.reference;
            s[max_absolute] = std::max(s[max_absolute], one.largest);
        }
    }

    std::vector<double> values;
    const auto add_good = [&](std::span<const double> from, const unsigned char* counts,
                              std::span<double> s, std::size_t sum, std::size_t count) {
        std::vector<double> kept;
        for (std::size_t x = 0; x < from.size(); ++x)
            if (counts[x] != 0) kept.push_back(from[x]);
        s[sum] += pairwise_sum(kept);
        s[count] += static_cast<double>(kept.size());
    };
    if (m_options.ssim) {
        const int a = std::max(y0, window.y0 + Ssim::radius);
        const int b = std::min(y1, window.y1 - Ssim::radius);
        if (a < b && Ssim::inside(window, a)) {
            const std::size_t n = width - 2 * Ssim::radius;
            values.resize(n * static_cast<std::size_t>(b - a));
            std::vector<unsigned char> centres(values.size());
            m_ssim.rows(pair, a, b, values.data(), centres.data());
            for (int y = a; y < b; ++y) {
                const std::size_t at = static_cast<std::size_t>(y - a) * n;
                add_good(std::span<const double>(values).subspan(at, n), centres.data() + at,
                         row_sums(y), sum_ssim, sum_ssim_windows);
            }
        }
    }
    if (m_options.flip) {
        values.resize(width * height);
        m_flip.error(pair, {window.x0, y0, window.x1, y1}, {}, values.data(), window.width());
        for (int y = y0; y < y1; ++y) {
            const std::size_t at = static_cast<std::size_t>(y - y0) * width;
            add_good(std::span<const double>(values).subspan(at, width), good.data() + at,
                     row_sums(y), sum_flip, sum_flip_pixels);
        }
    }
}

void ErrorMeter::combine(std::span<double> into, std::span<const double> other)
{
    assert(into.size() == sum_count && other.size() == sum_count);
    for (std::size_t i = 0; i < sum_count; ++i)
        into[i] = i == max_absolute ? std::max(into[i], other[i]) : into[i] + other[i];
}

std::size_t ErrorMeter::left_out(std::span<const double> record)
{
    return static_cast<std::size_t>(record[sum_bad]);
}

ErrorMeasures ErrorMeter::measures(std::span<const double> totals, int channels) const
{
    ErrorMeasures m;
    m.pixels = static_cast<std::size_t>(totals[sum_good]);
    m.non_finite_pixels = static_cast<std::size_t>(totals[sum_bad]);
    if (m.pixels == 0) return m;
    const double n = totals[sum_good] * channels;
    const double mse = totals[sum_squared] / n;
    m.rmse = std::sqrt(mse);
    m.psnr = 10.0 * std::log10(1.0 / mse);
    m.psnr_clamped = 10.0 * std::log10(n / totals[sum_squared_clamped]);
    m.relmse = totals[sum_relative] / n;
    m.smape = totals[sum_smape] / n;
    m.max_abs_error = totals[max_absolute];
    if (totals[sum_reference_luminance] != 0.0)
        m.brightness_ratio = totals[sum_luminance] / totals[sum_reference_luminance];
    if (totals[sum_ssim_windows] > 0.0) m.ssim = totals[sum_ssim] / totals[sum_ssim_windows];
    if (totals[sum_flip_pixels] > 0.0) m.flip = totals[sum_flip] / totals[sum_flip_pixels];
    return m;
}

int ErrorMeter::map_halo(ErrorMap map) const { return map == ErrorMap::flip ? m_flip.radius() : 0; }

void ErrorMeter::map(const ImagePair& pair, ErrorMap map, ImageView out) const
{
    assert(map != ErrorMap::hdr_flip);
    const Region& region = out.region();
    const auto width = static_cast<std::size_t>(region.width());
    std::vector<double> values;
    if (map == ErrorMap::flip) {
        values.resize(region.pixels());
        m_flip.error(pair, region, {}, values.data(), region.width());
    }
    PairRow row(region.width());
    const int channels = pair.image.channels();
    for (int y = region.y0; y < region.y1; ++y) {
        row.load(pair, y, region.x0, region.x1);
        const std::span<float> to = out.row_span(0, y);
        for (std::size_t x = 0; x < width; ++x) {
            double error = 0.0;
            if (map == ErrorMap::flip) {
                const std::size_t at = static_cast<std::size_t>(y - region.y0) * width + x;
                error = row.good()[x] != 0 ? values[at] : 0.0;
            } else {
                for (int c = 0; c < channels; ++c) {
                    const double d = row.image(c)[x], r = row.reference(c)[x];
                    error += map == ErrorMap::absolute ? std::abs(d - r) : relative_squared(d, r);
                }
                error /= channels;
            }
            to[x] = static_cast<float>(error);
        }
    }
}

ErrorMeasures measure_errors(ConstImageView image, ConstImageView reference,
                             const ErrorOptions& options)
{
    check_pair(image, reference);
    const Region& region = image.region();
    const ImagePair pair{image, reference, region};
    const ErrorMeter meter(options);
    const auto width = static_cast<std::size_t>(region.width());

    std::vector<double> sums(static_cast<std::size_t>(region.height()) * ErrorMeter::sum_count);
    std::vector<double> pixel_relative(region.pixels());
    constexpr double left_out = -1.0;
    for_strips(region, [&](int y0, int y1) {
        meter.add_rows(pair, y0, y1,
                       std::span(sums).subspan(
                           static_cast<std::size_t>(y0 - region.y0) * ErrorMeter::sum_count,
                           static_cast<std::size_t>(y1 - y0) * ErrorMeter::sum_count));
        PairRow row(region.width());
        for (int y = y0; y < y1; ++y) {
            row.load(pair, y, region.x0, region.x1);
            double* to = pixel_relative.data() + static_cast<std::size_t>(y - region.y0) * width;
            for (std::size_t x = 0; x < width; ++x) {
                double sum = 0.0;
                for (int c = 0; c < image.channels(); ++c)
                    sum += relative_squared(row.image(c)[x], row.reference(c)[x]);
                to[x] = row.good()[x] != 0 ? sum / image.channels() : left_out;
            }
        }
    });
    tree_combine(sums, ErrorMeter::sum_count, ErrorMeter::combine);
    ErrorMeasures m = meter.measures(std::span<const double>(sums).first(ErrorMeter::sum_count),
                                     image.channels());
    if (m.pixels == 0)
        throw InputError("no pixel is finite in both images; there is nothing to measure");

    m.relmse_trimmed = trimmed_mean(pixel_relative, width, m.pixels);

    if (options.hdr_flip) {
        m.hdr_flip_exposures = hdr_exposures(pair, options);
        const Flip flip(options.pixels_per_degree);
        std::vector<double> row_sums(static_cast<std::size_t>(region.height()));
        for_strips(region, [&](int y0, int y1) {
            std::vector<double> flips, kept;
            hdr_flip_rows(flip, pair, m.hdr_flip_exposures, options.tone_mapper, y0, y1, flips);
            PairRow row(region.width());
            for (int y = y0; y < y1; ++y) {
                row.load(pair, y, region.x0, region.x1);
                kept.clear();
                for (std::size_t x = 0; x < width; ++x)
                    if (row.good()[x] != 0)
                        kept.push_back(flips[static_cast<std::size_t>(y - y0) * width + x]);
                row_sums[static_cast<std::size_t>(y - region.y0)] = pairwise_sum(kept);
            }
        });
        m.hdr_flip = pairwise_sum(row_sums) / static_cast<double>(m.pixels);
    }
    return m;
}

ImageBuffer error_map(ConstImageView image, ConstImageView reference, ErrorMap map,
                      const ErrorOptions& options)
{
    check_pair(image, reference);
    const Region& region = image.region();
    const ImagePair pair{image, reference, region};
    ImageBuffer out(region, 1);
    if (map != ErrorMap::hdr_flip) {
        const ErrorMeter meter(options);
        for_strips(region, [&](int y0, int y1) {
            meter.map(pair, map, out.view().crop({region.x0, y0, region.x1, y1}));
        });
        return out;
    }
    const ExposureRange exposures = hdr_exposures(pair, options);
    const Flip flip(options.pixels_per_degree);
    for_strips(region, [&](int y0, int y1) {
        std::vector<double> flips;
        hdr_flip_rows(flip, pair, exposures, options.tone_mapper, y0, y1, flips);
        PairRow row(region.width());
        std::size_t at = 0;
        for (int y = y0; y < y1; ++y) {
            row.load(pair, y, region.x0, region.x1);
            const std::span<float> to = out.view().row_span(0, y);
            for (std::size_t x = 0; x < to.size(); ++x, ++at)
                to[x] = row.good()[x] != 0 ? static_cast<float>(flips[at]) : 0.0f;
        }
    });
    return out;
}

} // namespace rayloom
