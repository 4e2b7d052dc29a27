// SPDX-License-Identifier: Apache-2.0
#include "rayloom/python/graphs.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"
#include "rayloom/engine/cache.h"
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "rayloom/image/frames.h"
#include "rayloom/python/images.h"
#include "rayloom/python/values.h"

#include <pybind11/stl.h>

#include <atomic>
#include <chrono>
#include <future>

namespace rayloom::python
{

namespace py = pybind11;

namespace
{

/// A graph and the parameters set on it.
struct GraphObject {
    Graph graph;
    std::map<std::string, ParamValue, std::less<>> params;

    const GraphParam& param(const std::string& name) const
    {
        if (const GraphParam* p = graph.param(name)) return *p;
        std::vector<std::string> names;
        for (const GraphParam& p : graph.params) names.push_back(p.info.name);
        const std::string close = closest_name(name, names);
        throw UsageError("graph '" + graph.name + "' has no parameter '" + name + "'" +
                         (close.empty() ? "; there is " + join_names(names, true)
                                        : "; did you mean '" + close + "'?"));
    }
    void set(const std::string& name, py::handle value)
    {
        const GraphParam& declared = param(name);
        try {
            params[name] = check_param(declared.info, to_param(name, value));
        } catch (const NodeError& e) {
            throw UsageError(e.what());
        }
    }
    py::object get(const std::string& name) const
    {
        const GraphParam& declared = param(name);
        const auto it = params.find(name);
        if (it != params.end()) return from_param(it->second);
        return declared.info.required ? py::none() : from_param(declared.info.default_value);
    }
};

struct Result {
    py::dict outputs;
    py::dict stats;
    std::vector<std::string> written, notes;
    double seconds = 0.0;
};

/// Files as on the command line (`path[@range][:layer]`), images or arrays, or a list of these.
InputBinding bind_input(const std::string& name, py::handle value, std::optional<int> frame)
{
    InputBinding binding;
    const std::string what = "input '" + name + "'";
    const auto add = [&](py::handle item) {
        if (!is_path(item)) {
            binding.images.push_back(to_memory(item, what));
            return false;
        }
        const InputSource source = parse_input_source(name + "=" + to_path(item, what));
        const ResolvedFiles files = resolve_files(source, frame);
        for (const std::string& path : files.paths) binding.files.push_back({path, source.layer});
        return files.is_list;
    };
    if (py::isinstance<py::list>(value) || py::isinstance<py::tuple>(value)) {
        for (const py::handle item : value) add(item);
        binding.is_list = true;
        if (!binding.files.empty() && !binding.images.empty())
            throw UsageError(what + ": files and images in memory in one list");
    } else {
        binding.is_list = add(value);
    }
    return binding;
}

std::map<std::string, OutputBinding, std::less<>> bind_outputs(const py::object& outputs,
                                                               const std::string& type,
                                                               const std::string& compression,
                                                               std::optional<int> frame)
{
    std::map<std::string, OutputBinding, std::less<>> bound;
    if (outputs.is_none()) return bound;
    const auto add = [&](py::handle name, py::handle path) {
        OutputBinding binding;
        binding.type = type;
        binding.compression = compression;
        const auto key = py::cast<std::string>(name);
        if (!path.is_none()) {
            const OutputTarget target =
                parse_output_target(key + "=" + to_path(path, "output '" + key + "'"));
            const FramePattern pattern(target.path);
            if (pattern.has_frame() && !frame)
                throw UsageError("output '" + key + "' has a place for a frame number (" +
                                 target.path + ") and there is no frame");
            binding.path = pattern.path(frame.value_or(0));
            binding.layer = target.layer;
        }
        bound[key] = binding;
    };
    if (py::isinstance<py::dict>(outputs)) {
        for (const auto& [name, path] : py::cast<py::dict>(outputs)) add(name, path);
    } else if (py::isinstance<py::str>(outputs)) {
        add(outputs, py::none());
    } else {
        for (const py::handle name : outputs) add(name, py::none());
    }
    return bound;
}

/// Runs in a thread of its own, so that Python sees Ctrl-C and the caller's progress function is
/// called from the thread that called run().
RunReport run_interruptible(const Graph& graph, const RunRequest& request, RunOptions options,
                            const py::object& progress)
{
    std::stop_source stop;
    options.stop = stop.get_token();
    std::atomic<double> share{0.0};
    if (!progress.is_none()) options.progress = [&](double s) { share = s; };
    auto running =
        std::async(std::launch::async, [&] { return run_graph(graph, request, options); });
    const auto wait = [&](std::chrono::milliseconds time) {
        const py::gil_scoped_release free;
        return running.wait_for(time) == std::future_status::ready;
    };
    try {
        double shown = -1.0;
        while (!wait(std::chrono::milliseconds(50))) {
            if (PyErr_CheckSignals() != 0) throw py::error_already_set();
            if (const double s = share; !progress.is_none() && s != shown) progress(shown = s);
        }
        if (!progress.is_none()) progress(1.0);
    } catch (...) {
        stop.request_stop();
        const py::gil_scoped_release free;
        running.wait();
        throw;
    }
    return running.get();
}

/// '2G' or a number of bytes.
std::size_t to_bytes(const py::object& size)
{
    if (py::isinstance<py::str>(size)) return parse_bytes(py::cast<std::string>(size));
    return py::cast<std::size_t>(size);
}

Result run(const GraphObject& self, const py::dict& inputs, const py::object& outputs,
           const py::object& roi, std::optional<int> frame, int threads, const py::object& memory,
           int tile, const py::object& cache, const py::object& cache_size, bool skip,
           const std::string& type, const std::string& compression, const py::object& progress,
           const py::kwargs& params)
{
    GraphObject with = self;
    for (const auto& [name, value] : params) with.set(py::cast<std::string>(name), value);
    RunRequest request;
    for (const auto& [name, value] : inputs)
        if (!value.is_none()) {
            const auto key = py::cast<std::string>(name);
            request.inputs[key] = bind_input(key, value, frame);
        }
    request.outputs = bind_outputs(outputs, type, compression, frame);
    for (const GraphOutput& output : with.graph.outputs) {
        const auto binding = request.outputs.find(output.name);
        const bool wanted = request.outputs.empty() || binding != request.outputs.end();
        const bool kept = binding == request.outputs.end() || binding->second.path.empty();
        if (wanted && kept && output.kind == PortKind::deep)
            throw UsageError("output '" + output.name +
                             "' is a deep image, which is written to a file: outputs={'" +
                             output.name + "': 'deep.exr'}");
    }
    request.params = with.params;
    if (!roi.is_none()) request.roi = to_region(roi, "roi");
    RunOptions options;
    options.threads = threads;
    options.tile = tile;
    options.skip = skip;
    if (!cache.is_none()) options.cache_folder = to_path(cache, "cache");
    if (!memory.is_none()) options.memory = to_bytes(memory);
    const std::size_t cache_bytes = cache_size.is_none() ? usual_cache_bytes : to_bytes(cache_size);

    RunReport report = run_interruptible(with.graph, request, options, progress);
    if (!options.cache_folder.empty()) trim_cache(options.cache_folder, cache_bytes);
    Result result;
    result.seconds = report.seconds;
    result.written = report.written;
    result.notes = report.notes;
    result.stats = py::module_::import("json").attr("loads")(report.json());
    for (auto& [name, images] : report.images) {
        py::list list;
        for (MemoryImage& image : images)
            list.append(py::cast(Image{std::make_shared<MemoryImage>(std::move(image))}));
        const GraphOutput* output = with.graph.output(name);
        const bool is_list = list.size() != 1 || (output && output->kind == PortKind::list);
        result.outputs[py::str(name)] = is_list ? py::object(list) : py::object(list[0]);
    }
    for (const auto& [name, tables] : report.tables) {
        py::list list;
        for (const Table& table : tables) list.append(from_table(table));
        result.outputs[py::str(name)] = list.size() == 1 ? py::object(list[0]) : py::object(list);
    }
    return result;
}

const char* kind_name(PortKind kind)
{
    switch (kind) {
    case PortKind::list: return "list";
    case PortKind::deep: return "deep";
    case PortKind::table: return "table";
    default: return "image";
    }
}

py::dict describe(const ParamInfo& info)
{
    py::dict d;
    d["type"] = param_type_name(info.type);
    d["default"] = info.required ? py::none() : from_param(info.default_value);
    d["min"] = info.min;
    d["max"] = info.max;
    d["choices"] = info.choices;
    d["unit"] = info.unit;
    d["doc"] = info.doc;
    return d;
}

py::dict describe_params(const Graph& graph)
{
    py::dict all;
    for (const GraphParam& p : graph.params) all[py::str(p.info.name)] = describe(p.info);
    return all;
}

py::dict describe_inputs(const Graph& graph)
{
    py::dict all;
    for (const GraphInput& input : graph.inputs) {
        py::dict d;
        d["kind"] = kind_name(input.kind);
        d["required"] = input.required;
        d["channels"] = input.channels;
        d["role"] = input.role;
        d["doc"] = input.doc;
        all[py::str(input.name)] = d;
    }
    return all;
}

py::dict describe_outputs(const Graph& graph)
{
    py::dict all;
    for (const GraphOutput& output : graph.outputs) {
        py::dict d;
        d["kind"] = output.kind ? py::object(py::str(kind_name(*output.kind))) : py::none();
        d["doc"] = output.doc;
        all[py::str(output.name)] = d;
    }
    return all;
}

constexpr const char* run_doc =
    R"(Runs the graph and returns a Result.

inputs    {name: file, Image or array, or a list of these}; a file may be written as on the command
          line: 'render.exr:Combined', 'stack/s%02d.exr@1-16', 'shot.%04d.exr' with frame=
outputs   None: every output, kept in memory; a list of names: those; {name: path} writes files
          (a path of None keeps that one in memory)
roi       (x, y, width, height): compute only these pixels
threads   0: as many as this process may use
memory    budget for pixels, e.g. '2G'
cache     folder that keeps results; only what changed runs again
cache_size
          what the folder may hold, e.g. '500M'; None: 20 GB. What was unused for longest goes
progress  called with the share of the work done, 0 to 1
Further keywords are parameters of the graph, for this run. Ctrl-C stops it.)";

} // namespace

void add_graphs(py::module_& module)
{
    py::class_<Result>(module, "Result", "What a run gave back: result['image'] is an Image.")
        .def("__getitem__",
             [](const Result& r, const std::string& name) {
                 if (!r.outputs.contains(name))
                     throw py::key_error("no output '" + name + "' in memory");
                 return py::object(r.outputs[py::str(name)]);
             })
        .def("__contains__",
             [](const Result& r, const std::string& name) { return r.outputs.contains(name); })
        .def("__len__", [](const Result& r) { return r.outputs.size(); })
        .def("__iter__", [](const Result& r) { return py::iter(r.outputs); })
        .def("keys", [](const Result& r) { return r.outputs.attr("keys")(); })
        .def_readonly("seconds", &Result::seconds, "wall-clock seconds, planning not included")
        .def_readonly("stats", &Result::stats, "what `rayloom run --stats=json` prints, as a dict")
        .def_readonly("written", &Result::written, "files made")
        .def_readonly("notes", &Result::notes, "what the nodes had to say");

    py::class_<GraphObject>(module, "Graph",
                            "A graph: a file, or the name of one that comes with rayloom. "
                            "graph['kappa'] = 0.5 sets a parameter.")
        .def(py::init([](const py::object& path) {
                 return GraphObject{read_graph(find_graph(to_path(path, "Graph"))), {}};
             }),
             py::arg("path"))
        .def_static(
            "from_text",
            [](const std::string& text, const std::string& name) {
                return GraphObject{parse_graph(text, name), {}};
            },
            py::arg("text"), py::arg("name") = "graph", "A graph written in the script itself.")
        .def_property_readonly("name", [](const GraphObject& g) { return g.graph.name; })
        .def_property_readonly("doc", [](const GraphObject& g) { return g.graph.doc; })
        .def_property_readonly("inputs",
                               [](const GraphObject& g) { return describe_inputs(g.graph); })
        .def_property_readonly("outputs",
                               [](const GraphObject& g) { return describe_outputs(g.graph); })
        .def_property_readonly("params",
                               [](const GraphObject& g) { return describe_params(g.graph); })
        .def("__getitem__", &GraphObject::get)
        .def("__setitem__", &GraphObject::set)
        .def("run", &run, py::arg("inputs"), py::arg("outputs") = py::none(), py::kw_only(),
             py::arg("roi") = py::none(), py::arg("frame") = py::none(), py::arg("threads") = 0,
             py::arg("memory") = py::none(), py::arg("tile") = 0, py::arg("cache") = py::none(),
             py::arg("cache_size") = py::none(), py::arg("skip") = true, py::arg("type") = "",
             py::arg("compression") = "", py::arg("progress") = py::none(), run_doc)
        .def("__repr__",
             [](const GraphObject& g) { return "<rayloom.Graph '" + g.graph.name + "'>"; });
}

} // namespace rayloom::python
