// SPDX-License-Identifier: Apache-2.0
#include "tests/oracle/plain_nodes.h"

#include <cmath>

namespace rayloom::oracle
{

namespace
{

constexpr double value_bytes = 4.0; // float
constexpr double rgb = 3.0 * value_bytes, rgba = 4.0 * value_bytes;

/// "inputs: {…}\nnodes: {…}\noutputs: {…}" of a graph, flow style.
std::string graph(const std::string& inputs, const std::string& nodes, const std::string& outputs)
{
    return "inputs: {" + inputs + "}\nnodes: {" + nodes + "}\noutputs: {" + outputs + "}\n";
}

/// Inputs of three channels.
std::string colours(std::initializer_list<const char*> names)
{
    std::string text;
    for (const char* name : names)
        text += (text.empty() ? "" : ", ") + std::string(name) + ": {doc: light, channels: RGB}";
    return text;
}

const char* const render = "render: {doc: all layers of a render}";
const char* const band = "band: {doc: a band of multiscale.steerable, channels: "
                         "\"level1.band1.R,level1.band1.G,level1.band1.B\"}";
const char* const stack = "stack: {doc: renders, kind: list, channels: RGB}";
constexpr double stacked = 5.0; // images of a stack

/// Nodes that fit, fuse and measure.
std::vector<NodeWork> filters()
{
    constexpr double fitted = 3.0 * 4.0;
    return {
        {"fit.flash_intensity",
         graph(colours({"image", "partial", "flash_unit"}),
               "fit: {op: fit.flash_intensity, image: image, partial: partial, flash_unit: "
               "flash_unit}",
               "fit: fit.intensity"),
         9 * 2, 3 * rgb, "9 values weighted and added; three images read", plain_flash_intensity},
        {"fit.laplacian", graph(band, "fit: {op: fit.laplacian, band: band}", "fit: fit.figures"),
         fitted, rgb, "of each value its square, that squared, and two sums; a band read",
         plain_fit_laplacian, 1e-5},
        {"fit.noise",
         graph("band: {doc: the high-pass, channels: \"high.R,high.G,high.B\"}",
               "noise: {op: fit.noise, band: band}", "noise: noise.figures"),
         fitted, rgb, "moments as in fit.laplacian; the high-pass read", plain_fit_noise, 1e-5},
        {"fit.noise_map",
         graph("band: {doc: the high-pass, channels: \"high.R,high.G,high.B\"}",
               "map: {op: fit.noise_map, band: band}", "map: map"),
         3 * 5 + 4 * 2 * 7 + 4, rgb + value_bytes,
         "of each value its size, root, share and sum, and the sum of roots before (5); four "
         "separable splines of five taps (7 a row); ratio, square and bounds; the high-pass read "
         "twice, since it wants its mean, and the map written",
         plain_fit_noise_map, 1e-5},
        {"fit.plane", "", 25 * (50 + 15 + 5), rgb + rgb + rgb + value_bytes * (2 + 5 * 3 * 3),
         "no less than 5×5 pixels of: weight of equation 10 (20), sums of w, wx, wy, wxx, wxy, wyy "
         "and of z, xz, yz of three colours (30), weight of normals (15), quadrants (5); light, "
         "variance and normal read, 47 coefficients written"},
        {"fuse.histogram", "", 84 * 60 * 7, value_bytes * (61 + 3 + 3),
         "84 pairs a pixel (13×13 window, each once) of 60 bins: subtract, square, add, divide, "
         "accumulate, two scalings; histogram and image read, image written"},
        {"fuse.nlm", "", 480 * (8 + 2 * 7 + 17 + 14), 3 * rgb,
         "480 pairs a pixel (31×31 window, each once): squared difference 8, separable 5×5 patch "
         "14, weight 17, sums of two pixels 14; image and guide read, image written"},
        {"fuse.planes", "", 25 * (70 + 2 * 5 * 3 * 4), 3 * rgb + value_bytes * (2 + 5 * 3 * 3),
         "planes fitted as in fit.plane, then at each of no less than 25 squares that cover a "
         "pixel five planes of three colours evaluated and weighted; light, variance and normal "
         "read, light written"},
        {"fuse.residual",
         graph(colours({"filtered", "original", "variance"}),
               "kept: {op: fuse.residual, image: filtered, original: original, variance: variance}",
               "image: kept"),
         3 * 5 + 8 + 3 + 10 + 3 * 3, 4 * rgb,
         "of each colour difference, square, sums and clamp (5), two separable 3×3 sums (8), the "
         "share (3) and its separable 5×5 mean (10), mixture (3 a colour); three images read, one "
         "written",
         plain_residual, 1e-5},
        {"fuse.sum",
         graph(colours({"direct", "indirect"}), "sum: {op: fuse.sum, images: [direct, indirect]}",
               "image: sum"),
         3, 3 * rgb, "an addition a value; two images read, one written", plain_sum},
        {"measure.band_fit",
         graph(band,
               "fit: {op: fit.laplacian, band: band}, error: {op: measure.band_fit, band: band, "
               "fit: fit.figures}",
               "error: error.figures"),
         fitted + 3 * 2, 2 * rgb,
         "moments (fit.laplacian), then shift and scale into a bin; the band read twice, since "
         "bins want its deviation",
         plain_band_fit, 1e-5},
        {"measure.bound",
         graph(colours({"low", "high"}), "bound: {op: measure.bound, low: low, high: high}",
               "bound: bound.bound"),
         3, 3 * rgb, "a subtraction a value; two images read, one written", plain_bound},
        {"measure.channels",
         graph(colours({"image"}), "figures: {op: measure.channels, image: image}",
               "figures: figures"),
         3 * 7, rgb, "of each value two comparisons and Welford's update (5); an image read",
         plain_channels},
        {"measure.coverage",
         graph(colours({"low", "high", "reference", "image"}),
               "coverage: {op: measure.coverage, low: low, high: high, reference: reference, "
               "image: image}",
               "figures: coverage.coverage"),
         3 * 8, 4 * rgb,
         "two differences, an absolute value, three comparisons and two counts a value; four "
         "images read",
         plain_coverage},
        {"measure.error",
         graph(colours({"image", "reference"}),
               "error: {op: measure.error, image: image, reference: reference, map: flip}",
               "errors: error.errors, map: error.map"),
         3 * 13 + (5 * 2 * 11 * 2 + 40) + 2 * (2 * (4 * 2 * 21 * 2 + 4 * 2 * 19 * 2) + 150),
         2 * rgb + value_bytes,
         "differences and their sums (39), SSIM: five moments of 11+11 taps (260), FLIP twice (its "
         "mean is wanted before its map): four contrast filters of 21+21 and four feature filters "
         "of 19+19 taps of two images, colours (150); two images read, a map written",
         plain_error, 5e-6},
    };
}

std::vector<NodeWork> scales()
{
    // Level by level: mean of four pixels, separable (3), four differences scaled (8).
    constexpr double analysis = 3 + 7 + 3 * 11;
    constexpr double synthesis = 1 + 3 * (4 * 3 + 4);
    constexpr double bands = 14;
    constexpr double decimate = 7 + 3.5; // 7 taps along x on all rows, along y on a quarter
    return {
        {"multiscale.pyramid",
         graph(colours({"image"}), "levels: {op: multiscale.pyramid, image: image, scales: 2}",
               "levels: levels"),
         3 * decimate, 2 * rgb + rgb / 4,
         "7 taps at every second column of all rows, 7 at every second row of those; image read, "
         "both levels written",
         plain_pyramid},
        {"multiscale.recombine",
         graph(colours({"fine", "other"}),
               "small: {op: multiscale.pyramid, image: other, scales: 2}, whole: {op: "
               "multiscale.recombine, levels: [fine, 'small[1]']}",
               "image: whole"),
         3 * (2 * decimate + 0.25 + 16 * 5 + 20), 3 * rgb,
         "decimation of the level and of the other image that makes the coarse one (multiscale."
         "pyramid), difference, 16 taps of share, product and sum (5), limits of 3×3 and 4×4 "
         "pixels (20); two images read, one written",
         plain_recombine, 1e-5},
        {"multiscale.steerable",
         graph(colours({"image"}), "bands: {op: multiscale.steerable, image: image, levels: 3}",
               "bands: bands"),
         3 * analysis, rgb * (1 + bands),
         "first mean and high-pass (10), a level's mean (3) and four scaled differences (8), three "
         "levels; image read, 14 bands written",
         plain_steerable, 1e-5},
        {"multiscale.steerable_inverse",
         graph(colours({"image"}),
               "bands: {op: multiscale.steerable, image: image, levels: 3}, bent: {op: oiio.abs, "
               "image: bands}, again: {op: multiscale.steerable_inverse, bands: bent}",
               "image: again"),
         3 * (analysis + bands + synthesis), 2 * rgb,
         "analysis (multiscale.steerable), magnitudes of 14 bands, and a level's four adjoint "
         "differences (3 each) and mean (4), three levels; image read and written",
         plain_steerable_inverse, 1e-5},
    };
}

std::vector<NodeWork> thresholds()
{
    return {
        {"threshold.boundary",
         graph(colours({"image"}) + ", depth: {doc: distance, channels: Z}, normal: {doc: surface "
                                    "normal, channels: \"X,Y,Z\"}",
               "edges: {op: threshold.boundary, image: image, depth: depth, normal: normal}",
               "boundary: edges"),
         4 * (3 * 5 + 4 + 8), value_bytes * (1 + 3 + 1),
         "four neighbours: three dot products (15), length and comparisons (4), leap and slopes of "
         "depth (8); depth and normal read, marks written",
         plain_boundary},
        {"threshold.coring",
         graph(band,
               "noise: {op: fit.noise, band: band, noise: given, s: 0.19, p: 1.5}, fit: {op: "
               "fit.laplacian, band: band, noise: noise.figures}, cored: {op: threshold.coring, "
               "band: band, fit: fit.figures}",
               "image: cored.band"),
         3 * (4 + 9), 3 * rgb,
         "moments (fit.laplacian), then position in the table (3) and its cubic (6); the band read "
         "twice, since the table wants its moments, and written"},
        {"threshold.interval",
         graph(colours({"mean", "variance"}) + ", count: {doc: samples, channels: N}",
               "interval: {op: threshold.interval, mean: mean, variance: variance, count: count}",
               "low: interval.low, high: interval.high"),
         3 * 6, 4 * rgb + value_bytes,
         "clamp, division, root, product, two sums a value; mean, variance and count read, both "
         "ends written",
         plain_interval},
        {"threshold.outlier",
         graph(colours({"image", "low"}), "split: {op: threshold.outlier, image: image, low: low}",
               "image: split.image, excess: split.excess"),
         3 * (48 + 4), 4 * rgb,
         "48 neighbours a channel compared, what the fifth of brightest pixels costs more left "
         "out; "
         "image and low read, image and excess written",
         plain_outlier},
        {"threshold.sanitize",
         graph(colours({"image"}), "clean: {op: threshold.sanitize, image: image}", "image: clean"),
         3 * 2, 2 * rgb, "two comparisons a value; image read and written", plain_sanitize},
    };
}

std::vector<NodeWork> transforms()
{
    constexpr double log_flops = 22, exp_flops = 21; // of the polynomials of log_kernel.h
    constexpr double smoothing = 2 * 7;              // [1 4 6 4 1]/16 along x and y
    return {
        {"transform.demodulate",
         graph(colours({"radiance", "albedo"}),
               "light: {op: transform.demodulate, image: radiance, pivot: albedo}",
               "image: light.image, marked: light.marked"),
         3 * (2 + 2), 5 * rgb,
         "a value's comparison and addition to the mean of the pivot, comparison and division; "
         "the pivot read twice, image read, image and marks written",
         plain_demodulate},
        {"transform.exp",
         graph(colours({"image"}),
               "log: {op: transform.log, image: image}, back: {op: transform.exp, image: log.log, "
               "figures: log.figures}",
               "image: back"),
         3 * (2 + log_flops + exp_flops + 2), 3 * rgb,
         "transform.log, polynomial of the exponential (21), difference and clamp; image read "
         "twice, since the logarithm wants its median, and written",
         plain_exp, 2e-6},
        {"transform.flash",
         graph(colours({"partial", "flash_unit"}),
               "flash: {op: transform.flash, partial: partial, flash_unit: flash_unit, "
               "intensity_factor: 3}",
               "image: flash.image"),
         3 * 2, 3 * rgb, "product and sum a value; two images read, one written", plain_flash},
        {"transform.half_buffers",
         graph(colours({"a", "b"}), "halves: {op: transform.half_buffers, a: a, b: b}",
               "mean: halves.mean, variance: halves.variance"),
         3 * (2 + 3 + 8 + 1), 4 * rgb,
         "mean (2), squared half difference (3), separable 5×5 sum (8), its mean; two images read, "
         "two written",
         plain_half_buffers, 1e-5},
        {"transform.halves",
         graph(stack, "halves: {op: transform.halves, stack: stack}",
               "mean: halves.mean, a: halves.a, b: halves.b"),
         3 * (stacked + 3 + 2 + 3), rgb * (stacked + 3),
         "an addition an image, the last one shared (3), mean of both (2), three scalings; five "
         "images read, three written",
         plain_halves},
        {"transform.histogram",
         graph(stack, "histogram: {op: transform.histogram, stack: stack}", "image: histogram"),
         3 * stacked * 11 + stacked, rgb * stacked + value_bytes * 61,
         "a sample's tone curve by table (5), position (2), split (2) and two additions, and the "
         "count; five images read, 61 channels written",
         plain_histogram, 1e-4},
        {"transform.layer",
         graph(render, "diffuse: {op: transform.layer, image: render, layer: DiffDir}",
               "image: diffuse"),
         0, 2 * rgb, "one layer read and written", plain_layer},
        {"transform.layers",
         graph(render, "split: {op: transform.layers, image: render, layers: [DiffDir, DiffInd]}",
               "layers: split"),
         0, 4 * rgb, "two layers read and written", plain_layers},
        {"transform.lobes",
         graph(render,
               "layers: {op: transform.layers, image: render}, lobes: {op: transform.lobes, "
               "render: render, layers: layers, renderer: cycles}",
               "radiance: lobes.radiance"),
         3 * 2, 4 * rgb, "sum and product a value; two light passes and a colour read, one written",
         plain_lobes},
        {"transform.local_variance",
         graph(colours({"image"}), "noise: {op: transform.local_variance, image: image}",
               "image: noise.variance"),
         3 * (6 + 4 + 12 + 1), 2 * rgb,
         "two second differences (6), squares, the smaller, scale (4), separable 7×7 sum (12), its "
         "mean; image read, variance written",
         plain_local_variance, 1e-5},
        {"transform.log",
         graph(colours({"image"}), "log: {op: transform.log, image: image}", "image: log.log"),
         3 * (2 + log_flops), 3 * rgb,
         "clamp, sum, polynomial of the logarithm (22); image read twice, since it wants its "
         "median, and written",
         plain_log},
        {"transform.merge_layers",
         graph(colours({"direct", "indirect"}),
               "merged: {op: transform.merge_layers, layers: [direct, indirect], names: [DiffDir, "
               "DiffInd]}",
               "image: merged"),
         0, 4 * rgb, "two images read and written", plain_merge_layers},
        {"transform.merge_lobes",
         graph(std::string(render) + ", " + colours({"beauty", "lobe"}),
               "layers: {op: transform.layers, image: render}, merged: {op: transform.merge_lobes, "
               "render: render, layers: layers, lobes: [lobe], beauty: beauty, renderer: cycles}",
               "image: merged"),
         3 * (1 + 1 + 2 * 2), rgb * (3 + 2 + 4),
         "division by the colour, sum of both passes, a share and a product for each; three "
         "layers, beauty and lobe read, four layers written",
         plain_merge_lobes, 1e-5},
        {"transform.modulate",
         graph(colours({"light", "albedo"}),
               "back: {op: transform.modulate, image: light, pivot: albedo}", "image: back"),
         3, 3 * rgb, "a product a value; two images read, one written", plain_modulate},
        {"transform.parts",
         graph("ids: {doc: ID passes, channels: \"ViewLayer.IndexOB.X,ViewLayer.IndexMA.X\"}",
               "parts: {op: transform.parts, render: ids, renderer: cycles}", "image: parts"),
         2, value_bytes * 4, "product and sum of two ids; two channels read, two written",
         plain_parts},
        {"transform.pass",
         graph(render,
               "beauty: {op: transform.pass, image: render, role: beauty, renderer: cycles}",
               "image: beauty"),
         0, 2 * rgb, "one layer read and written", plain_pass},
        {"transform.remainder",
         graph(colours({"beauty", "direct"}),
               "rest: {op: transform.remainder, image: beauty, parts: direct}", "image: rest"),
         3 * 5, 3 * rgb,
         "sum, difference, and the comparison that counts what is below (3) a value; two images "
         "read, one written",
         plain_remainder},
        {"transform.restore_mean",
         graph(colours({"image", "reference"}),
               "energy: {op: transform.restore_mean, image: image, reference: reference, scale: 3}",
               "image: energy"),
         3 * (2 * 3 * smoothing + 4), 3 * rgb,
         "K twice, three smoothings of 14 each, and clamp, division, product, sum; two images "
         "read, one written",
         plain_restore_mean, 1e-5},
        {"transform.scale_band",
         graph("band: {doc: the high-pass, channels: \"high.R,high.G,high.B\"}",
               "map: {op: fit.noise_map, band: band}, even: {op: transform.scale_band, band: band, "
               "map: map}",
               "image: even"),
         3, 2 * rgb + value_bytes, "a quotient a value; band and map read, band written",
         plain_scale_band, 1e-5},
        {"transform.sequence",
         graph("before: {doc: frames, kind: list, channels: RGB}, " + colours({"frame"}),
               "frames: {op: transform.sequence, before: before, frame: frame}", "frames: frames"),
         0, 2 * rgb * (stacked + 1), "six images read and written", plain_sequence},
        {"transform.statistics",
         graph(stack, "statistics: {op: transform.statistics, stack: stack}",
               "mean: statistics.mean, variance: statistics.variance"),
         3 * (6 * stacked + 1), rgb * (stacked + 2),
         "Welford's update of a sample (6), one division; five images read, two written",
         plain_statistics},
    };
}

/// The examples of the oiio.* nodes: R, G, B and A.
std::vector<NodeWork> image_operations()
{
    const auto one = [](const char* name, double flops, const char* count) {
        return NodeWork{name, "", flops, 2 * rgba, std::string(count) + "; image read and written"};
    };
    const auto two = [](const char* name, double flops, const char* count) {
        return NodeWork{name, "", flops, 3 * rgba,
                        std::string(count) + "; two images read, one written"};
    };
    constexpr double power = 30; // logarithm, product, exponential
    return {
        one("oiio.abs", 4, "an operation a value"),
        two("oiio.absdiff", 8, "difference and absolute value"),
        two("oiio.add", 4, "an operation a value"),
        one("oiio.blur", 4 * 25 * 2, "5×5 taps, multiplied and added"),
        {"oiio.channel_append", "", 0, 4 * rgba, "two images read and written"},
        {"oiio.channels", "", 0, rgb + rgba, "three channels read, four written"},
        one("oiio.clamp", 4, "a comparison a value"),
        {"oiio.color_map", "", 5 + 2 + 3 * 3, rgb + rgb,
         "luminance (5), position (2), interpolation of three channels; colour read and written"},
        one("oiio.colorconvert", 3 * (power + 3), "a power and three operations a colour"),
        one("oiio.contrast", 4 * 2, "product and sum a value"),
        one("oiio.convolve", 4 * 9 * 2, "3×3 taps, multiplied and added"),
        {"oiio.crop", "", 0, 0, "64×64 pixels whatever the image is"},
        {"oiio.cut", "", 0, 0, "64×64 pixels whatever the image is"},
        one("oiio.dilate", 4 * 8, "8 comparisons a value"),
        two("oiio.div", 4, "an operation a value"),
        one("oiio.erode", 4 * 8, "8 comparisons a value"),
        one("oiio.fixnan", 4, "a comparison a value"),
        one("oiio.flip", 0, "a copy"),
        one("oiio.flop", 0, "a copy"),
        one("oiio.invert", 3, "a difference a colour"),
        one("oiio.mad", 4 * 2, "product and sum a value"),
        one("oiio.max", 4, "a comparison a value"),
        one("oiio.median", 4 * 20, "the 20 comparisons of a sorting network of 9"),
        one("oiio.min", 4, "a comparison a value"),
        one("oiio.mul", 4, "an operation a value"),
        one("oiio.ociodisplay", 3 * (power + 3), "a power and three operations a colour"),
        one("oiio.ociofiletransform", 3 * 4 * 3, "tetrahedral interpolation of a table"),
        one("oiio.ociolook", 3 * 2, "product and sum a colour"),
        two("oiio.over", 1 + 4 * 2, "1 − alpha, product and sum a value"),
        one("oiio.pow", 4 * power, "a power a value"),
        one("oiio.premult", 3, "a product a colour"),
        one("oiio.rangecompress", 3 * 20, "a logarithm a colour"),
        one("oiio.rangeexpand", 3 * 20 * 2, "logarithm and exponential a colour"),
        one("oiio.repremult", 3, "a product a colour"),
        {"oiio.resize", "", 4 * (8 + 4), rgba + rgba / 4,
         "4 taps a column of all rows at half the columns, 4 a row of half of those, multiplied "
         "and added, at the least; image read, a quarter written"},
        one("oiio.rotate", 4 * 36 * 2, "6×6 taps of lanczos3, multiplied and added"),
        one("oiio.rotate180", 0, "a copy"),
        one("oiio.rotate270", 0, "a copy"),
        one("oiio.rotate90", 0, "a copy"),
        one("oiio.saturate", 5 + 3 * 3, "luminance (5), difference, product and sum a colour"),
        two("oiio.sub", 4, "an operation a value"),
        one("oiio.transpose", 0, "a copy"),
        one("oiio.unpremult", 3, "a division a colour"),
        one("oiio.unsharp", 4 * (9 * 2 + 4),
            "3×3 taps, difference, comparison, product and sum a value"),
    };
}

} // namespace

const std::vector<NodeWork>& node_work()
{
    static const std::vector<NodeWork> table = [] {
        std::vector<NodeWork> all;
        for (const auto& part :
             {filters(), scales(), thresholds(), transforms(), image_operations()})
            all.insert(all.end(), part.begin(), part.end());
        return all;
    }();
    return table;
}

std::string graph_text(const NodeWork& work) { return "rayloom: 1\nname: node\n" + work.graph; }

} // namespace rayloom::oracle
