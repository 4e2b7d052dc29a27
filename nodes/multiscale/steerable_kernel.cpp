// SPDX-License-Identifier: Apache-2.0
#include "nodes/multiscale/steerable_kernel.h"

#include "rayloom/core/error.h"
#include "rayloom/image/mirrored.h"
#include "rayloom/simd/row_filters.h"

#include <array>
#include <cassert>
#include <charconv>
#include <cmath>
#include <numbers>
#include <vector>

namespace rayloom
{
namespace
{

/// D/2 of level l (1, 2, …).
int half_distance(int level) { return 1 << (level - 1); }

/// Signed taps of an orientation: it is image(+dx, +dy) − image(−dx, −dy), in units of D/2.
struct Direction {
    int dx, dy;
};
constexpr std::array<Direction, steerable_orientations> directions{
    {{1, 0}, {1, 1}, {0, 1}, {1, -1}}};
bool diagonal(int orientation) { return orientation % 2 == 1; }

/// Root of the weight the identity gives the direction, times the band's scale.
float analysis_gain(int level, int orientation)
{
    const double scale = std::numbers::sqrt2 * half_distance(level);
    return static_cast<float>((diagonal(orientation) ? 0.25 : 0.25 * std::numbers::sqrt2) * scale);
}
/// The same root, divided by the band's scale.
float synthesis_gain(int level, int orientation)
{
    const double scale = std::numbers::sqrt2 * half_distance(level);
    return static_cast<float>((diagonal(orientation) ? 0.25 : 0.25 * std::numbers::sqrt2) / scale);
}

std::size_t width(const Region& r) { return static_cast<std::size_t>(r.width()); }

/// out(i) = mean of in(i + {lo, hi}, j + {lo, hi}).
void mean_of_four(ConstImageView in, int lo, int hi, ImageView out)
{
    const Region& r = out.region();
    for (int y = r.y0; y < r.y1; ++y)
        mean_of_four_row(in.ptr(0, r.x0 + lo, y + lo), in.ptr(0, r.x0 + hi, y + lo),
                         in.ptr(0, r.x0 + lo, y + hi), in.ptr(0, r.x0 + hi, y + hi), out.row(0, y),
                         width(r));
}

Region grown(const Region& r, int left_up, int right_down)
{
    return r.grown({left_up, right_down, left_up, right_down});
}

} // namespace

double SteerableBand::white_noise_gain() const
{
    switch (kind) {
    // 1 − 2·(1/4) + 9/64: the centre tap of the 3 × 3 binomial, and the sum of its squared taps.
    case Kind::high: return std::sqrt(41.0 / 64.0);
    case Kind::oriented: return diagonal(orientation) ? 0.25 : 0.25 * std::numbers::sqrt2;
    case Kind::low: return 1.0 / (2.0 * (1 << level));
    }
    return 0.0;
}

std::string SteerableBand::name() const
{
    switch (kind) {
    case Kind::high: return "high";
    case Kind::low: return "low" + std::to_string(level);
    case Kind::oriented: break;
    }
    return "level" + std::to_string(level) + ".band" + std::to_string(orientation + 1);
}

int steerable_band_count(int levels) { return steerable_orientations * levels + 2; }

SteerableBand steerable_band(int index, int levels)
{
    assert(index >= 0 && index < steerable_band_count(levels));
    if (index == 0) return {};
    if (index == steerable_band_count(levels) - 1) return {SteerableBand::Kind::low, levels, 0};
    return {SteerableBand::Kind::oriented, (index - 1) / steerable_orientations + 1,
            (index - 1) % steerable_orientations};
}

SteerableBand band_of_channel(std::string_view channel)
{
    const auto number = [](std::string_view text, std::string_view prefix, int most) {
        int n = 0;
        if (!text.starts_with(prefix)) return 0;
        const char* const end = text.data() + text.size();
        const auto [stop, error] = std::from_chars(text.data() + prefix.size(), end, n);
        return error == std::errc() && stop == end && n >= 1 && n <= most ? n : 0;
    };
    if (channel.starts_with("high.")) return {};
    // The low-pass says how many levels lie above it: "low3.R".
    const std::size_t dot = channel.find('.');
    if (dot != std::string_view::npos) {
        const std::string_view first = channel.substr(0, dot);
        if (const int level = number(first, "low", steerable_max_levels))
            return {SteerableBand::Kind::low, level, 0};
        if (const int level = number(first, "level", steerable_max_levels)) {
            const std::string_view rest = channel.substr(dot + 1);
            const std::size_t next = rest.find('.');
            if (next != std::string_view::npos)
                if (const int band = number(rest.substr(0, next), "band", steerable_orientations))
                    return {SteerableBand::Kind::oriented, level, band - 1};
        }
    }
    throw NodeError("channel '" + std::string(channel) +
                    "' is not of a band; connect a band of multiscale.steerable");
}

std::string plain_channel(std::string_view channel)
{
    const std::size_t dot = channel.rfind('.');
    return std::string(dot == std::string_view::npos ? channel : channel.substr(dot + 1));
}

Halo steerable_halo(const SteerableBand& band)
{
    if (band.kind == SteerableBand::Kind::high) return {};
    const int reach = 1 << band.level;
    return {reach, reach - 1, reach, reach - 1};
}

Region steerable_need(const SteerableBand& band, const Region& region)
{
    switch (band.kind) {
    case SteerableBand::Kind::high: return grown(region, 1, 1);
    case SteerableBand::Kind::oriented:
    case SteerableBand::Kind::low: break;
    }
    const int reach = 1 << band.level;
    return grown(region, reach - 1, reach);
}

std::size_t steerable_analysis_scratch(const SteerableBand& band, const Region& region)
{
    return 2 * ImageBuffer::bytes_for(steerable_need(band, region), 1);
}

void steerable_analyse(const SteerableBand& band, const Region& window, ConstImageView image,
                       ImageView out)
{
    const Region& region = out.region();
    const Region need = steerable_need(band, region);
    // Inside the image nothing is mirrored and nothing copied.
    ImageBuffer mirrored;
    ConstImageView in = image;
    if (!image.region().contains(need) || !window.contains(need)) {
        mirrored.reshape(need, 1);
        for (int y = need.y0; y < need.y1; ++y)
            load_mirrored_row(image, window, y, need, mirrored.view().row(0, y));
        in = mirrored.view();
    }
    if (band.kind == SteerableBand::Kind::high) {
        for (int y = region.y0; y < region.y1; ++y) {
            const auto row = [&](int at) { return in.ptr(0, region.x0, at); };
            binomial_rest_row(row(y - 1), row(y), row(y + 1), out.row(0, y), width(region));
        }
        return;
    }

    const bool low = band.kind == SteerableBand::Kind::low;
    // Means of squares up to D = 2^(level−1), or 2^level for the low-pass.
    std::array<ImageBuffer, 2> buffers;
    int at = 0;
    const int means = low ? band.level : band.level - 1;
    // Regions from the last step back to the first.
    std::vector<Region> regions(static_cast<std::size_t>(means) + 1);
    Region r = low ? region : grown(region, half_distance(band.level), half_distance(band.level));
    for (int l = means; l >= 0; --l) {
        regions[static_cast<std::size_t>(l)] = r;
        if (l > 0) r = grown(r, half_distance(l), half_distance(l));
    }
    for (int l = 0; l <= means; ++l) {
        ImageView to = out;
        if (!low || l < means) {
            buffers[static_cast<std::size_t>(at)].reshape(regions[static_cast<std::size_t>(l)], 1);
            to = buffers[static_cast<std::size_t>(at)].view();
            at = 1 - at;
        }
        const int h = l == 0 ? 0 : half_distance(l);
        mean_of_four(in, -h, l == 0 ? 1 : h, to);
        in = to;
    }
    if (low) return;

    const Direction d = directions[static_cast<std::size_t>(band.orientation)];
    const int h = half_distance(band.level);
    const float gain = analysis_gain(band.level, band.orientation);
    for (int y = region.y0; y < region.y1; ++y) {
        const float* const plus = in.ptr(0, region.x0 + h * d.dx, y + h * d.dy);
        const float* const minus = in.ptr(0, region.x0 - h * d.dx, y - h * d.dy);
        difference_row(plus, minus, gain, out.row(0, y), width(region));
    }
}

std::size_t steerable_synthesis_scratch(int levels, const Region& region)
{
    return 2 * ImageBuffer::bytes_for(grown(region, 1 << levels, 1 << levels), 1);
}

void steerable_synthesise(int levels, std::span<const ConstImageView> bands, ImageView out)
{
    const Region& region = out.region();
    ConstImageView low = bands.back();
    std::array<ImageBuffer, 2> buffers;
    for (int level = levels; level >= 1; --level) {
        // What level − 1 has to cover for the levels below it.
        const int reach = 1 << (level - 1);
        const Region r = grown(region, reach, reach - 1);
        ImageBuffer& buffer = buffers[static_cast<std::size_t>(level % 2)];
        buffer.reshape(r, 1);
        const ImageView to = buffer.view();
        const int h = half_distance(level);
        const float upright = synthesis_gain(level, 0), slanted = synthesis_gain(level, 1);
        const auto band = [&](int orientation) {
            return bands[static_cast<std::size_t>(1 + (level - 1) * steerable_orientations +
                                                  orientation)];
        };
        for (int y = r.y0; y < r.y1; ++y) {
            const auto at = [&](ConstImageView v, int dx, int dy) {
                return v.ptr(0, r.x0 + h * dx, y + h * dy);
            };
            frame_row(
                {{at(low, -1, -1), at(low, 1, -1), at(low, -1, 1), at(low, 1, 1)},
                 {at(band(0), -1, 0), at(band(0), 1, 0), at(band(2), 0, -1), at(band(2), 0, 1)},
                 {at(band(1), -1, -1), at(band(1), 1, 1), at(band(3), -1, 1), at(band(3), 1, -1)},
                 upright,
                 slanted},
                to.row(0, y), width(r));
        }
        low = to;
    }
    for (int y = region.y0; y < region.y1; ++y)
        add_low_row(bands.front().ptr(0, region.x0, y), low.ptr(0, region.x0, y - 1),
                    low.ptr(0, region.x0, y), out.row(0, y), width(region));
}

} // namespace rayloom
