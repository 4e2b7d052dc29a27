// SPDX-License-Identifier: Apache-2.0
/// \file
/// Entries that look at a neighbourhood.
#include "nodes/oiio/convolution.h"
#include "nodes/oiio/imagebuf_bridge.h"
#include "rayloom/core/text.h"

#include <OpenImageIO/filter.h>
#include <OpenImageIO/imagebufalgo.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace rayloom::oiio
{
namespace
{

using OIIO::ImageBuf;
using OIIO::ROI;

/// All of OpenImageIO's filters, and what else can stand in the list.
std::vector<std::string> filter_names(std::vector<std::string> others = {})
{
    for (int i = 0; i < OIIO::Filter2D::num_filters(); ++i) {
        OIIO::FilterDesc desc;
        OIIO::Filter2D::get_filterdesc(i, &desc);
        others.emplace_back(desc.name);
    }
    return others;
}

using Filter = std::shared_ptr<OIIO::Filter2D>;

Filter make_filter(const std::string& name, float width, float height)
{
    Filter filter(OIIO::Filter2D::create(name, width, height), &OIIO::Filter2D::destroy);
    if (!filter) throw NodeError("there is no filter '" + name + "'");
    return filter;
}

float natural_width(const std::string& name)
{
    for (int i = 0; i < OIIO::Filter2D::num_filters(); ++i) {
        OIIO::FilterDesc desc;
        OIIO::Filter2D::get_filterdesc(i, &desc);
        if (name == desc.name) return desc.width;
    }
    throw NodeError("there is no filter '" + name + "'");
}

// ---------------------------------------------------------------------------------- convolution

/// A filter that reads `window` around a pixel and clamps at the display window.
Reads reads_window(const Region& window, const Region& display)
{
    return [window, display](const Region& region) {
        const Region r{region.x0 + window.x0, region.y0 + window.y0, region.x1 + window.x1 - 1,
                       region.y1 + window.y1 - 1};
        return with_clamped_border(r, display);
    };
}

void needs_window(PlanContext& context, const Region& window, const Region& display)
{
    context.needs("image", [reads = reads_window(window, display)](const Need& need) {
        return reads(need.region);
    });
}

/// Scales so that the weights sum to one.
void normalize(Kernel& kernel)
{
    float sum = 0.0f;
    for (std::size_t i = 0; i < kernel.window.pixels(); ++i) sum += kernel.weights[i];
    kernel.scale = 1.0f / sum;
}

/// A kernel of OpenImageIO's make_kernel().
Kernel named_kernel(const std::string& name, float width, float height, bool normalized)
{
    const ImageBuf buffer = OIIO::ImageBufAlgo::make_kernel(name, width, height, 1.0f, normalized);
    if (buffer.has_error() || !buffer.localpixels())
        throw NodeError("kernel '" + name + "': " + buffer.geterror());
    Kernel kernel;
    const ROI roi = buffer.roi();
    kernel.window = {roi.xbegin, roi.ybegin, roi.xend, roi.yend};
    for (ImageBuf::ConstIterator<float> p(buffer); !p.done(); ++p) kernel.weights.push_back(p[0]);
    return kernel;
}

Compute planned_convolution(PlanContext& context, const Kernel& kernel)
{
    const ImageDesc& image = context.input("image");
    const Region data = image.data, display = image.display;
    if (kernel.window == Region{0, 0, 1, 1} && kernel.weights[0] * kernel.scale == 1.0f)
        context.pass_through("image", "image");
    context.output("image", image);
    needs_window(context, kernel.window, display);
    return [kernel, data, display](const TileContext& tile) {
        tile.check_cancelled();
        convolve(tile.input("image"), data, display, kernel, tile.output("image"));
    };
}

Compute plan_blur(PlanContext& context, const Arguments& arguments)
{
    float width = arguments.real("width"), height = arguments.real("height");
    const float sigma = arguments.real("sigma");
    const std::string& name = arguments.text("kernel");
    if (sigma > 0.0f) {
        if (name != "gaussian")
            throw NodeError("'sigma' goes with the kernel 'gaussian'; '" + name +
                            "' takes 'width'");
        width = height = 4.0f * sigma; // OpenImageIO's Gaussian ends at two standard deviations
    }
    if (height <= 0.0f) height = width;
    Kernel kernel = named_kernel(name, width, height, true);
    normalize(kernel);
    return planned_convolution(context, kernel);
}

Compute plan_convolve(PlanContext& context, const Arguments& arguments)
{
    const std::string& name = arguments.text("named");
    if (context.has("kernel") == !name.empty())
        throw NodeError("give either an image at 'kernel' or a kernel's name in 'named'");
    const bool normalized = arguments.flag("normalize");
    if (!context.has("kernel")) {
        const float width = arguments.real("width"), height = arguments.real("height");
        Kernel kernel = named_kernel(name, width, height > 0.0f ? height : width, normalized);
        if (normalized) normalize(kernel);
        return planned_convolution(context, kernel);
    }
    const ImageDesc image = context.input("image"), weights = context.input("kernel");
    if (weights.channel_count() != 1 && weights.channel_count() < image.channel_count())
        throw NodeError("'kernel' has " + std::to_string(weights.channel_count()) +
                        " channels and 'image' " + std::to_string(image.channel_count()) +
                        "; it must have one for all or as many");
    constexpr std::size_t most = 1 << 16;
    if (weights.data.pixels() > most)
        throw NodeError("'kernel' is " + weights.data.text() + ": that is no kernel (at most " +
                        std::to_string(most) + " weights)");
    context.output("image", image);
    needs_window(context, weights.data, image.display);
    context.needs_all("kernel");
    return [image, weights, normalized](const TileContext& tile) {
        tile.check_cancelled();
        const ConstImageView view = tile.input("kernel");
        Kernel kernel;
        kernel.window = weights.data;
        kernel.channels = weights.channel_count();
        for (int c = 0; c < kernel.channels; ++c)
            for (int y = weights.data.y0; y < weights.data.y1; ++y)
                for (int x = weights.data.x0; x < weights.data.x1; ++x)
                    kernel.weights.push_back(view.at(c, x, y));
        if (normalized) normalize(kernel);
        convolve(tile.input("image"), image.data, image.display, kernel, tile.output("image"));
    };
}

// ------------------------------------------------------------------------- ranks and sharpening

/// A filter over a width × height window that takes only pixels of the data window.
auto window_filter(bool (*function)(ImageBuf&, const ImageBuf&, int, int, ROI, int))
{
    return [function](PlanContext& context, const Arguments& arguments) -> Compute {
        const ImageDesc& image = context.input("image");
        const int width = arguments.integer("width");
        const int height = arguments.integer("height") > 0 ? arguments.integer("height") : width;
        context.output("image", image);
        const int across = std::max(1, width / 2), down = std::max(1, height / 2);
        return on_imagebuf(context, image, image,
                           reads_window({-across, -down, across + 1, down + 1}, image.display),
                           [=](ImageBuf& result, const ImageBuf& in, const ROI& roi) {
                               return function(result, in, width, height, roi, 1);
                           });
    };
}

Compute plan_unsharp(PlanContext& context, const Arguments& arguments)
{
    const ImageDesc& image = context.input("image");
    const std::string kernel = arguments.text("kernel");
    const float width = arguments.real("width"), contrast = arguments.real("contrast"),
                threshold = arguments.real("threshold");
    context.output("image", image);
    const int reach = static_cast<int>(std::ceil(width)) / 2 + 1;
    return on_imagebuf(context, image, image,
                       reads_window({-reach, -reach, reach + 1, reach + 1}, image.display),
                       [=](ImageBuf& result, const ImageBuf& in, const ROI& roi) {
                           return OIIO::ImageBufAlgo::unsharp_mask(result, in, kernel, width,
                                                                   contrast, threshold, roi, 1);
                       });
}

// ------------------------------------------------------------------------------------ resampling

/// Calls `function` with images and region as if the display window began at 0, 0: OpenImageIO has
/// places in floats, which far from the origin miss their pixels.
OnImageBuf beside_origin(const Region& display, OnImageBuf function)
{
    return [x0 = display.x0, y0 = display.y0,
            function = std::move(function)](ImageBuf& out, const ImageBuf& in, const ROI& roi) {
        // The same pixels, not copied.
        const auto moved = [&](const ImageBuf& image) {
            OIIO::ImageSpec spec = image.spec();
            spec.x -= x0;
            spec.y -= y0;
            spec.full_x -= x0;
            spec.full_y -= y0;
            return ImageBuf(spec, const_cast<void*>(image.localpixels()));
        };
        ImageBuf result = moved(out);
        const ROI part(roi.xbegin - x0, roi.xend - x0, roi.ybegin - y0, roi.yend - y0, 0, 1,
                       roi.chbegin, roi.chend);
        if (function(result, moved(in), part)) return true;
        out.errorfmt("{}", result.geterror());
        return false;
    };
}

int scaled(int n, double ratio) { return std::max(1, static_cast<int>(n * ratio + 0.5)); }

Compute plan_resize(PlanContext& context, const Arguments& arguments)
{
    const ImageDesc image = context.input("image");
    ImageDesc result = image;
    const double ratio = arguments.real("ratio");
    int width = arguments.integer("width"), height = arguments.integer("height");
    if ((ratio > 0.0) == (width > 0 || height > 0))
        throw NodeError("give either 'ratio' or 'width' and 'height' (one of these keeps the "
                        "proportions)");
    if (image.display.empty() || image.data.empty()) throw NodeError("the image has no pixels");
    if (ratio > 0.0) {
        width = scaled(image.display.width(), ratio);
        height = scaled(image.display.height(), ratio);
    } else if (width == 0) {
        width = scaled(image.display.width(), double(height) / image.display.height());
    } else if (height == 0) {
        height = scaled(image.display.height(), double(width) / image.display.width());
    }
    const Region from = image.display;
    result.display = {from.x0, from.y0, from.x0 + width, from.y0 + height};
    const float xratio = static_cast<float>(width) / static_cast<float>(from.width()),
                yratio = static_cast<float>(height) / static_cast<float>(from.height());
    if (result.display == image.display) {
        context.pass_through("image", "image");
    } else {
        const auto floor_of = [](int n, float r) {
            return static_cast<int>(std::floor(static_cast<float>(n) * r));
        };
        const auto ceil_of = [](int n, float r) {
            return static_cast<int>(std::ceil(static_cast<float>(n) * r));
        };
        const int x = from.x0 + floor_of(image.data.x0 - from.x0, xratio),
                  y = from.y0 + floor_of(image.data.y0 - from.y0, yratio);
        result.data = {x, y, x + ceil_of(image.data.width(), xratio),
                       y + ceil_of(image.data.height(), yratio)};
    }
    std::string name = arguments.text("filter");
    if (name == "default") name = xratio > 1.0f || yratio > 1.0f ? "blackman-harris" : "lanczos3";
    const float given = arguments.real("filter_width");
    const float natural = natural_width(name);
    const Filter filter = make_filter(name, given > 0.0f ? given : natural * std::max(1.0f, xratio),
                                      given > 0.0f ? given : natural * std::max(1.0f, yratio));

    // A pixel reads the source pixel under its centre and the filter's radius around it;
    // OpenImageIO takes the radius of both directions from the filter's width.
    const int radius_x = static_cast<int>(std::ceil(filter->width() / 2.0f / xratio)),
              radius_y = static_cast<int>(std::ceil(filter->width() / 2.0f / yratio));
    if (!filter->separable() && radius_x != radius_y)
        throw NodeError("the filter '" + name +
                        "' is not separable and OpenImageIO resizes with it only when width and "
                        "height change alike; use another filter, such as lanczos3");
    const int reach_x = radius_x + 2, reach_y = radius_y + 2;
    const Region to = result.display;
    context.output("image", result);
    const auto reads = [=](const Region& r) {
        const auto source = [](int p, int origin, int size, int source_origin, int source_size) {
            return source_origin +
                   static_cast<int>(std::floor((p - origin + 0.5) / size * source_size));
        };
        const Region read{source(r.x0, to.x0, to.width(), from.x0, from.width()) - reach_x,
                          source(r.y0, to.y0, to.height(), from.y0, from.height()) - reach_y,
                          source(r.x1 - 1, to.x0, to.width(), from.x0, from.width()) + reach_x + 1,
                          source(r.y1 - 1, to.y0, to.height(), from.y0, from.height()) + reach_y +
                              1};
        return with_clamped_border(read, from);
    };
    const auto resize = [filter](ImageBuf& out, const ImageBuf& in, const ROI& roi) {
        return OIIO::ImageBufAlgo::resize(out, in, filter.get(), roi, 1);
    };
    return on_imagebuf(context, image, result, reads, beside_origin(from, resize));
}

Compute plan_rotate(PlanContext& context, const Arguments& arguments)
{
    const ImageDesc image = context.input("image");
    const float degrees = arguments.real("angle");
    const float angle = degrees * static_cast<float>(std::numbers::pi / 180.0);
    const Region d = image.display;
    const std::vector<float> given = arguments.reals("center");
    if (!given.empty() && given.size() != 2) throw NodeError("'center' takes two numbers, x and y");
    // From the corner of the display window.
    const float cx = given.empty() ? 0.5f * static_cast<float>(d.width())
                                   : given[0] - static_cast<float>(d.x0),
                cy = given.empty() ? 0.5f * static_cast<float>(d.height())
                                   : given[1] - static_cast<float>(d.y0);
    const std::string& name = arguments.text("filter");
    const float natural = arguments.real("filter_width") > 0.0f ? arguments.real("filter_width")
                                                                : natural_width(name);
    const Filter filter = make_filter(name, natural, natural);
    context.output("image", image);
    const auto reads = [=](const Region& r) {
        const double c = std::cos(-double(angle)), s = std::sin(-double(angle));
        double x0 = 1e30, y0 = 1e30, x1 = -1e30, y1 = -1e30;
        for (const int x : {r.x0, r.x1})
            for (const int y : {r.y0, r.y1}) {
                const double px = d.x0 + double(cx), py = d.y0 + double(cy);
                const double dx = x - px, dy = y - py;
                const double sx = px + c * dx - s * dy, sy = py + s * dx + c * dy;
                x0 = std::min(x0, sx), x1 = std::max(x1, sx);
                y0 = std::min(y0, sy), y1 = std::max(y1, sy);
            }
        // The filter's square is turned too: half its diagonal, and a pixel for the rounding.
        const int reach = static_cast<int>(std::ceil(natural * 0.75f)) + 2;
        return Region{
            static_cast<int>(std::floor(x0)) - reach, static_cast<int>(std::floor(y0)) - reach,
            static_cast<int>(std::ceil(x1)) + reach, static_cast<int>(std::ceil(y1)) + reach};
    };
    const auto rotate = [=](ImageBuf& out, const ImageBuf& in, const ROI& roi) {
        return OIIO::ImageBufAlgo::rotate(out, in, angle, cx, cy, filter.get(), false, roi, 1);
    };
    return on_imagebuf(context, image, image, reads, beside_origin(d, rotate));
}

ParamInfo at_least(ParamInfo param, double lo)
{
    param.min = lo;
    return param;
}

} // namespace

std::vector<Operation> filter_operations()
{
    const std::string border = "Beyond the data window the nearest pixel of the display window "
                               "counts, or zero where that is no pixel either.";
    const std::string filtered = "The same bits as ImageBufAlgo on the whole image.";
    const std::vector<std::string> kernels = filter_names({"binomial", "laplacian"});
    std::vector<Operation> table;
    table.push_back(
        {"blur",
         "--blur",
         "Blurs an image with a kernel of given size.",
         border,
         filtered,
         {image_port("image", "any image")},
         {choice_param("kernel", "gaussian", kernels, "shape of the kernel"),
          at_least(real_param("width", 3.0, "px", "width of the kernel"), 1e-3),
          at_least(real_param("height", 0.0, "px", "height of the kernel; 0: the width"), 0.0),
          at_least(real_param("sigma", 0.0, "px",
                              "standard deviation of a Gaussian, in place of its width (four "
                              "standard deviations); 0: not used"),
                   0.0)},
         "image: image, width: 5",
         plan_blur});
    table.push_back(
        {"convolve",
         "--convolve",
         "Convolves an image with the pixels of another or with a named kernel.",
         "The kernel's data window says where its weights lie around the pixel: the middle of a "
         "3 × 3 kernel is at (0, 0) when its window starts at (−1, −1), as oiiotool --kernel makes "
         "it. " +
             border,
         filtered,
         {image_port("image", "any image"),
          optional_port("kernel", "image of weights, with one channel or as many as the image")},
         {text_param("named", "", "name of one of OpenImageIO's kernels, in place of an image"),
          at_least(real_param("width", 3.0, "px", "width of a named kernel"), 1e-3),
          at_least(real_param("height", 0.0, "px", "height of a named kernel; 0: the width"), 0.0),
          flag_param("normalize", true, "divides by the sum of the weights")},
         "image: image, named: laplacian, normalize: false",
         plan_convolve});
    const auto window_params = [](const std::string& what) {
        return std::vector<ParamInfo>{
            integer_param("width", 3, 1, 255, "px", "width of the window " + what),
            integer_param("height", 0, 0, 255, "px", "height of the window; 0: the width")};
    };
    table.push_back({"median",
                     "--median",
                     "Replaces a pixel by the median of its neighbourhood, channel by channel.",
                     "Only pixels of the data window count.",
                     filtered,
                     {image_port("image", "any image")},
                     window_params("the median is taken over"),
                     "image: image, width: 3",
                     window_filter(&OIIO::ImageBufAlgo::median_filter)});
    table.push_back({"dilate",
                     "--dilate",
                     "Replaces a pixel by the largest of its neighbourhood, channel by channel.",
                     "Only pixels of the data window count.",
                     filtered,
                     {image_port("image", "any image")},
                     window_params("the maximum is taken over"),
                     "image: image, width: 3",
                     window_filter(&OIIO::ImageBufAlgo::dilate)});
    table.push_back({"erode",
                     "--erode",
                     "Replaces a pixel by the smallest of its neighbourhood, channel by channel.",
                     "Only pixels of the data window count.",
                     filtered,
                     {image_port("image", "any image")},
                     window_params("the minimum is taken over"),
                     "image: image, width: 3",
                     window_filter(&OIIO::ImageBufAlgo::erode)});
    table.push_back(
        {"unsharp",
         "--unsharp",
         "Sharpens by adding the difference to a blurred copy.",
         border,
         filtered,
         {image_port("image", "any image")},
         {choice_param("kernel", "gaussian", filter_names({"binomial", "median"}),
                       "kernel of the blurred copy"),
          at_least(real_param("width", 3.0, "px", "width of the kernel"), 1.0),
          real_param("contrast", 1.0, "1", "factor of the difference"),
          at_least(real_param("threshold", 0.0, "radiance", "smaller differences count as none"),
                   0.0)},
         "image: image",
         plan_unsharp});
    table.push_back(
        {"resize",
         "--resize",
         "Changes the resolution with a filter.",
         "The display windows of input and result cover each other; the data window follows. "
         "Beyond the data window the nearest pixel of the display window counts. Filters with "
         "negative lobes (lanczos3) make values below zero beside highlights.",
         filtered,
         {image_port("image", "any image")},
         {integer_param("width", 0, 0, 1 << 24, "px", "new width of the display window"),
          integer_param("height", 0, 0, 1 << 24, "px", "new height of the display window"),
          at_least(real_param("ratio", 0.0, "1", "new size over the old one, in place of them"),
                   0.0),
          choice_param("filter", "default", filter_names({"default"}),
                       "default: blackman-harris to enlarge, lanczos3 to reduce"),
          at_least(real_param("filter_width", 0.0, "px",
                              "width of the filter in pixels of the result; 0: its natural one"),
                   0.0)},
         "image: image, ratio: 0.5",
         plan_resize});
    table.push_back(
        {"rotate",
         "--rotate",
         "Turns the picture by any angle within its windows.",
         "Beyond the data window it is zero.",
         filtered,
         {image_port("image", "any image")},
         {required(real_param("angle", 0.0, "degrees", "clockwise")),
          reals_param("center", {},
                      "x and y of what stays in place; empty: the middle of the "
                      "display window"),
          choice_param("filter", "lanczos3", filter_names(), "resampling filter"),
          at_least(real_param("filter_width", 0.0, "px", "width of the filter; 0: its natural one"),
                   0.0)},
         "image: image, angle: 15",
         plan_rotate});
    return table;
}

} // namespace rayloom::oiio
