// SPDX-License-Identifier: Apache-2.0
/// \file
/// One table of what every node computes: a graph with that node alone, how many operations and
/// bytes a pixel of it takes at the least, and the same written plainly in double from its
/// definition, pixel by pixel. Tests hold the node against the plain version; benchmarks measure
/// both and the share of the machine's limits.
#pragma once

#include "tests/oracle/histogram_fusion.h"

#include <map>
#include <string>
#include <vector>

namespace rayloom::oracle
{

/// Images bound to the inputs of a graph, by name; a list has several.
struct PlainInput {
    std::map<std::string, std::vector<Raster<double>>> bound;

    const Raster<double>& image(const std::string& name) const { return bound.at(name).front(); }
    const std::vector<Raster<double>>& list(const std::string& name) const
    {
        return bound.at(name);
    }
};

/// What the outputs of the graph must be.
struct PlainResult {
    std::map<std::string, std::vector<Raster<double>>> images;
    /// Of a table: numbers of a column, row by row. Columns that are not here are not compared.
    std::map<std::string, std::map<std::string, std::vector<double>>> tables;
};

using PlainNode = PlainResult (*)(const PlainInput&);

/// One node of the table. "A pixel" is one of the first input, with all its channels.
struct NodeWork {
    std::string node;
    std::string graph; ///< inputs, nodes and outputs as YAML; empty: the example of the node's page
    double flops;      ///< floating-point operations a pixel of any implementation
    double bytes;      ///< bytes a pixel that must come from memory or go there
    std::string count; ///< how both were counted
    /// Null where a benchmark of its own has the pair (node/plain_CASE), and for the functions of
    /// OpenImageIO, which are held against oiiotool.
    PlainNode plain = nullptr;
    double tolerance = 2e-6; ///< of the largest value of the channel
};

/// Every node that comes with rayloom and computes pixels or figures (not io.*).
const std::vector<NodeWork>& node_work();

/// The graph of an entry as text.
std::string graph_text(const NodeWork& work);

// The plain versions, by file: plain_fit.cpp, plain_fuse.cpp, plain_measure.cpp,
// plain_multiscale.cpp, plain_threshold.cpp, plain_transform.cpp.
PlainResult plain_flash_intensity(const PlainInput&);
PlainResult plain_fit_laplacian(const PlainInput&);
PlainResult plain_fit_noise(const PlainInput&);
PlainResult plain_fit_noise_map(const PlainInput&);
PlainResult plain_scale_band(const PlainInput&);
PlainResult plain_band_fit(const PlainInput&);
PlainResult plain_sum(const PlainInput&);
PlainResult plain_residual(const PlainInput&);
PlainResult plain_bound(const PlainInput&);
PlainResult plain_channels(const PlainInput&);
PlainResult plain_coverage(const PlainInput&);
PlainResult plain_error(const PlainInput&);
PlainResult plain_pyramid(const PlainInput&);
PlainResult plain_recombine(const PlainInput&);
PlainResult plain_steerable(const PlainInput&);
PlainResult plain_steerable_inverse(const PlainInput&);
PlainResult plain_boundary(const PlainInput&);
PlainResult plain_interval(const PlainInput&);
PlainResult plain_sanitize(const PlainInput&);
PlainResult plain_outlier(const PlainInput&);
PlainResult plain_demodulate(const PlainInput&);
PlainResult plain_exp(const PlainInput&);
PlainResult plain_flash(const PlainInput&);
PlainResult plain_half_buffers(const PlainInput&);
PlainResult plain_halves(const PlainInput&);
PlainResult plain_histogram(const PlainInput&);
PlainResult plain_layer(const PlainInput&);
PlainResult plain_layers(const PlainInput&);
PlainResult plain_lobes(const PlainInput&);
PlainResult plain_local_variance(const PlainInput&);
PlainResult plain_log(const PlainInput&);
PlainResult plain_merge_layers(const PlainInput&);
PlainResult plain_merge_lobes(const PlainInput&);
PlainResult plain_modulate(const PlainInput&);
PlainResult plain_parts(const PlainInput&);
PlainResult plain_pass(const PlainInput&);
PlainResult plain_remainder(const PlainInput&);
PlainResult plain_restore_mean(const PlainInput&);
PlainResult plain_sequence(const PlainInput&);
PlainResult plain_statistics(const PlainInput&);

/// A raster of the size of another, value by value: value(channel, x, y).
template <class Value>
Raster<double> make_raster(const Raster<double>& like, int channels, const Value& value)
{
    Raster<double> out(like.width, like.height, channels);
    for (int c = 0; c < channels; ++c)
        for (int y = 0; y < like.height; ++y)
            for (int x = 0; x < like.width; ++x) out.at(c, x, y) = value(c, x, y);
    return out;
}

/// Mirrored beyond the ends: … 1 0 | 0 1 2 … n−1 | n−1 n−2 …
int mirrored_index(int i, int n);

} // namespace rayloom::oracle
