// SPDX-License-Identifier: Apache-2.0
/// \file
/// Parameters, tables and paths between C++ and Python.
#pragma once

#include "rayloom/core/param.h"
#include "rayloom/core/table.h"
#include "rayloom/image/region.h"

#include <pybind11/pybind11.h>

#include <string>

namespace rayloom::python
{

/// bool, int, float, str, or a sequence of numbers or of texts. Throws UsageError that names the
/// parameter.
ParamValue to_param(const std::string& name, pybind11::handle value);
pybind11::object from_param(const ParamValue& value);

/// A dict for a table of one row, else a list of dicts.
pybind11::object from_table(const Table& table);

/// (x, y, width, height), as everywhere in rayloom.
pybind11::tuple from_region(const Region& region);
/// Throws UsageError.
Region to_region(pybind11::handle value, const char* what);

/// A str or os.PathLike; throws UsageError for anything else.
std::string to_path(pybind11::handle value, const std::string& what);
bool is_path(pybind11::handle value);

} // namespace rayloom::python
