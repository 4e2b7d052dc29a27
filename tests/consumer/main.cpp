// SPDX-License-Identifier: Apache-2.0
// Uses rayloom from outside: loads plug-ins from the folders given, prints every node's name, and
// runs a graph on an image in memory.
#include <rayloom/core/install_paths.h>
#include <rayloom/core/registry.h>
#include <rayloom/engine/run.h>
#include <rayloom/graph/reader.h>

#include <cstdio>

using namespace rayloom;

int main(int argc, char** argv)
try {
    if (argc > 1) Registry::instance().load_plugins(argv[1]);
    for (const NodeInfo* node : Registry::instance().all())
        std::printf("%s (%s)\n", node->name.c_str(), node->origin.c_str());
    std::printf("data: %s\n", data_folder().c_str());

    auto image = std::make_shared<MemoryImage>();
    image->desc.data = image->desc.display = {-8, -8, 8, 8};
    image->desc.channels = {"R", "G", "B"};
    image->pixels = ImageBuffer(image->desc.data, 3);
    image->pixels.fill(0.5f);
    RunRequest request;
    request.inputs["color"].images = {image};
    const Graph graph = parse_graph("rayloom: 1\ninputs: {color: any image}\n"
                                    "nodes: {twice: {op: oiio.mul, image: color, value: 2}}\n"
                                    "outputs: {image: twice}\n",
                                    "twice");
    const RunReport report = run_graph(graph, request);
    std::printf("twice 0.5 is %g\n", report.images.at("image").at(0).pixels.view().at(2, 7, 7));
} catch (const rayloom::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return error.exit_code();
}
