// SPDX-License-Identifier: Apache-2.0
/// \file
/// Input no renderer should hand over and every renderer has: made from plausible input, so that
/// any graph can be given it.
#pragma once

#include "rayloom/engine/request.h"
#include "rayloom/graph/model.h"

#include <functional>
#include <string>
#include <vector>

namespace rayloom::test
{

/// What may be asked of the output of a hostile case.
enum class Demand {
    finite, ///< every pixel finite, or a typed error
    no_nan, ///< squares of the values are no floats: infinity where that is the right value, no NaN
    anything, ///< even sums of two values are no floats: no crash, and the same in every way
    hopeless, ///< NaN alone went in: nothing of it comes out of a graph, or of a node as a figure
    confined ///< NaN or infinity went in: out of a graph nothing of it comes, and a node spreads it
             ///< no further than to the pixels it makes from it
};

struct HostileCase {
    std::string name;
    Demand demand = Demand::finite;
    std::function<RunRequest(const Graph&)> request;
};

/// Every kind of hostile input, on images of about `side` pixels.
std::vector<HostileCase> hostile_cases(int side);

/// Every kind of hostile deep pixels: none, ten thousand, any covering and depth. Graphs without a
/// deep input get plain images.
std::vector<HostileCase> deep_cases(int side);

/// Replaces every image of a request by what `change` makes of a copy of it.
void change_images(
    RunRequest& request,
    const std::function<void(const std::string& input, std::size_t element, MemoryImage&)>& change);

/// Whether a finite pixel or sample of any input is below zero.
bool has_negative_pixels(const RunRequest& request);

/// The smallest box around all pixels and samples that are not finite; empty when there are none.
Region box_of_bad_pixels(const RunRequest& request);

/// Sets every pixel: value(channel, x, y, what it was).
void set_pixels(MemoryImage& image, const std::function<float(int, int, int, float)>& value);

} // namespace rayloom::test
