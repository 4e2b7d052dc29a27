// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/text.h"

#include "rayloom/core/error.h"

#include <OpenImageIO/strutil.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>

namespace rayloom
{

std::string join_names(std::span<const std::string> names, bool quoted)
{
    std::string out;
    for (std::size_t i = 0; i < names.size(); ++i) {
        if (i > 0) out += i + 1 == names.size() ? " and " : ", ";
        out += quoted ? "'" + names[i] + "'" : names[i];
    }
    return out;
}

std::string closest_name(std::string_view word, std::span<const std::string> names)
{
    // A third of the letters wrong is a slip; more is another word.
    std::size_t best = std::max<std::size_t>(1, word.size() / 3) + 1;
    std::string found;
    for (const std::string& name : names) {
        const std::size_t distance =
            OIIO::Strutil::edit_distance({word.data(), word.size()}, {name.data(), name.size()});
        if (distance < best) {
            best = distance;
            found = name;
        }
    }
    return found;
}

std::string suggestion(std::string_view word, std::span<const std::string> names)
{
    if (const std::string near = closest_name(word, names); !near.empty())
        return "; did you mean '" + near + "'?";
    if (names.empty()) return "; there is none";
    if (names.size() <= 24) return "; there is: " + join_names(names);
    return "";
}

std::string json_quote(std::string_view text)
{
    std::string out = "\"";
    for (const char c : text) {
        switch (c) {
        case '"': out += "\\\""; break;
        case '\\': out += "\\\\"; break;
        case '\n': out += "\\n"; break;
        case '\t': out += "\\t"; break;
        case '\r': out += "\\r"; break;
        default:
            if (static_cast<unsigned char>(c) < 0x20) {
                char buffer[8];
                std::snprintf(buffer, sizeof buffer, "\\u%04x", static_cast<unsigned>(c));
                out += buffer;
            } else {
                out += c;
            }
        }
    }
    return out + "\"";
}

std::string json_number(double value)
{
    if (!std::isfinite(value)) return "null";
    char buffer[32];
    const auto result = std::to_chars(buffer, buffer + sizeof buffer, value);
    return {buffer, result.ptr};
}

std::string format_bytes(std::size_t bytes)
{
    static constexpr const char* units[] = {"B", "kB", "MB", "GB", "TB"};
    double value = static_cast<double>(bytes);
    int unit = 0;
    while (value >= 1000.0 && unit < 4) {
        value /= 1000.0;
        ++unit;
    }
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, unit == 0 || value >= 100 ? "%.0f %s" : "%.1f %s", value,
                  units[unit]);
    return buffer;
}

std::size_t parse_bytes(std::string_view text)
{
    double value = 0.0;
    const auto [end, status] = std::from_chars(text.data(), text.data() + text.size(), value);
    std::string unit(end, text.data() + text.size());
    std::transform(unit.begin(), unit.end(), unit.begin(),
                   [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
    if (unit.size() == 2 && unit[1] == 'B') unit.pop_back();
    const std::size_t scale = std::string_view("BKMGT").find(unit.empty() ? 'B' : unit[0]);
    const double bytes = scale == std::string_view::npos
                             ? 0.0
                             : value * std::pow(1000.0, static_cast<double>(scale));
    // Less than a byte is no size, and what no machine addresses is no number of bytes.
    if (status != std::errc{} || unit.size() > 1 || !(bytes >= 1.0 && bytes < 0x1p63))
        throw UsageError("'" + std::string(text) +
                         "' is not a size; write 2G, 500M or a number of bytes");
    return static_cast<std::size_t>(bytes);
}

} // namespace rayloom
