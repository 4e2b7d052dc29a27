// SPDX-License-Identifier: Apache-2.0
#include "rayloom/cli/request_options.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"
#include "rayloom/image/frames.h"

#include <algorithm>
#include <charconv>

namespace rayloom::cli
{

namespace
{

Region parse_region(const std::string& text)
{
    int values[4] = {};
    const char* at = text.data();
    const char* end = at + text.size();
    for (int i = 0; i < 4; ++i) {
        const auto [next, status] = std::from_chars(at, end, values[i]);
        const bool last = i == 3;
        if (status != std::errc{} || (last ? next != end : next == end || *next != ','))
            throw UsageError("--roi wants x,y,width,height, not '" + text + "'");
        at = next + 1;
    }
    if (values[2] <= 0 || values[3] <= 0)
        throw UsageError("--roi wants a width and a height above 0, not '" + text + "'");
    constexpr int far = 1 << 28;
    for (const int value : values)
        if (value < -far || value > far)
            throw UsageError("--roi wants pixels within 2^28 of the origin, not '" + text + "'");
    return {values[0], values[1], values[0] + values[2], values[1] + values[3]};
}

/// Inputs nobody named that are frames around another input's.
void add_neighbours(const Graph& graph, std::optional<int> frame, std::vector<InputSource>& sources)
{
    if (!frame) return;
    const std::size_t named = sources.size();
    const auto source_of = [&](const std::string& input) {
        return std::find_if(sources.begin(), sources.begin() + static_cast<std::ptrdiff_t>(named),
                            [&](const InputSource& s) { return s.name == input; }) -
               sources.begin();
    };
    for (const GraphInput& input : graph.inputs) {
        if (!input.neighbours || source_of(input.name) != static_cast<std::ptrdiff_t>(named))
            continue;
        const auto at = static_cast<std::size_t>(source_of(input.neighbours->input));
        if (at == named) continue;
        InputSource source = sources[at];
        if (source.literal || source.frames || source.relative || is_glob(source.path) ||
            source.path.find_first_of("%#") == std::string::npos ||
            !FramePattern(source.path).has_frame())
            continue;
        source.name = input.name;
        source.relative = RelativeFrames{input.neighbours->first, input.neighbours->last};
        sources.push_back(std::move(source));
    }
}

} // namespace

void RequestOptions::add_to(CLI::App& command)
{
    command
        .add_option("graph", graph, "Graph file, or the name of a graph that comes with rayloom")
        ->required()
        ->type_name("GRAPH");
    command
        .add_option(
            "-i,--input", inputs,
            "Input as name=path[@range][:layer]; a glob or a pattern with its own range is a list, "
            "several -i of one name too")
        ->type_name("NAME=PATH")
        ->take_all()
        ->allow_extra_args(false);
    command.add_option("-o,--output", outputs, "Output as name=path; .json for figures")
        ->type_name("NAME=PATH")
        ->take_all()
        ->allow_extra_args(false);
    command.add_option("-p,--param", params, "Parameter as name=value; lists as a,b,c")
        ->type_name("NAME=VALUE")
        ->take_all()
        ->allow_extra_args(false);
    command.add_option("-f,--frames", frames, "Run once for each frame, e.g. 1-100x2,150")
        ->type_name("RANGE");
    command.add_option("--roi", roi, "Compute only these pixels")->type_name("X,Y,W,H");
    command.add_option("--tile", tile, "Side of a tile in pixels (0: chosen)")
        ->check(CLI::Range(0, 65536));
    command.add_option("-t,--threads", threads, "Threads (0: as many as this process may use)")
        ->check(CLI::Range(0, 4096));
    command.add_option("--memory", memory, "Budget for pixels in memory, e.g. 2G")
        ->type_name("SIZE");
    command.add_option("--cache", cache, "Folder that keeps results; only what changed runs again")
        ->type_name("DIR");
    command
        .add_option("--type", type,
                    "Pixel type of written images (half, float, uint8, …); default as the input")
        ->type_name("TYPE");
    command
        .add_option("--compression", compression,
                    "Compression of written images; default as the input")
        ->type_name("NAME");
    command.add_flag(
        "--pass-through", pass_through,
        "Write the file of the first input back, with the filtered layer in its place and every "
        "other layer bit for bit");
    command.add_flag("--no-skip", no_skip, "Take no shortcut (the pixels are the same)");
}

std::vector<std::optional<int>> RequestOptions::frame_list() const
{
    if (frames.empty()) return {std::nullopt};
    std::vector<std::optional<int>> list;
    for (const int frame : parse_frame_range(frames)) list.emplace_back(frame);
    return list;
}

RunRequest RequestOptions::request(const Graph& loaded, std::optional<int> frame) const
{
    RunRequest request;
    std::string first_file, first_layer;
    std::vector<int> all_frames;
    for (const std::optional<int>& one : frame_list())
        if (one) all_frames.push_back(*one);
    std::vector<InputSource> sources;
    for (const std::string& text : inputs) sources.push_back(parse_input_source(text));
    add_neighbours(loaded, frame, sources);
    for (const InputSource& source : sources) {
        const ResolvedFiles files = resolve_files(source, frame, all_frames);
        if (files.paths.empty()) continue; // no neighbours at the end of an animation
        InputBinding& binding = request.inputs[source.name];
        const bool again = !binding.files.empty();
        if (again && binding.files.front().layer != source.layer)
            throw UsageError("all files of input '" + source.name +
                             "' are read from one layer; name the same after each path, not '" +
                             binding.files.front().layer + "' and '" + source.layer + "'");
        for (const std::string& path : files.paths) binding.files.push_back({path, source.layer});
        binding.is_list = again || files.is_list;
        if (first_file.empty()) {
            first_file = files.paths.front();
            first_layer = source.layer;
        }
    }
    for (const std::string& text : outputs) {
        const OutputTarget target = parse_output_target(text);
        const FramePattern pattern(target.path);
        if (pattern.has_frame() && !frame)
            throw UsageError("output '" + target.name + "' has a place for a frame number (" +
                             target.path + ") and there is no --frames");
        if (!pattern.has_frame() && frame && frame_list().size() > 1)
            throw UsageError("every frame would be written to '" + target.path +
                             "'; give output '" + target.name +
                             "' a place for the frame, e.g. out.%04d.exr");
        OutputBinding binding;
        binding.path = frame ? pattern.path(*frame) : pattern.path(0);
        binding.type = type;
        binding.compression = compression;
        binding.layer = target.layer;
        if (pass_through) {
            if (first_file.empty())
                throw UsageError("--pass-through needs an input file (-i) to hand on");
            binding.pass_through_from = first_file;
            if (binding.layer.empty()) binding.layer = first_layer;
        }
        if (!request.outputs.emplace(target.name, binding).second)
            throw UsageError("output '" + target.name + "' is given twice");
    }
    for (const std::string& text : params) {
        const std::size_t equals = text.find('=');
        if (equals == std::string::npos || equals == 0)
            throw UsageError("-p wants name=value, not '" + text + "'");
        if (!request.param_texts.emplace(text.substr(0, equals), text.substr(equals + 1)).second)
            throw UsageError("parameter '" + text.substr(0, equals) + "' is given twice");
    }
    for (const auto& [name, binding] : request.inputs)
        if (const GraphInput* input = loaded.input(name);
            input && input->kind != PortKind::list && binding.files.size() > 1)
            throw UsageError("input '" + name + "' takes one file, not " +
                             std::to_string(binding.files.size()) + ": " + binding.files[0].path +
                             ", " + binding.files[1].path +
                             (binding.files.size() > 2 ? ", …" : ""));
    if (!roi.empty()) request.roi = parse_region(roi);
    return request;
}

RunOptions RequestOptions::run_options() const
{
    RunOptions options;
    options.threads = threads;
    options.tile = tile;
    options.skip = !no_skip;
    options.cache_folder = cache;
    if (!memory.empty()) options.memory = parse_bytes(memory);
    return options;
}

} // namespace rayloom::cli
