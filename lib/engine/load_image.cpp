// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/load_image.h"

#include "rayloom/core/text.h"
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"

namespace rayloom
{

MemoryImage load_image(const std::string& path, const std::string& layer,
                       const std::string& channels)
{
    const Graph graph =
        parse_graph("rayloom: 1\nname: read\ninputs:\n  image: {channels: " + json_quote(channels) +
                        ", role: beauty}\noutputs: {image: image}\n",
                    "read");
    RunRequest request;
    request.inputs["image"].files = {{path, layer}};
    RunReport report = run_graph(graph, request);
    return std::move(report.images.at("image").front());
}

} // namespace rayloom
