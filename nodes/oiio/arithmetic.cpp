// SPDX-License-Identifier: Apache-2.0
/// \file
/// Arithmetic on pixels: the entries of the table that are planar row kernels. Every kernel does
/// the float operations of OpenImageIO in their order, so its result has the same bits.
#include "nodes/oiio/operation.h"
#include "rayloom/core/text.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>

namespace rayloom::oiio
{
namespace
{

using Constants = std::vector<float>;
using UnaryRow = void (*)(const float* a, float* out, std::size_t n);
using BinaryRow = void (*)(const float* a, const float* b, float* out, std::size_t n);

// The vectorised kernels take no aliased pointers: the engine never hands out an input as output.
template <class F>
inline void for_row(const float* __restrict a, const float* __restrict b, float* __restrict out,
                    std::size_t n, F f)
{
    for (std::size_t i = 0; i < n; ++i) out[i] = f(a[i], b[i]);
}
void add_row(const float* a, const float* b, float* out, std::size_t n)
{
    for_row(a, b, out, n, [](float x, float y) { return x + y; });
}
void sub_row(const float* a, const float* b, float* out, std::size_t n)
{
    for_row(a, b, out, n, [](float x, float y) { return x - y; });
}
void mul_row(const float* a, const float* b, float* out, std::size_t n)
{
    for_row(a, b, out, n, [](float x, float y) { return x * y; });
}
void div_row(const float* a, const float* b, float* out, std::size_t n)
{
    for_row(a, b, out, n, [](float x, float y) {
        const float quotient = x / y; // outside the choice, so that it vectorises
        return y == 0.0f ? 0.0f : quotient;
    });
}
void absdiff_row(const float* a, const float* b, float* out, std::size_t n)
{
    for_row(a, b, out, n, [](float x, float y) { return std::fabs(x - y); });
}
void min_row(const float* a, const float* b, float* out, std::size_t n)
{
    for_row(a, b, out, n, [](float x, float y) { return std::min(x, y); });
}
void max_row(const float* a, const float* b, float* out, std::size_t n)
{
    for_row(a, b, out, n, [](float x, float y) { return std::max(x, y); });
}
void pow_row(const float* a, const float* b, float* out, std::size_t n)
{
    for (std::size_t i = 0; i < n; ++i) out[i] = std::pow(a[i], b[i]);
}
void mad_row(const float* __restrict a, const float* __restrict b, const float* __restrict c,
             float* __restrict out, std::size_t n)
{
    for (std::size_t i = 0; i < n; ++i) out[i] = a[i] * b[i] + c[i];
}
void clamp_row(const float* __restrict a, float lo, float hi, float* __restrict out, std::size_t n)
{
    for (std::size_t i = 0; i < n; ++i) {
        const float raised = lo <= a[i] ? a[i] : lo; // NaN becomes lo
        out[i] = raised > hi ? hi : raised;
    }
}
void over_row(const float* __restrict a, const float* __restrict alpha, const float* __restrict b,
              float* __restrict out, std::size_t n)
{
    for (std::size_t i = 0; i < n; ++i) {
        const float raised = 0.0f <= alpha[i] ? alpha[i] : 0.0f;
        const float clamped = raised > 1.0f ? 1.0f : raised;
        out[i] = a[i] + (1.0f - clamped) * b[i];
    }
}

/// An operand: the image at a port, or constants.
struct Operand {
    std::string port;
    Constants constants;
    bool is_image = false;
    int channels = 0; ///< of a second image; one serves for every channel of the result

    Rows rows(const TileContext& context) const
    {
        return is_image ? Rows(context.input(port), context.region())
                        : Rows(constants, context.region());
    }
    int channel(int c) const { return is_image && channels == 1 ? 0 : c; }
};

/// The second operand of a node: an image at `port`, or numbers in `param`; exactly one of them.
Operand second_operand(PlanContext& context, const Arguments& arguments, std::string_view port,
                       std::string_view param, ImageDesc& result)
{
    Operand operand;
    operand.port = port;
    const std::vector<float> values = arguments.reals(param);
    if (context.has(port) != values.empty())
        throw NodeError("give either the image '" + std::string(port) + "' or numbers in '" +
                        std::string(param) + "'" +
                        (values.empty() ? "; there is neither" : ", not both"));
    if (!context.has(port)) {
        operand.constants = per_channel(values, result.channel_count(), param);
        return operand;
    }
    const ImageDesc& other = context.input(port);
    operand.is_image = true;
    operand.channels = other.channel_count();
    if (operand.channels != 1 && operand.channels != result.channel_count())
        throw NodeError("'" + std::string(port) + "' has " + std::to_string(operand.channels) +
                        " channels (" + join_names(other.channels) + ") and 'image' has " +
                        std::to_string(result.channel_count()) + " (" +
                        join_names(result.channels) + "); they must have as many, or '" +
                        std::string(port) +
                        "' one for all (oiio.channels picks and orders channels)");
    result.data = result.data.hull(other.data);
    result.display = result.display.hull(other.display);
    return operand;
}

/// The image at the port `image`.
Operand first_operand()
{
    Operand operand;
    operand.port = "image";
    operand.is_image = true;
    return operand;
}

bool all_are(const Operand& operand, float value)
{
    return !operand.is_image && std::all_of(operand.constants.begin(), operand.constants.end(),
                                            [&](float v) { return v == value; });
}

/// image ∘ other, or image ∘ value. `neutral`: the constant that changes no bit of the image.
auto binary(BinaryRow row, std::optional<float> neutral)
{
    return [row, neutral](PlanContext& context, const Arguments& arguments) -> Compute {
        ImageDesc result = context.input("image");
        const Operand a = first_operand();
        Operand b = second_operand(context, arguments, "other", "value", result);
        if (neutral && all_are(b, *neutral)) context.pass_through("image", "image");
        BinaryRow chosen = row;
        if (row == &div_row && !b.is_image) {
            // OpenImageIO multiplies by the reciprocal of a constant.
            for (float& v : b.constants) v = v == 0.0f ? 0.0f : 1.0f / v;
            chosen = &mul_row;
        }
        const int channels = result.channel_count();
        context.output("image", std::move(result));
        return [chosen, a, b, channels](const TileContext& tile) {
            const Region& region = tile.region();
            const ImageView out = tile.output("image");
            Rows left = a.rows(tile), right = b.rows(tile);
            for (int y = region.y0; y < region.y1; ++y)
                for (int c = 0; c < channels; ++c)
                    chosen(left.row(c, y), right.row(b.channel(c), y), out.row(c, y),
                           static_cast<std::size_t>(region.width()));
        };
    };
}

/// Every channel by itself, with a row kernel that knows the channel.
template <class MakeRow>
auto unary(MakeRow make_row)
{
    return [make_row](PlanContext& context, const Arguments& arguments) -> Compute {
        const ImageDesc image = context.input("image");
        context.output("image", image);
        const auto row = make_row(context, arguments, image);
        const int channels = image.channel_count();
        return [row, channels](const TileContext& tile) {
            const Region& region = tile.region();
            const ConstImageView in = tile.input("image");
            const ImageView out = tile.output("image");
            for (int y = region.y0; y < region.y1; ++y)
                for (int c = 0; c < channels; ++c)
                    row(c, in.ptr(c, region.x0, y), out.row(c, y),
                        static_cast<std::size_t>(region.width()));
        };
    };
}

Compute plan_mad(PlanContext& context, const Arguments& arguments)
{
    ImageDesc result = context.input("image");
    const Operand a = first_operand();
    const Operand b = second_operand(context, arguments, "multiplier", "scale", result);
    const Operand c = second_operand(context, arguments, "addend", "offset", result);
    const int channels = result.channel_count();
    context.output("image", std::move(result));
    return [a, b, c, channels](const TileContext& tile) {
        const Region& region = tile.region();
        const ImageView out = tile.output("image");
        Rows rows_a = a.rows(tile), rows_b = b.rows(tile), rows_c = c.rows(tile);
        for (int y = region.y0; y < region.y1; ++y)
            for (int k = 0; k < channels; ++k)
                mad_row(rows_a.row(k, y), rows_b.row(b.channel(k), y), rows_c.row(c.channel(k), y),
                        out.row(k, y), static_cast<std::size_t>(region.width()));
    };
}

Compute plan_over(PlanContext& context, const Arguments&)
{
    ImageDesc result = context.input("image");
    const ImageDesc& under = context.input("under");
    for (const char* port : {"image", "under"})
        if (context.input(port).alpha() < 0)
            throw NodeError("'" + std::string(port) + "' has no alpha channel (it has " +
                            join_names(context.input(port).channels) +
                            "); oiio.channels can add one: channels: [R, G, B, A=1]");
    if (result.channels != under.channels)
        throw NodeError("'image' has the channels " + join_names(result.channels) +
                        " and 'under' " + join_names(under.channels) +
                        "; they must be the same in the same order (use oiio.channels)");
    result.data = result.data.hull(under.data);
    result.display = result.display.hull(under.display);
    const int channels = result.channel_count(), alpha = result.alpha(),
              depth = result.channel("Z");
    context.output("image", std::move(result));
    return [channels, alpha, depth](const TileContext& tile) {
        const Region& region = tile.region();
        const ImageView out = tile.output("image");
        const auto n = static_cast<std::size_t>(region.width());
        Rows front(tile.input("image"), region), front_alpha(tile.input("image"), region),
            back(tile.input("under"), region);
        for (int y = region.y0; y < region.y1; ++y) {
            const float* cover = front_alpha.row(alpha, y);
            for (int c = 0; c < channels; ++c) {
                const float *a = front.row(c, y), *b = back.row(c, y);
                float* r = out.row(c, y);
                if (c == depth)
                    for (std::size_t i = 0; i < n; ++i) r[i] = cover[i] > 0.0f ? a[i] : b[i];
                else
                    over_row(a, cover, b, r, n);
            }
        }
    };
}

enum class Alpha { multiply, multiply_all, divide };

/// Colour times or divided by alpha; alpha itself and depth stay.
auto with_alpha(Alpha mode)
{
    return [mode](PlanContext& context, const Arguments&) -> Compute {
        const ImageDesc image = context.input("image");
        const int channels = image.channel_count(), alpha = image.alpha(),
                  depth = image.channel("Z");
        context.output("image", image);
        if (alpha < 0) {
            context.note("no alpha channel: the image is unchanged");
            context.pass_through("image", "image");
        } else {
            context.pass_channel("image", alpha, "image", alpha);
            if (depth >= 0) context.pass_channel("image", depth, "image", depth);
        }
        return [mode, channels, alpha, depth](const TileContext& tile) {
            const Region& region = tile.region();
            const ConstImageView in = tile.input("image");
            const ImageView out = tile.output("image");
            const auto n = static_cast<std::size_t>(region.width());
            for (int y = region.y0; y < region.y1; ++y)
                for (int c = 0; c < channels; ++c) {
                    const float* __restrict s = in.ptr(c, region.x0, y);
                    float* __restrict r = out.row(c, y);
                    if (alpha < 0 || c == alpha || c == depth) {
                        std::memcpy(r, s, n * sizeof(float));
                        continue;
                    }
                    const float* __restrict a = in.ptr(alpha, region.x0, y);
                    if (mode == Alpha::multiply) {
                        for (std::size_t i = 0; i < n; ++i) r[i] = s[i] * a[i];
                    } else if (mode == Alpha::multiply_all) {
                        for (std::size_t i = 0; i < n; ++i) {
                            const float product = s[i] * a[i];
                            r[i] = a[i] == 0.0f ? s[i] : product;
                        }
                    } else {
                        for (std::size_t i = 0; i < n; ++i) {
                            const float quotient = s[i] / a[i];
                            r[i] = a[i] == 0.0f ? s[i] : quotient;
                        }
                    }
                }
        };
    };
}

const char* const same_bits = "The same bits as oiiotool on float images.";

Operation binary_entry(std::string name, std::string command, std::string summary, std::string doc,
                       std::string example, BinaryRow row, std::optional<float> neutral)
{
    return {std::move(name),
            std::move(command),
            std::move(summary),
            doc + (doc.empty() ? "" : " ") +
                "The result covers both data windows; outside its own an image is zero.",
            same_bits,
            {image_port("image", "first operand"),
             optional_port("other", "second operand, with as many channels or one for all")},
            {reals_param("value", {},
                         "constant second operand, one number for all channels or one for each")},
            std::move(example),
            binary(row, neutral)};
}

} // namespace

std::vector<Operation> arithmetic_operations()
{
    std::vector<Operation> table = {
        binary_entry("add", "--add, --addc", "Adds two images, or a constant to an image.", "",
                     "image: image, other: other", add_row, std::nullopt),
        binary_entry("sub", "--sub, --subc", "Subtracts an image or a constant from an image.", "",
                     "image: image, other: other", sub_row, 0.0f),
        binary_entry("mul", "--mul, --mulc", "Multiplies an image by an image or a constant.", "",
                     "image: image, value: 2", mul_row, 1.0f),
        binary_entry("div", "--div, --divc", "Divides an image by an image or a constant.",
                     "Anything divided by zero is zero. A constant divides by multiplying with its "
                     "reciprocal.",
                     "image: image, other: other", div_row, 1.0f),
        binary_entry("absdiff", "--absdiff, --absdiffc",
                     "Absolute difference of an image and an image or a constant.", "",
                     "image: image, other: other", absdiff_row, std::nullopt),
        binary_entry("min", "--min, --minc", "The smaller of an image and an image or a constant.",
                     "", "image: image, value: 1", min_row, std::nullopt),
        binary_entry("max", "--max, --maxc", "The larger of an image and an image or a constant.",
                     "", "image: image, value: 0", max_row, std::nullopt),
    };
    table.push_back(
        {"mad",
         "--mad",
         "Multiplies an image by an image or a constant and adds another.",
         "image · multiplier + addend, rounded after each step. The result covers all data "
         "windows; outside its own an image is zero.",
         same_bits,
         {image_port("image", "first factor"),
          optional_port("multiplier", "second factor, with as many channels or one for all"),
          optional_port("addend", "what is added, with as many channels or one for all")},
         {reals_param("scale", {}, "constant second factor, for all channels or one for each"),
          reals_param("offset", {}, "constant that is added, for all channels or one for each")},
         "image: image, scale: 2, offset: 0.1",
         plan_mad});
    table.push_back(
        {"pow",
         "--powc",
         "Raises an image to a constant power.",
         "A negative number raised to a broken power is NaN.",
         same_bits,
         {image_port("image", "the base")},
         {required(reals_param("value", {1.0}, "exponent, for all channels or one for each"))},
         "image: image, value: 0.5",
         [](PlanContext& context, const Arguments& arguments) {
             ImageDesc result = context.input("image");
             Operand b;
             b.constants = per_channel(arguments.reals("value"), result.channel_count(), "value");
             if (all_are(b, 1.0f)) context.pass_through("image", "image");
             const int channels = result.channel_count();
             context.output("image", std::move(result));
             return Compute([b, channels](const TileContext& tile) {
                 const Region& region = tile.region();
                 Rows base(tile.input("image"), region), exponent = b.rows(tile);
                 const ImageView out = tile.output("image");
                 for (int y = region.y0; y < region.y1; ++y)
                     for (int c = 0; c < channels; ++c)
                         pow_row(base.row(c, y), exponent.row(c, y), out.row(c, y),
                                 static_cast<std::size_t>(region.width()));
             });
         }});
    table.push_back({"abs",
                     "--abs",
                     "Absolute value of every channel.",
                     "",
                     same_bits,
                     {image_port("image", "any image")},
                     {},
                     "image: image",
                     unary([](PlanContext&, const Arguments&, const ImageDesc&) {
                         return [](int, const float* __restrict in, float* __restrict out,
                                   std::size_t n) {
                             for (std::size_t i = 0; i < n; ++i) out[i] = std::fabs(in[i] - 0.0f);
                         };
                     })});
    table.push_back({"invert",
                     "--invert",
                     "Subtracts the colour channels from one.",
                     "The first three channels; alpha and what follows stay as they are.",
                     same_bits,
                     {image_port("image", "any image")},
                     {},
                     "image: image",
                     unary([](PlanContext& context, const Arguments&, const ImageDesc& image) {
                         for (int c = 3; c < image.channel_count(); ++c)
                             context.pass_channel("image", c, "image", c);
                         return [](int c, const float* __restrict in, float* __restrict out,
                                   std::size_t n) {
                             if (c >= 3)
                                 std::memcpy(out, in, n * sizeof(float));
                             else
                                 for (std::size_t i = 0; i < n; ++i) out[i] = 1.0f - in[i];
                         };
                     })});
    table.push_back(
        {"clamp",
         "--clamp",
         "Limits every channel to a range.",
         "NaN becomes the lower bound. Without bounds nothing is limited but NaN and infinities.",
         same_bits,
         {image_port("image", "any image")},
         {reals_param("min", {}, "lower bound, for all channels or one for each"),
          reals_param("max", {}, "upper bound, for all channels or one for each"),
          flag_param("clampalpha", false, "limits alpha to 0 … 1 whatever the bounds are")},
         "image: image, min: 0",
         unary([](PlanContext&, const Arguments& arguments, const ImageDesc& image) {
             const float big = std::numeric_limits<float>::max();
             const int n_channels = image.channel_count();
             auto bound = [&](const char* name, float absent) {
                 std::vector<float> v = arguments.reals(name);
                 if (v.empty()) v.push_back(absent);
                 return per_channel(v, n_channels, name);
             };
             const auto lo = bound("min", -big), hi = bound("max", big);
             for (std::size_t c = 0; c < lo.size(); ++c)
                 if (lo[c] > hi[c])
                     throw NodeError("'min' (" + std::to_string(lo[c]) + ") is above 'max' (" +
                                     std::to_string(hi[c]) + ")");
             const int alpha = arguments.flag("clampalpha") ? image.alpha() : -1;
             return [lo, hi, alpha](int c, const float* in, float* out, std::size_t n) {
                 const auto k = static_cast<std::size_t>(c);
                 clamp_row(in, lo[k], hi[k], out, n);
                 if (c != alpha) return;
                 for (std::size_t i = 0; i < n; ++i) {
                     const float raised = 0.0f <= out[i] ? out[i] : 0.0f;
                     out[i] = raised > 1.0f ? 1.0f : raised;
                 }
             };
         })});
    table.push_back({"over",
                     "--over",
                     "Composites an image over another (Porter and Duff).",
                     "Colours are premultiplied by alpha. Alpha counts as 0 … 1; depth (Z) comes "
                     "from the upper image where that covers anything. The result covers both "
                     "data windows.",
                     same_bits,
                     {image_port("image", "upper image, with alpha"),
                      image_port("under", "lower image, with the same channels")},
                     {},
                     "image: image, under: under",
                     plan_over});
    table.push_back({"premult",
                     "--premult",
                     "Multiplies colour by alpha.",
                     "",
                     same_bits,
                     {image_port("image", "image with straight alpha")},
                     {},
                     "image: image",
                     with_alpha(Alpha::multiply)});
    table.push_back({"repremult",
                     "--repremult",
                     "Multiplies colour by alpha except where alpha is zero.",
                     "Undoes oiio.unpremult: colour on pixels that cover nothing (a flame) stays.",
                     same_bits,
                     {image_port("image", "image with straight alpha")},
                     {},
                     "image: image",
                     with_alpha(Alpha::multiply_all)});
    table.push_back({"unpremult",
                     "--unpremult",
                     "Divides colour by alpha.",
                     "Colour stays as it is where alpha is zero.",
                     same_bits,
                     {image_port("image", "premultiplied image")},
                     {},
                     "image: image",
                     with_alpha(Alpha::divide)});
    return table;
}

} // namespace rayloom::oiio
