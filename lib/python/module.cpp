// SPDX-License-Identifier: Apache-2.0
/// \file
/// The Python module `rayloom`: thin, it only translates. docs/python.md is its page.
#include "rayloom/core/error.h"
#include "rayloom/core/registry.h"
#include "rayloom/core/version.h"
#include "rayloom/python/graphs.h"
#include "rayloom/python/images.h"

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cstdlib>

namespace py = pybind11;

namespace
{

/// The family of lib/core/error.h; what a script catches is rayloom.Error or one of its kinds.
void add_errors(py::module_& module)
{
    using namespace rayloom;
    // Registered last is asked first: the base comes first.
    const auto& base = py::register_exception<Error>(module, "Error", PyExc_RuntimeError);
    py::register_exception<UsageError>(module, "UsageError", base);
    py::register_exception<GraphError>(module, "GraphError", base);
    py::register_exception<InputError>(module, "InputError", base);
    py::register_exception<OutputError>(module, "OutputError", base);
    py::register_exception<MemoryError>(module, "BudgetError", base);
    py::register_exception<Cancelled>(module, "Cancelled", base);
}

std::vector<std::string> node_names()
{
    std::vector<std::string> names;
    for (const rayloom::NodeInfo* node : rayloom::Registry::instance().all())
        names.push_back(node->name);
    return names;
}

} // namespace

PYBIND11_MODULE(rayloom, module)
{
    module.doc() = "Image-processing nodes and graphs for Monte Carlo renders.\n\n"
                   "    import rayloom\n"
                   "    graph = rayloom.Graph('ray-histogram-fusion-stack')\n"
                   "    image = graph.run({'stack': 'stack/s%02d.exr@1-16'})['image']\n"
                   "    image.pixels  # height × width × channels, float32\n";
    module.attr("__version__") = rayloom::version();
    add_errors(module);
    rayloom::python::add_images(module);
    rayloom::python::add_graphs(module);
    // As the command does. A plug-in that cannot be loaded is an ImportError with its name.
    if (const char* folders = std::getenv("RAYLOOM_PLUGINS")) try {
            rayloom::Registry::instance().load_plugins(folders);
        } catch (const rayloom::Error& e) {
            throw py::import_error(e.what());
        }
    module.def("nodes", &node_names, "Names of all nodes, those of plug-ins included.");
}
