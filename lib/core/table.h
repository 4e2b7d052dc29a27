// SPDX-License-Identifier: Apache-2.0
/// \file
/// Figures that travel along a graph: the result of a measurement, a fitted factor.
#pragma once

#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace rayloom
{

/// A small table with named columns; a set of scalars is a table of one row.
struct Table {
    using Cell = std::variant<double, std::string>;

    std::vector<std::string> columns;
    std::vector<std::vector<Cell>> rows;

    /// Adds a column to a one-row table (and the row itself when there is none).
    void set(std::string column, Cell value);
    /// The number in a column. Throws InputError when there is no such column or it holds text.
    double number(std::string_view column, std::size_t row = 0) const;
    bool has(std::string_view column) const;
    /// JSON: an object for one row, else an array of objects. Infinities and NaN become null.
    std::string json() const;
    friend bool operator==(const Table&, const Table&) = default;
};

} // namespace rayloom
