// SPDX-License-Identifier: Apache-2.0
// The options of `run` and `plan`, one a line: a letter that says which, then its value.
#include "rayloom/cli/request_options.h"
#include "rayloom/graph/reader.h"
#include "rayloom/image/frames.h"
#include "rayloom/stats/compare.h"
#include "tests/fuzz/target.h"

#include <sstream>
#include <string>

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size)
{
    static const rayloom::Graph graph = rayloom::parse_graph(
        "rayloom: 1\nname: request\n"
        "params:\n"
        "  amount: {type: float, default: 1, min: 0, max: 10}\n"
        "  how: {type: choice, default: one, choices: [one, two]}\n"
        "  names: {type: strings, default: []}\n"
        "inputs:\n"
        "  color: {channels: RGB}\n"
        "  stack: {kind: list, channels: RGB, optional: true}\n"
        "  before: {kind: list, channels: RGB, optional: true, neighbours: color@-2..-1}\n"
        "nodes: {n: {op: threshold.sanitize, image: color}}\n"
        "outputs: {image: n}\n",
        "request");
    std::istringstream lines(std::string(reinterpret_cast<const char*>(data), size));
    rayloom::cli::RequestOptions options;
    for (std::string line; std::getline(lines, line);) {
        if (line.empty()) continue;
        const std::string value = line.substr(1);
        // Patterns that match files of this machine are no part of the answer.
        const bool matches = value.find_first_of("*?[") != std::string::npos;
        switch (line.front()) {
        case 'i':
            if (!matches) options.inputs.push_back(value);
            break;
        case 'o': options.outputs.push_back(value); break;
        case 'p': options.params.push_back(value); break;
        case 'f': options.frames = value; break;
        case 'r': options.roi = value; break;
        case 'm': options.memory = value; break;
        case 't': options.type = value; break;
        case 'z': options.compression = value; break;
        case 'l': rayloom::fuzz::answer([&] { rayloom::parse_error_limit(value); }); break;
        default: options.pass_through = !options.pass_through;
        }
    }
    rayloom::fuzz::answer([&] { options.run_options(); });
    rayloom::fuzz::answer([&] {
        int most = 4; // each frame is asked for alike
        for (const std::optional<int>& frame : options.frame_list())
            if (most-- > 0) options.request(graph, frame);
    });
    return 0;
}
