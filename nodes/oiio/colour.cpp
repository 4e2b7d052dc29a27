// SPDX-License-Identifier: Apache-2.0
/// \file
/// Entries that change colours: OpenColorIO transforms, ranges, maps and repairs.
#include "nodes/oiio/imagebuf_bridge.h"
#include "nodes/threshold/sanitize_kernel.h"
#include "rayloom/core/text.h"

#include <OpenImageIO/color.h>
#include <OpenImageIO/imagebufalgo.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <utility>

namespace rayloom::oiio
{
namespace
{

using OIIO::ImageBuf;
using OIIO::ROI;
using Config = std::shared_ptr<OIIO::ColorConfig>;
using Processor = OIIO::ColorProcessorHandle;

/// A path that can name no file: OpenImageIO then has its built-in spaces alone. An empty path
/// would make it read $OCIO, and a graph reads only what it is given.
constexpr const char* no_file = "/dev/null/none";

Config open_config(const Arguments& arguments)
{
    const std::string& path = arguments.text("config");
    auto config = std::make_shared<OIIO::ColorConfig>(path.empty() ? no_file : path);
    const std::string error = config->geterror(); // taken in any case, so that it is not seen later
    if (!path.empty() && !error.empty())
        throw NodeError("'config': cannot read the OpenColorIO configuration '" + path +
                        "': " + error);
    return config;
}

Config require_config(const Arguments& arguments)
{
    if (arguments.text("config").empty())
        throw NodeError("needs 'config', the path of an OpenColorIO configuration");
    return open_config(arguments);
}

/// The transform, or a NodeError that says which of the named spaces is unknown.
Processor checked(Processor processor, OIIO::ColorConfig& config, const std::string& what,
                  std::initializer_list<std::pair<const char*, std::string>> spaces)
{
    std::string error = config.geterror();
    if (processor) return processor;
    const std::vector<std::string> names = config.getColorSpaceNames();
    for (const auto& [param, space] : spaces)
        if (std::ranges::find(names, space) == names.end() &&
            config.getColorSpaceNameByRole(space) == nullptr)
            throw NodeError("'" + std::string(param) + "': there is no colour space '" + space +
                            "'" + suggestion(space, names));
    throw NodeError(what + ": " + (error.empty() ? "there is no such transform" : error));
}

/// Red, green, blue and alpha; for an image without them its first channels, as OpenImageIO does.
std::vector<int> colour_channels(const ImageDesc& image)
{
    std::vector<int> channels = image.colour();
    if (channels.size() > 3) channels.resize(3);
    if (image.alpha() >= 0) channels.push_back(image.alpha());
    return channels;
}

Compute apply(PlanContext& context, const Arguments& arguments, Processor processor)
{
    const ImageDesc& image = context.input("image");
    const std::vector<int> channels = colour_channels(image);
    context.output("image", image);
    if (processor->isNoOp()) context.pass_through("image", "image");
    const bool unpremult = arguments.flag("unpremult");
    return on_channels(context, channels,
                       [processor, unpremult](ImageBuf& out, const ImageBuf& in, const ROI& roi) {
                           return OIIO::ImageBufAlgo::colorconvert(out, in, processor.get(),
                                                                   unpremult, roi, 1);
                       });
}

Compute plan_colorconvert(PlanContext& context, const Arguments& arguments)
{
    const Config config = open_config(arguments);
    const std::string &from = arguments.text("from"), &to = arguments.text("to");
    return apply(context, arguments,
                 checked(config->createColorProcessor(from, to), *config,
                         "from '" + from + "' to '" + to + "'", {{"from", from}, {"to", to}}));
}

Compute plan_display(PlanContext& context, const Arguments& arguments)
{
    const Config config = require_config(arguments);
    std::string display = arguments.text("display"), view = arguments.text("view");
    const std::vector<std::string> displays = config->getDisplayNames();
    if (display.empty()) {
        const char* usual = config->getDefaultDisplayName();
        if (!usual || !*usual) throw NodeError("the configuration has no display");
        display = usual;
    }
    if (std::ranges::find(displays, display) == displays.end())
        throw NodeError("'display': there is no display '" + display + "'" +
                        suggestion(display, displays));
    const std::vector<std::string> views = config->getViewNames(display);
    if (view.empty()) {
        const char* usual = config->getDefaultViewName(display);
        view = usual ? usual : "";
    }
    if (std::ranges::find(views, view) == views.end())
        throw NodeError("'view': the display '" + display + "' has no view '" + view + "'" +
                        suggestion(view, views));
    const std::string& from = arguments.text("from");
    return apply(
        context, arguments,
        checked(config->createDisplayTransform(display, view, from, arguments.text("looks")),
                *config, "display '" + display + "', view '" + view + "'", {{"from", from}}));
}

Compute plan_look(PlanContext& context, const Arguments& arguments)
{
    const Config config = require_config(arguments);
    const std::string &looks = arguments.text("looks"), &from = arguments.text("from"),
                      &to = arguments.text("to").empty() ? from : arguments.text("to");
    return apply(context, arguments,
                 checked(config->createLookTransform(looks, from, to, arguments.flag("inverse")),
                         *config, "look '" + looks + "'", {{"from", from}, {"to", to}}));
}

Compute plan_file_transform(PlanContext& context, const Arguments& arguments)
{
    const Config config = require_config(arguments);
    const std::string& file = arguments.text("file");
    return apply(context, arguments,
                 checked(config->createFileTransform(file, arguments.flag("inverse")), *config,
                         "file transform '" + file + "'", {}));
}

// -------------------------------------------------------------------------- ranges, maps, repairs

/// Pixel by pixel on all channels.
Compute on_pixels(PlanContext& context, OnImageBuf function)
{
    const ImageDesc& image = context.input("image");
    context.output("image", image);
    std::vector<int> all;
    for (int c = 0; c < image.channel_count(); ++c) all.push_back(c);
    return on_channels(context, std::move(all), std::move(function));
}

Compute plan_saturate(PlanContext& context, const Arguments& arguments)
{
    const ImageDesc& image = context.input("image");
    std::vector<int> rgb = image.colour();
    if (rgb.size() < 3)
        throw NodeError("needs three colour channels; the image has " + join_names(image.channels));
    rgb.resize(3);
    const float scale = arguments.real("scale");
    if (scale == 1.0f) context.note("scale 1 leaves colours as they are but for rounding");
    context.output("image", image);
    return on_channels(context, rgb, [scale](ImageBuf& out, const ImageBuf& in, const ROI& roi) {
        return OIIO::ImageBufAlgo::saturate(out, in, scale, 0, roi, 1);
    });
}

Compute plan_contrast(PlanContext& context, const Arguments& arguments)
{
    const int n = context.input("image").channel_count();
    const auto values = [&](const char* name) {
        return per_channel(arguments.reals(name), n, name);
    };
    return on_pixels(
        context, [black = values("black"), white = values("white"), lo = values("min"),
                  hi = values("max"), slope = values("scontrast"),
                  middle = values("sthresh")](ImageBuf& out, const ImageBuf& in, const ROI& roi) {
            return OIIO::ImageBufAlgo::contrast_remap(out, in, black, white, lo, hi, slope, middle,
                                                      roi, 1);
        });
}

Compute plan_color_map(PlanContext& context, const Arguments& arguments)
{
    const ImageDesc image = context.input("image");
    const std::string& channel = arguments.text("channel");
    const int source = channel.empty() ? -1 : image.channel(channel);
    if (!channel.empty() && source < 0)
        throw NodeError("'channel': there is no channel '" + channel + "'" +
                        suggestion(channel, image.channels));
    const ImageDesc result = image.with_channels({"R", "G", "B"});
    context.output("image", result);
    const std::string map = arguments.text("map");
    return on_imagebuf(context, image, result, std::identity(),
                       [source, map](ImageBuf& out, const ImageBuf& in, const ROI& roi) {
                           return OIIO::ImageBufAlgo::color_map(out, in, source, map, roi, 1);
                       });
}

auto range(bool (*function)(ImageBuf&, const ImageBuf&, bool, ROI, int))
{
    return [function](PlanContext& context, const Arguments& arguments) -> Compute {
        const bool luma = arguments.flag("luma");
        return on_pixels(context,
                         [function, luma](ImageBuf& out, const ImageBuf& in, const ROI& roi) {
                             return function(out, in, luma, roi, 1);
                         });
    };
}

Compute plan_fixnan(PlanContext& context, const Arguments& arguments)
{
    const ImageDesc& image = context.input("image");
    const auto n = static_cast<std::size_t>(image.channel_count());
    const float most = std::numeric_limits<float>::max();
    RepairRule rule;
    rule.repair = arguments.text("mode") == "black" ? Repair::black : Repair::neighbours;
    rule.lowest.assign(n, -most);
    rule.highest.assign(n, most);
    context.output("image", image);
    if (rule.repair == Repair::neighbours) context.needs("image", Halo::all(1));
    return [rule](const TileContext& tile) {
        const RepairCounts counts = repair_pixels(tile.input("image"), rule, tile.output("image"));
        if (counts.not_finite > 0) tile.count("NaN pixels repaired", counts.not_finite);
    };
}

ParamInfo config_param(bool needed)
{
    return path_param("config",
                      needed ? "path of the OpenColorIO configuration"
                             : "path of the OpenColorIO configuration; empty: OpenImageIO's own "
                               "spaces linear, sRGB and Rec709 ($OCIO is never read)");
}

ParamInfo unpremult_param()
{
    return flag_param("unpremult", false,
                      "divides by alpha before the transform and multiplies after it");
}

const char* const colour_channels_doc =
    "Applies to R, G, B (and alpha, which transforms leave alone); other channels are passed on "
    "bit for bit. An image without R, G, B has its first three channels transformed.";

} // namespace

std::vector<Operation> colour_operations()
{
    const std::string same = "The same bits as oiiotool on float images.";
    std::vector<Operation> table;
    table.push_back({"colorconvert",
                     "--colorconvert",
                     "Converts between colour spaces.",
                     colour_channels_doc,
                     same,
                     {image_port("image", "any image")},
                     {required(text_param("from", "linear", "colour space of the input")),
                      required(text_param("to", "sRGB", "colour space of the result")),
                      config_param(false), unpremult_param()},
                     "image: image, from: linear, to: sRGB",
                     plan_colorconvert});
    table.push_back(
        {"ociodisplay",
         "--ociodisplay",
         "Makes the picture a display shows.",
         colour_channels_doc,
         same,
         {image_port("image", "any image")},
         {required(config_param(true)),
          text_param("display", "", "display; empty: the configuration's default"),
          text_param("view", "", "view of the display; empty: its default"),
          text_param("from", "scene_linear", "colour space or role of the input"),
          text_param("looks", "", "looks to apply instead of the view's own"), unpremult_param()},
         "image: image, config: config.ocio",
         plan_display});
    table.push_back({"ociolook",
                     "--ociolook",
                     "Applies looks.",
                     colour_channels_doc,
                     same,
                     {image_port("image", "any image")},
                     {required(config_param(true)),
                      required(text_param("looks", "", "look, or several separated by commas")),
                      text_param("from", "scene_linear", "colour space or role of the input"),
                      text_param("to", "", "colour space of the result; empty: as the input"),
                      flag_param("inverse", false, "undoes the looks"), unpremult_param()},
                     "image: image, config: config.ocio, looks: warm",
                     plan_look});
    table.push_back({"ociofiletransform",
                     "--ociofiletransform",
                     "Applies a lookup table or transform from a file.",
                     colour_channels_doc,
                     same,
                     {image_port("image", "any image")},
                     {required(config_param(true)),
                      required(text_param("file", "",
                                          "file, found on the configuration's search "
                                          "path")),
                      flag_param("inverse", false, "applies the inverse"), unpremult_param()},
                     "image: image, config: config.ocio, file: grade.cube",
                     plan_file_transform});
    table.push_back({"saturate",
                     "--saturate",
                     "Scales the saturation of the colour.",
                     "Luminance is kept. R, G, B; other channels are passed on bit for bit.",
                     same,
                     {image_port("image", "an image with three colour channels")},
                     {required(real_param("scale", 1.0, "1", "0 makes grey, 1 changes nothing"))},
                     "image: image, scale: 0.5",
                     plan_saturate});
    table.push_back(
        {"contrast",
         "--contrast",
         "Remaps a range of values, with an S-shaped curve on request.",
         "black becomes min and white max. Applies to every channel it is given numbers for; one "
         "number stands for all, alpha too.",
         same,
         {image_port("image", "any image")},
         {reals_param("black", {0.0}, "value that becomes min"),
          reals_param("white", {1.0}, "value that becomes max"),
          reals_param("min", {0.0}, "result for black"),
          reals_param("max", {1.0}, "result for white"),
          reals_param("scontrast", {1.0}, "slope of the S curve; 1: none"),
          reals_param("sthresh", {0.5}, "where the S curve is steepest")},
         "image: image, black: 0.1, white: 0.75",
         plan_contrast});
    table.push_back(
        {"color_map",
         "--colormap",
         "Shows luminance or a channel in false colours.",
         "The result has the channels R, G, B.",
         same,
         {image_port("image", "any image")},
         {choice_param(
              "map", "viridis",
              {"viridis", "inferno", "magma", "plasma", "turbo", "blue-red", "spectrum", "heat"},
              "colours for 0 … 1"),
          text_param("channel", "",
                     "channel to show; empty: the luminance of the first three, or the first of "
                     "fewer")},
         "image: image, map: viridis",
         plan_color_map});
    const auto range_entry = [&](const char* name, const char* summary, auto function) {
        return Operation{name,
                         std::string("--") + name,
                         summary,
                         "A logarithmic curve above 0.18 that makes resampling of high dynamic "
                         "range ring less. Alpha is left alone.",
                         same,
                         {image_port("image", "any image")},
                         {flag_param("luma", false, "scales by luminance, which keeps hues")},
                         "image: image",
                         range(function)};
    };
    table.push_back(range_entry("rangecompress", "Compresses high values by a logarithm.",
                                static_cast<bool (*)(ImageBuf&, const ImageBuf&, bool, ROI, int)>(
                                    &OIIO::ImageBufAlgo::rangecompress)));
    table.push_back(range_entry("rangeexpand", "Undoes oiio.rangecompress.",
                                static_cast<bool (*)(ImageBuf&, const ImageBuf&, bool, ROI, int)>(
                                    &OIIO::ImageBufAlgo::rangeexpand)));
    table.back().example =
        "rayloom: 1\nname: rangeexpand\ninputs:\n  image: {doc: any image}\nnodes:\n"
        "  compressed: {op: oiio.rangecompress, image: image}\n"
        "  result: {op: oiio.rangeexpand, image: compressed}\n"
        "outputs:\n  out: result\n";
    table.push_back(
        {"fixnan",
         "--fixnan",
         "Replaces NaN and infinite values.",
         "The mean is that of the finite values of the input: where bad pixels touch, oiiotool "
         "also takes those it has just repaired, which depends on the order. See "
         "threshold.sanitize for wider windows.",
         "Finite values are exact; means are summed in double.",
         {image_port("image", "any image")},
         {choice_param("mode", "box3", {"box3", "black"},
                       "the mean of the finite values in 3×3, or zero")},
         "image: image",
         plan_fixnan});
    return table;
}

} // namespace rayloom::oiio
