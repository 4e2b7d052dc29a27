// SPDX-License-Identifier: Apache-2.0
/// \file
/// Choosing, naming and joining channels.
#include "nodes/oiio/operation.h"
#include "nodes/transform/channel_picks.h"

#include <cstring>
#include <numeric>

namespace rayloom::oiio
{
namespace
{

Compute plan_channels(PlanContext& context, const Arguments& arguments)
{
    const ImageDesc& image = context.input("image");
    std::vector<int> indices(image.channels.size());
    std::iota(indices.begin(), indices.end(), 0);
    const auto picks = parse_channel_picks(arguments.texts("channels"), image.channels, indices);
    bool same = pick_names(picks) == image.channels;
    for (std::size_t i = 0; i < picks.size(); ++i)
        same = same && picks[i].source == static_cast<int>(i);
    context.output("image", image.with_channels(pick_names(picks)));
    if (same)
        context.pass_through("image", "image");
    else
        declare_picks(context, "image", 0, picks);
    return [picks](const TileContext& tile) {
        copy_picks(tile.input("image"), picks, tile.output("image"));
    };
}

Compute plan_append(PlanContext& context, const Arguments& arguments)
{
    ImageDesc result = context.input("image");
    const ImageDesc& other = context.input("other");
    const int first = result.channel_count(), second = other.channel_count();
    const std::string& prefix = arguments.text("prefix");
    for (const std::string& channel : other.channels) {
        const std::string name = prefix.empty() ? channel : prefix + "." + channel;
        if (result.channel(name) >= 0)
            throw NodeError("both images have a channel '" + name +
                            "'; name the layer of the second one with 'prefix', or rename its "
                            "channels with oiio.channels");
        result.channels.push_back(name);
    }
    result.data = result.data.hull(other.data);
    result.display = result.display.hull(other.display);
    if (context.input("image").data == result.data)
        for (int c = 0; c < first; ++c) context.pass_channel("image", c, "image", c);
    if (other.data == result.data)
        for (int c = 0; c < second; ++c) context.pass_channel("image", first + c, "other", c);
    context.output("image", std::move(result));
    return [first, second](const TileContext& tile) {
        const Region& region = tile.region();
        const ImageView out = tile.output("image");
        Rows a(tile.input("image"), region), b(tile.input("other"), region);
        for (int y = region.y0; y < region.y1; ++y)
            for (int c = 0; c < first + second; ++c)
                std::memcpy(out.row(c, y), c < first ? a.row(c, y) : b.row(c - first, y),
                            static_cast<std::size_t>(region.width()) * sizeof(float));
    };
}

} // namespace

std::vector<Operation> channel_operations()
{
    std::vector<Operation> table;
    table.push_back({"channels",
                     "--ch",
                     "Selects, orders, renames and adds channels.",
                     "`channels: [R, G, B, A=1]` keeps three channels and adds an opaque alpha; "
                     "`[Y=G]` takes G and calls it Y. What is selected is passed on bit for bit.",
                     "Exact.",
                     {image_port("image", "any image")},
                     {required(texts_param("channels", {"R", "G", "B"},
                                           "channels of the result: R, NEW=R to rename, A=1 for a "
                                           "constant"))},
                     "image: image, channels: [R, G, B, A=1]",
                     plan_channels});
    table.push_back({"channel_append",
                     "--chappend",
                     "Joins the channels of two images in one.",
                     "The result covers both data windows; outside its own an image is zero.",
                     "Exact.",
                     {image_port("image", "gives the first channels"),
                      image_port("other", "gives the channels that follow")},
                     {text_param("prefix", "",
                                 "layer name put before the second image's channels (albedo makes "
                                 "albedo.R of R)")},
                     "image: image, other: other, prefix: albedo",
                     plan_append});
    return table;
}

} // namespace rayloom::oiio
