// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/table.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"

#include <algorithm>

namespace rayloom
{

void Table::set(std::string column, Cell value)
{
    if (rows.empty()) rows.emplace_back();
    const auto it = std::find(columns.begin(), columns.end(), column);
    if (it != columns.end()) {
        rows[0][static_cast<std::size_t>(it - columns.begin())] = std::move(value);
        return;
    }
    columns.push_back(std::move(column));
    rows[0].push_back(std::move(value));
}

bool Table::has(std::string_view column) const
{
    return std::find(columns.begin(), columns.end(), column) != columns.end();
}

double Table::number(std::string_view column, std::size_t row) const
{
    const auto it = std::find(columns.begin(), columns.end(), column);
    if (it == columns.end())
        throw InputError("there is no figure '" + std::string(column) + "'" +
                         suggestion(column, columns));
    if (row >= rows.size())
        throw InputError("the table has " + std::to_string(rows.size()) + " rows; row " +
                         std::to_string(row) + " was asked for");
    const Cell& cell = rows[row].at(static_cast<std::size_t>(it - columns.begin()));
    if (const double* v = std::get_if<double>(&cell)) return *v;
    throw InputError("figure '" + std::string(column) + "' is not a number");
}

std::string Table::json() const
{
    const auto object = [&](const std::vector<Cell>& row) {
        std::string out = "{";
        for (std::size_t i = 0; i < columns.size(); ++i) {
            if (i > 0) out += ", ";
            out += json_quote(columns[i]) + ": ";
            const Cell& cell = row[i];
            out += std::holds_alternative<double>(cell) ? json_number(std::get<double>(cell))
                                                        : json_quote(std::get<std::string>(cell));
        }
        return out + "}";
    };
    if (rows.size() == 1) return object(rows[0]);
    std::string out = "[";
    for (std::size_t i = 0; i < rows.size(); ++i) out += (i > 0 ? ",\n " : "") + object(rows[i]);
    return out + "]";
}

} // namespace rayloom
