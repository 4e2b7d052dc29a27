// SPDX-License-Identifier: Apache-2.0
#include "rayloom/python/values.h"

#include "rayloom/core/error.h"

#include <pybind11/stl.h>

namespace rayloom::python
{

namespace py = pybind11;

namespace
{

std::string type_name(py::handle value)
{
    return py::cast<std::string>(py::type::handle_of(value).attr("__name__"));
}

/// Numbers of any kind, NumPy's own among them; a bool is none.
bool is_number(py::handle value)
{
    return !PyBool_Check(value.ptr()) &&
           (PyIndex_Check(value.ptr()) || PyFloat_Check(value.ptr()) ||
            py::hasattr(value, "__float__"));
}

} // namespace

ParamValue to_param(const std::string& name, py::handle value)
{
    if (PyBool_Check(value.ptr())) return py::cast<bool>(value);
    if (py::isinstance<py::str>(value)) return py::cast<std::string>(value);
    if (PyIndex_Check(value.ptr()))
        return py::cast<std::int64_t>(py::reinterpret_steal<py::int_>(PyNumber_Index(value.ptr())));
    if (is_number(value) && !py::isinstance<py::sequence>(value))
        return py::cast<double>(py::float_(py::reinterpret_borrow<py::object>(value)));
    if (py::isinstance<py::sequence>(value)) {
        const auto sequence = py::reinterpret_borrow<py::sequence>(value);
        std::vector<double> numbers;
        std::vector<std::string> texts;
        for (const py::handle item : sequence)
            if (py::isinstance<py::str>(item))
                texts.push_back(py::cast<std::string>(item));
            else if (is_number(item))
                numbers.push_back(
                    py::cast<double>(py::float_(py::reinterpret_borrow<py::object>(item))));
            else
                throw UsageError("parameter '" + name +
                                 "': a list of numbers or of texts, not of " + type_name(item));
        if (!texts.empty() && !numbers.empty())
            throw UsageError("parameter '" + name + "': numbers and texts in one list");
        if (!texts.empty()) return texts;
        return numbers;
    }
    throw UsageError("parameter '" + name + "': a bool, number, text or list of them, not " +
                     type_name(value));
}

py::object from_param(const ParamValue& value)
{
    return std::visit([](const auto& v) -> py::object { return py::cast(v); }, value);
}

py::object from_table(const Table& table)
{
    py::list rows;
    for (const auto& cells : table.rows) {
        py::dict row;
        for (std::size_t c = 0; c < table.columns.size(); ++c)
            row[py::str(table.columns[c])] =
                std::visit([](const auto& v) -> py::object { return py::cast(v); }, cells[c]);
        rows.append(row);
    }
    if (rows.size() == 1) return rows[0];
    return rows;
}

py::tuple from_region(const Region& region)
{
    return py::make_tuple(region.x0, region.y0, region.width(), region.height());
}

Region to_region(py::handle value, const char* what)
{
    try {
        const auto numbers = py::cast<std::vector<int>>(value);
        if (numbers.size() == 4 && numbers[2] > 0 && numbers[3] > 0)
            return {numbers[0], numbers[1], numbers[0] + numbers[2], numbers[1] + numbers[3]};
    } catch (const py::cast_error&) {
    }
    throw UsageError(std::string(what) + " wants (x, y, width, height)");
}

bool is_path(py::handle value)
{
    return py::isinstance<py::str>(value) || py::hasattr(value, "__fspath__");
}

std::string to_path(py::handle value, const std::string& what)
{
    if (!is_path(value)) throw UsageError(what + " wants a path, not " + type_name(value));
    return py::cast<std::string>(py::module_::import("os").attr("fspath")(value));
}

} // namespace rayloom::python
