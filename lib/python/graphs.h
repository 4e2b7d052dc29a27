// SPDX-License-Identifier: Apache-2.0
/// \file
/// rayloom.Graph and what a run of it gives back.
#pragma once

#include <pybind11/pybind11.h>

namespace rayloom::python
{

void add_graphs(pybind11::module_& module);

} // namespace rayloom::python
