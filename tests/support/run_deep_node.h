// SPDX-License-Identifier: Apache-2.0
/// \file
/// Runs one node with a deep input in a graph of its own, on pixels in memory.
#pragma once

#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"

#include <map>
#include <memory>
#include <string>

namespace rayloom::test
{

/// What a run gave. Throws what the run throws.
struct DeepRun {
    RunReport report;
    const MemoryDeep& deep() const { return report.deep.begin()->second.front(); }
    const MemoryImage& image() const { return report.images.begin()->second.front(); }
};

/// Runs `{op: …}` given as text, with input `deep` and, when there are pixels, `color`. Its first
/// output is the result.
inline DeepRun run_deep(const std::string& node, const MemoryDeep& deep,
                        const MemoryImage* color = nullptr, const rayloom::RunOptions& options = {},
                        std::optional<Region> roi = {})
{
    const std::string text = std::string("rayloom: 1\nname: deep-run\ninputs:\n") +
                             "  deep: {kind: deep}\n" + (color ? "  color: {}\n" : "") +
                             "nodes:\n  n: " + node + "\noutputs: {out: n}\n";
    RunRequest request;
    request.roi = roi;
    request.inputs["deep"].deep = std::make_shared<MemoryDeep>(deep);
    if (color) {
        auto image = std::make_shared<MemoryImage>();
        image->desc = color->desc;
        image->pixels = ImageBuffer(color->desc.data, color->desc.channel_count());
        copy_pixels(color->pixels.view(), image->pixels.view());
        request.inputs["color"].images.push_back(std::move(image));
    }
    return {run_graph(parse_graph(text, "deep-run"), request, options)};
}

} // namespace rayloom::test
