// SPDX-License-Identifier: Apache-2.0
/// \file
/// Runs one node on images in memory, without a graph or the engine: plan, reduction in row order,
/// then compute() tile by tile. Inputs are handed over as copies of exactly what plan() said is
/// needed, so that a node that reads more is caught.
#pragma once

#include "rayloom/core/node.h"
#include "rayloom/core/registry.h"

#include <functional>
#include <map>
#include <string>
#include <vector>

namespace rayloom::test
{

struct TestImage {
    ImageDesc desc;
    ImageBuffer pixels;

    ConstImageView view() const { return pixels.view(); }
    ImageView view() { return pixels.view(); }
};

/// An image whose display window is its data window; pixel values from `value(channel, x, y)`.
TestImage make_image(const Region& data, std::vector<std::string> channels,
                     const std::function<float(int, int, int)>& value);

/// Deep image: rows of the whole data window.
struct TestDeep {
    ImageDesc desc;
    std::vector<std::shared_ptr<const DeepRow>> rows;
};

struct NodeInput {
    std::string port;
    std::vector<const TestImage*> images;
    const TestDeep* deep = nullptr;
    bool list = false;
};

struct NodeRun {
    PlanResult plan;
    std::map<std::string, std::vector<TestImage>, std::less<>> outputs;
    std::map<std::string, Table, std::less<>> tables; ///< what finish() gave
    std::map<std::string, std::size_t, std::less<>> skipped, counted;

    const TestImage& image(std::string_view port = "image", std::size_t element = 0) const;
};

struct RunOptions {
    int tile_width = 1 << 20, tile_height = 1 << 20;
    bool may_skip = true;
    std::vector<std::string> wanted; ///< empty: every output
};

/// Throws what the node throws.
NodeRun run_node(std::string_view op, const ParamValues& params,
                 const std::vector<NodeInput>& inputs, const RunOptions& options = {});

/// Number of floats whose bits differ; windows and channels must agree.
std::size_t differing_floats(const TestImage& a, const TestImage& b);

} // namespace rayloom::test
