// SPDX-License-Identifier: Apache-2.0
/// \file
/// Entries that move pixels and change none: planar copies.
#include "nodes/oiio/operation.h"

#include <algorithm>
#include <cstring>

namespace rayloom::oiio
{
namespace
{

Region window_of(const Arguments& arguments)
{
    const int x = arguments.integer("x"), y = arguments.integer("y");
    return {x, y, x + arguments.integer("width"), y + arguments.integer("height")};
}

Compute plan_crop(PlanContext& context, const Arguments& arguments)
{
    ImageDesc result = context.input("image");
    const Region window = window_of(arguments);
    if (window == result.data) context.pass_through("image", "image");
    if (window.intersect(result.data).empty())
        context.note("the crop window " + window.text() + " lies outside the image (" +
                     result.data.text() + "): the result is black");
    result.data = window;
    const int channels = result.channel_count();
    context.output("image", std::move(result));
    return [channels](const TileContext& tile) {
        const Region& region = tile.region();
        const ImageView out = tile.output("image");
        Rows in(tile.input("image"), region);
        for (int y = region.y0; y < region.y1; ++y)
            for (int c = 0; c < channels; ++c)
                std::memcpy(out.row(c, y), in.row(c, y),
                            static_cast<std::size_t>(region.width()) * sizeof(float));
    };
}

Compute plan_cut(PlanContext& context, const Arguments& arguments)
{
    ImageDesc result = context.input("image");
    const Region window = window_of(arguments);
    if (window.intersect(result.data).empty())
        context.note("the window " + window.text() + " lies outside the image (" +
                     result.data.text() + "): the result is black");
    result.data = result.display = {0, 0, window.width(), window.height()};
    const int channels = result.channel_count(), dx = window.x0, dy = window.y0;
    context.output("image", std::move(result));
    context.needs("image", [dx, dy](const Need& need) { return need.region.shifted(dx, dy); });
    return [channels, dx, dy](const TileContext& tile) {
        const Region& region = tile.region();
        const ImageView out = tile.output("image");
        Rows in(tile.input("image"), region.shifted(dx, dy));
        for (int y = region.y0; y < region.y1; ++y)
            for (int c = 0; c < channels; ++c)
                std::memcpy(out.row(c, y), in.row(c, y + dy),
                            static_cast<std::size_t>(region.width()) * sizeof(float));
    };
}

/// Where a pixel of the result comes from: each source coordinate is a sign times one of the
/// result's coordinates plus an offset; `swap` exchanges the two.
struct Turn {
    bool swap = false;
    int sign_x = 1, sign_y = 1, offset_x = 0, offset_y = 0;

    int source_x(int x, int y) const { return sign_x * (swap ? y : x) + offset_x; }
    int source_y(int x, int y) const { return sign_y * (swap ? x : y) + offset_y; }
    Region source(const Region& r) const
    {
        if (r.empty()) return {};
        const int xa = source_x(r.x0, r.y0), xb = source_x(r.x1 - 1, r.y1 - 1);
        const int ya = source_y(r.x0, r.y0), yb = source_y(r.x1 - 1, r.y1 - 1);
        return {std::min(xa, xb), std::min(ya, yb), std::max(xa, xb) + 1, std::max(ya, yb) + 1};
    }
    /// The pixels of the result that come from `r`.
    Region target(const Region& r) const
    {
        Turn back;
        back.swap = swap;
        back.sign_x = swap ? sign_y : sign_x;
        back.sign_y = swap ? sign_x : sign_y;
        back.offset_x = -back.sign_x * (swap ? offset_y : offset_x);
        back.offset_y = -back.sign_y * (swap ? offset_x : offset_y);
        return back.source(r);
    }
};

void turn_pixels(const ConstImageView& in, const Turn& turn, const ImageView& out)
{
    const Region& region = out.region();
    constexpr int block = 16; // rows and columns at once, so that strided reads hit the cache
    for (int c = 0; c < out.channels(); ++c) {
        if (!turn.swap) {
            for (int y = region.y0; y < region.y1; ++y) {
                const float* from = in.ptr(c, turn.source_x(region.x0, y), turn.source_y(0, y));
                float* to = out.row(c, y);
                if (turn.sign_x > 0)
                    std::memcpy(to, from, static_cast<std::size_t>(region.width()) * sizeof(float));
                else
                    for (int i = 0; i < region.width(); ++i) to[i] = from[-i];
            }
            continue;
        }
        const std::ptrdiff_t step = turn.sign_y * in.row_stride();
        for (int by = region.y0; by < region.y1; by += block)
            for (int bx = region.x0; bx < region.x1; bx += block)
                for (int y = by; y < std::min(by + block, region.y1); ++y) {
                    const int n = std::min(block, region.x1 - bx);
                    const float* from = in.ptr(c, turn.source_x(bx, y), turn.source_y(bx, y));
                    float* to = out.ptr(c, bx, y);
                    for (int i = 0; i < n; ++i) to[i] = from[i * step];
                }
    }
}

/// `make_turn` sees the display window; `display_of` gives the result's.
auto turned(Turn (*make_turn)(const Region&), Region (*display_of)(const Region&))
{
    return [make_turn, display_of](PlanContext& context, const Arguments&) -> Compute {
        ImageDesc result = context.input("image");
        const Turn turn = make_turn(result.display);
        result.data = turn.target(result.data);
        result.display = display_of(result.display);
        context.output("image", std::move(result));
        context.needs("image", [turn](const Need& need) { return turn.source(need.region); });
        return [turn](const TileContext& tile) {
            turn_pixels(tile.input("image"), turn, tile.output("image"));
        };
    };
}

Region same_window(const Region& d) { return d; }
/// Width and height exchanged, the origin kept.
Region turned_window(const Region& d) { return {d.x0, d.y0, d.x0 + d.height(), d.y0 + d.width()}; }
Region transposed_window(const Region& d) { return {d.y0, d.x0, d.y1, d.x1}; }

Operation turn_entry(std::string name, std::string summary, std::string doc,
                     Turn (*turn)(const Region&), Region (*display)(const Region&))
{
    return {name,
            "--" + name,
            std::move(summary),
            std::move(doc),
            "Exact.",
            {image_port("image", "any image")},
            {},
            "image: image",
            turned(turn, display)};
}

std::vector<ParamInfo> window_params(const std::string& what)
{
    constexpr int far = 1 << 24;
    return {integer_param("x", 0, -far, far, "px", "left edge of the " + what),
            integer_param("y", 0, -far, far, "px", "upper edge of the " + what),
            required(integer_param("width", 1, 1, far, "px", "width of the " + what)),
            required(integer_param("height", 1, 1, far, "px", "height of the " + what))};
}

} // namespace

std::vector<Operation> placement_operations()
{
    std::vector<Operation> table;
    table.push_back({"crop",
                     "--crop",
                     "Limits or widens the data window.",
                     "The picture stays in its place and the display window as it is; pixels that "
                     "were not there are zero.",
                     "Exact.",
                     {image_port("image", "any image")},
                     window_params("new data window"),
                     "image: image, x: 16, y: 16, width: 64, height: 64",
                     plan_crop});
    table.push_back({"cut",
                     "--cut",
                     "Cuts out a rectangle and moves it to the origin.",
                     "Data and display window are then the rectangle.",
                     "Exact.",
                     {image_port("image", "any image")},
                     window_params("rectangle"),
                     "image: image, x: 16, y: 16, width: 64, height: 64",
                     plan_cut});
    table.push_back(turn_entry(
        "flip", "Mirrors top and bottom within the display window.", "",
        [](const Region& d) {
            return Turn{false, 1, -1, 0, d.y0 + d.y1 - 1};
        },
        same_window));
    table.push_back(turn_entry(
        "flop", "Mirrors left and right within the display window.", "",
        [](const Region& d) {
            return Turn{false, -1, 1, d.x0 + d.x1 - 1, 0};
        },
        same_window));
    table.push_back(turn_entry(
        "rotate180", "Turns the image by half a turn within the display window.", "",
        [](const Region& d) {
            return Turn{false, -1, -1, d.x0 + d.x1 - 1, d.y0 + d.y1 - 1};
        },
        same_window));
    const std::string keeps = "The display window exchanges width and height and keeps its origin.";
    table.push_back(turn_entry(
        "rotate90", "Turns the image clockwise by a quarter turn.", keeps,
        [](const Region& d) {
            return Turn{true, 1, -1, d.x0 - d.y0, d.y1 - 1 + d.x0};
        },
        turned_window));
    table.push_back(turn_entry(
        "rotate270", "Turns the image counter-clockwise by a quarter turn.", keeps,
        [](const Region& d) {
            return Turn{true, -1, 1, d.x1 - 1 + d.y0, d.y0 - d.x0};
        },
        turned_window));
    table.push_back(turn_entry(
        "transpose", "Exchanges rows and columns, of the windows too.", "",
        [](const Region&) {
            return Turn{true, 1, 1, 0, 0};
        },
        transposed_window));
    return table;
}

} // namespace rayloom::oiio
