// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/names.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

namespace rayloom
{

namespace
{
bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }
} // namespace

bool is_graph_name(std::string_view text)
{
    return !text.empty() && is_letter(text[0]) && std::all_of(text.begin(), text.end(), [](char c) {
        return is_letter(c) || is_digit(c) || c == '-';
    });
}

std::optional<StreamReference>
parse_stream_reference(std::string_view text, const SourcePosition& where, std::string& reason)
{
    StreamReference out;
    out.where = where;
    std::string_view rest = text;
    if (const std::size_t bracket = rest.find('['); bracket != std::string_view::npos) {
        const std::string_view digits = rest.substr(bracket + 1);
        int index = 0;
        const auto [end, status] =
            std::from_chars(digits.data(), digits.data() + digits.size(), index);
        if (digits.empty() || !is_digit(digits[0]) || status != std::errc{} ||
            end + 1 != digits.data() + digits.size() || *end != ']') {
            reason = "an index is a whole number from 0 in brackets, as in 'levels[0]'";
            return std::nullopt;
        }
        out.index = index;
        rest = rest.substr(0, bracket);
    }
    const std::size_t dot = rest.find('.');
    out.node = rest.substr(0, dot);
    if (dot != std::string_view::npos) out.port = rest.substr(dot + 1);
    if (!is_graph_name(out.node) || (dot != std::string_view::npos && !is_graph_name(out.port))) {
        reason = "a reference is 'name', 'name.output' or 'name[index]'";
        return std::nullopt;
    }
    return out;
}

std::string stream_text(const StreamReference& stream)
{
    std::string out = stream.node;
    if (!stream.port.empty()) out += "." + stream.port;
    if (stream.index) out += "[" + std::to_string(*stream.index) + "]";
    return out;
}

ParamValue plain_scalar(const std::string& text)
{
    if (text == "true" || text == "True" || text == "TRUE") return true;
    if (text == "false" || text == "False" || text == "FALSE") return false;
    const bool negative = text.starts_with('-');
    const std::string_view number =
        std::string_view(text).substr(negative || text.starts_with('+') ? 1 : 0);
    if (number == ".inf" || number == ".Inf" || number == ".INF")
        return negative ? -std::numeric_limits<double>::infinity()
                        : std::numeric_limits<double>::infinity();
    if (text == ".nan" || text == ".NaN" || text == ".NAN")
        return std::numeric_limits<double>::quiet_NaN();
    const bool numeric = !number.empty() &&
                         (is_digit(number[0]) || (number[0] == '.' && number.size() > 1)) &&
                         number.find_first_not_of("0123456789.eE+-") == std::string_view::npos;
    if (!numeric) return text;
    const char* end = number.data() + number.size();
    std::int64_t whole = 0;
    if (const auto r = std::from_chars(number.data(), end, whole);
        r.ec == std::errc{} && r.ptr == end)
        return negative ? -whole : whole;
    double real = 0.0;
    if (const auto r = std::from_chars(number.data(), end, real);
        r.ptr == end && (r.ec == std::errc{} || r.ec == std::errc::result_out_of_range)) {
        // from_chars leaves the value alone when it is too large or too small for a double.
        if (r.ec != std::errc{}) real = std::strtod(std::string(number).c_str(), nullptr);
        return negative ? -real : real;
    }
    return text;
}

} // namespace rayloom
