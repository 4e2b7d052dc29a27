// SPDX-License-Identifier: Apache-2.0
#include "nodes/oiio/imagebuf_bridge.h"
#include "rayloom/core/colour_channels.h"

#include <algorithm>
#include <numeric>

namespace rayloom::oiio
{
namespace
{

/// Pixels a call of ImageBufAlgo may read, each as often as it is read: about a tenth of a second
/// of sorting for a median.
constexpr std::size_t reads_at_once = std::size_t{1} << 22;

std::vector<int> all_channels(int count)
{
    std::vector<int> channels(static_cast<std::size_t>(count));
    std::iota(channels.begin(), channels.end(), 0);
    return channels;
}

} // namespace

OIIO::ROI roi_of(const Region& region, int channels)
{
    return {region.x0, region.x1, region.y0, region.y1, 0, 1, 0, channels};
}

OIIO::ImageBuf empty_imagebuf(const ImageDesc& image, const Region& part)
{
    OIIO::ImageSpec spec(part.width(), part.height(), image.channel_count(), OIIO::TypeDesc::FLOAT);
    spec.x = part.x0;
    spec.y = part.y0;
    spec.full_x = image.display.x0;
    spec.full_y = image.display.y0;
    spec.full_width = image.display.width();
    spec.full_height = image.display.height();
    spec.channelnames = image.channels;
    spec.alpha_channel = image.alpha();
    spec.z_channel = image.channel("Z");
    return OIIO::ImageBuf(spec, OIIO::InitializePixels::No);
}

OIIO::ImageBuf to_imagebuf(const ConstImageView& view, const ImageDesc& image)
{
    return to_imagebuf(view, all_channels(view.channels()), image);
}

OIIO::ImageBuf to_imagebuf(const ConstImageView& view, std::span<const int> channels,
                           const ImageDesc& image)
{
    OIIO::ImageBuf buffer = empty_imagebuf(image, view.region());
    const Region& region = view.region();
    const auto count = static_cast<std::ptrdiff_t>(channels.size());
    const std::ptrdiff_t width = region.width();
    auto* pixels = static_cast<float*>(buffer.localpixels());
    for (int y = region.y0; y < region.y1; ++y, pixels += count * width)
        for (std::ptrdiff_t c = 0; c < count; ++c) {
            const float* from = view.row(channels[static_cast<std::size_t>(c)], y);
            float* to = pixels + c;
            for (std::ptrdiff_t x = 0; x < width; ++x) to[x * count] = from[x];
        }
    return buffer;
}

void from_imagebuf(const OIIO::ImageBuf& buffer, const ImageView& out)
{
    from_imagebuf(buffer, out, all_channels(out.channels()));
}

void from_imagebuf(const OIIO::ImageBuf& buffer, const ImageView& out,
                   std::span<const int> channels)
{
    const auto count = static_cast<std::ptrdiff_t>(channels.size());
    if (buffer.has_error() || buffer.nchannels() != count ||
        buffer.spec().format != OIIO::TypeDesc::FLOAT || !buffer.localpixels())
        throw Error("OpenImageIO: " + (buffer.has_error()
                                           ? buffer.geterror()
                                           : std::string("the result is not what was asked for")));
    const Region& region = out.region();
    const std::ptrdiff_t width = region.width();
    for (int y = region.y0; y < region.y1; ++y) {
        const auto* pixels = static_cast<const float*>(buffer.pixeladdr(region.x0, y));
        for (std::ptrdiff_t c = 0; c < count; ++c) {
            const float* from = pixels + c;
            float* to = out.row(channels[static_cast<std::size_t>(c)], y);
            for (std::ptrdiff_t x = 0; x < width; ++x) to[x] = from[x * count];
        }
    }
}

Compute on_imagebuf(PlanContext& context, ImageDesc input, ImageDesc output, Reads reads,
                    OnImageBuf function)
{
    context.needs("image", [reads](const Need& need) { return reads(need.region); });
    return [input = std::move(input), output = std::move(output), reads = std::move(reads),
            function = std::move(function)](const TileContext& tile) {
        const Region& region = tile.region();
        // The engine may show more: a band of rows is as wide as the image.
        const ConstImageView all = tile.input("image");
        const ConstImageView view = all.crop(reads(region).intersect(all.region()));
        const ImageView out = tile.output("image");
        tile.check_cancelled();
        if (view.empty()) { // nothing of the image reaches here
            for (int c = 0; c < out.channels(); ++c)
                for (int y = region.y0; y < region.y1; ++y)
                    std::ranges::fill(out.row_span(c, y), 0.0f);
            return;
        }
        OIIO::ImageBuf result = empty_imagebuf(output, region);
        const OIIO::ImageBuf image = to_imagebuf(view, input);
        // ImageBufAlgo cannot be interrupted: what reads a wide neighbourhood is asked for a few
        // rows at a time, so that a run stops soon after it is asked to.
        const std::size_t window =
            static_cast<std::size_t>(std::max(1, view.region().width() - region.width() + 1) *
                                     std::max(1, view.region().height() - region.height() + 1));
        const std::size_t row_reads = window * static_cast<std::size_t>(region.width()) *
                                      static_cast<std::size_t>(output.channel_count());
        const int rows = static_cast<int>(std::clamp<std::size_t>(
            reads_at_once / std::max<std::size_t>(row_reads, 1), 1, 1 << 20));
        for (Region part = region; part.y0 < region.y1; part.y0 = part.y1) {
            part.y1 = std::min(part.y0 + rows, region.y1);
            tile.check_cancelled();
            if (!function(result, image, roi_of(part, output.channel_count())))
                throw Error("OpenImageIO: " + result.geterror());
        }
        from_imagebuf(result, out);
    };
}

Compute on_channels(PlanContext& context, std::vector<int> channels, OnImageBuf function)
{
    const ImageDesc& image = context.input("image");
    PassedChannels others;
    others.plan(context, "image", channels);
    return
        [part = image.with_channels(channel_names(image, channels)), channels = std::move(channels),
         others = std::move(others), function = std::move(function)](const TileContext& tile) {
            const Region& region = tile.region();
            const ConstImageView view = tile.input("image").crop(region);
            const ImageView out = tile.output("image");
            tile.check_cancelled();
            others.copy(view, out);
            OIIO::ImageBuf result = empty_imagebuf(part, region);
            if (!function(result, to_imagebuf(view, channels, part),
                          roi_of(region, part.channel_count())))
                throw Error("OpenImageIO: " + result.geterror());
            from_imagebuf(result, out, channels);
        };
}

Region with_clamped_border(const Region& region, const Region& display)
{
    if (region.empty() || display.empty()) return region;
    const auto cx = [&](int x) { return std::clamp(x, display.x0, display.x1 - 1); };
    const auto cy = [&](int y) { return std::clamp(y, display.y0, display.y1 - 1); };
    return region.hull(
        {cx(region.x0), cy(region.y0), cx(region.x1 - 1) + 1, cy(region.y1 - 1) + 1});
}

} // namespace rayloom::oiio
