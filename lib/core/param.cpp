// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/param.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

namespace rayloom
{

namespace
{

constexpr std::array<std::pair<ParamType, const char*>, 9> type_names{{
    {ParamType::boolean, "bool"},
    {ParamType::integer, "int"},
    {ParamType::real, "float"},
    {ParamType::text, "string"},
    {ParamType::choice, "choice"},
    {ParamType::reals, "floats"},
    {ParamType::texts, "strings"},
    {ParamType::path, "path"},
    {ParamType::paths, "paths"},
}};

std::string short_number(double v)
{
    char buffer[32];
    const auto result = std::to_chars(buffer, buffer + sizeof buffer, v);
    return {buffer, result.ptr};
}

[[noreturn]] void wrong_type(const ParamInfo& info, const ParamValue& value)
{
    std::string got;
    std::visit(
        [&](const auto& v) {
            using T = std::decay_t<decltype(v)>;
            if constexpr (std::is_same_v<T, bool>)
                got = "a bool";
            else if constexpr (std::is_same_v<T, std::int64_t>)
                got = "an integer";
            else if constexpr (std::is_same_v<T, double>)
                got = "a number";
            else if constexpr (std::is_same_v<T, std::string>)
                got = "text";
            else
                got = "a list";
        },
        value);
    throw NodeError("parameter '" + info.name + "' wants a value of type " +
                    param_type_name(info.type) + ", not " + got + " (" + format_param(value) + ")");
}

void check_range(const ParamInfo& info, double v)
{
    const bool low = info.min && !(v >= *info.min);
    const bool high = info.max && !(v <= *info.max);
    if (std::isnan(v) || low || high) {
        std::string allowed;
        if (info.min && info.max)
            allowed = "from " + short_number(*info.min) + " to " + short_number(*info.max);
        else if (info.min)
            allowed = "at least " + short_number(*info.min);
        else if (info.max)
            allowed = "at most " + short_number(*info.max);
        else
            allowed = "a number";
        throw NodeError("parameter '" + info.name + "' must be " + allowed + ", not " +
                        short_number(v));
    }
}

} // namespace

const char* param_type_name(ParamType type)
{
    for (const auto& [t, name] : type_names)
        if (t == type) return name;
    return "?";
}

std::vector<std::string> param_type_names()
{
    std::vector<std::string> names;
    for (const auto& [type, name] : type_names) names.emplace_back(name);
    return names;
}

std::optional<ParamType> param_type_from_name(const std::string& name)
{
    for (const auto& [type, n] : type_names)
        if (name == n) return type;
    return std::nullopt;
}

bool is_list(ParamType type)
{
    return type == ParamType::reals || type == ParamType::texts || type == ParamType::paths;
}

bool is_textual(ParamType type)
{
    return type == ParamType::text || type == ParamType::choice || type == ParamType::texts ||
           is_path(type);
}

bool is_path(ParamType type) { return type == ParamType::path || type == ParamType::paths; }

ParamValue check_param(const ParamInfo& info, const ParamValue& value)
{
    switch (info.type) {
    case ParamType::boolean:
        if (std::holds_alternative<bool>(value)) return value;
        wrong_type(info, value);
    case ParamType::integer: {
        const auto* i = std::get_if<std::int64_t>(&value);
        if (!i) wrong_type(info, value);
        check_range(info, static_cast<double>(*i));
        return value;
    }
    case ParamType::real: {
        double v = 0.0;
        if (const auto* i = std::get_if<std::int64_t>(&value))
            v = static_cast<double>(*i);
        else if (const auto* d = std::get_if<double>(&value))
            v = *d;
        else
            wrong_type(info, value);
        check_range(info, v);
        return v;
    }
    case ParamType::text:
    case ParamType::path:
        if (std::holds_alternative<std::string>(value)) return value;
        wrong_type(info, value);
    case ParamType::choice: {
        const auto* text = std::get_if<std::string>(&value);
        if (!text) wrong_type(info, value);
        if (std::find(info.choices.begin(), info.choices.end(), *text) == info.choices.end())
            throw NodeError("parameter '" + info.name + "' cannot be '" + *text + "'" +
                            suggestion(*text, info.choices));
        return value;
    }
    case ParamType::reals: {
        std::vector<double> list;
        if (const auto* i = std::get_if<std::int64_t>(&value))
            list.push_back(static_cast<double>(*i));
        else if (const auto* d = std::get_if<double>(&value))
            list.push_back(*d);
        else if (const auto* l = std::get_if<std::vector<double>>(&value))
            list = *l;
        else if (const auto* t = std::get_if<std::vector<std::string>>(&value); !t || !t->empty())
            wrong_type(info, value);
        for (const double v : list) check_range(info, v);
        return list;
    }
    case ParamType::texts:
    case ParamType::paths: {
        if (const auto* s = std::get_if<std::string>(&value)) return std::vector<std::string>{*s};
        if (std::holds_alternative<std::vector<std::string>>(value)) return value;
        if (const auto* l = std::get_if<std::vector<double>>(&value); l && l->empty())
            return std::vector<std::string>{};
        wrong_type(info, value);
    }
    }
    wrong_type(info, value);
}

namespace
{

ParamValue parse_number(const ParamInfo& info, std::string_view text)
{
    std::int64_t i = 0;
    const char* end = text.data() + text.size();
    if (const auto r = std::from_chars(text.data(), end, i); r.ec == std::errc{} && r.ptr == end)
        return i;
    double d = 0.0;
    if (const auto r = std::from_chars(text.data(), end, d); r.ec == std::errc{} && r.ptr == end)
        return d;
    throw NodeError("parameter '" + info.name + "' wants a value of type " +
                    param_type_name(info.type) + ", not '" + std::string(text) + "'");
}

std::vector<std::string> split_list(const std::string& text)
{
    std::vector<std::string> items;
    std::size_t start = 0;
    while (start <= text.size()) {
        const std::size_t comma = std::min(text.find(',', start), text.size());
        items.push_back(text.substr(start, comma - start));
        start = comma + 1;
    }
    return items;
}

} // namespace

ParamValue parse_param(const ParamInfo& info, const std::string& text)
{
    switch (info.type) {
    case ParamType::boolean:
        for (const char* yes : {"true", "yes", "on", "1"})
            if (text == yes) return true;
        for (const char* no : {"false", "no", "off", "0"})
            if (text == no) return false;
        throw NodeError("parameter '" + info.name + "' wants true or false, not '" + text + "'");
    case ParamType::integer:
    case ParamType::real: return check_param(info, parse_number(info, text));
    case ParamType::reals: {
        std::vector<double> list;
        if (!text.empty())
            for (const std::string& item : split_list(text)) {
                const ParamValue v = parse_number(info, item);
                const auto* i = std::get_if<std::int64_t>(&v);
                list.push_back(i ? static_cast<double>(*i) : std::get<double>(v));
            }
        return check_param(info, list);
    }
    case ParamType::texts:
    case ParamType::paths:
        return check_param(info, text.empty() ? std::vector<std::string>{} : split_list(text));
    case ParamType::text:
    case ParamType::choice:
    case ParamType::path: return check_param(info, text);
    }
    return check_param(info, text);
}

std::string format_param(const ParamValue& value)
{
    return format_param(value, short_number, [](std::string_view text) {
        return text.empty() ? std::string("''") : std::string(text);
    });
}

std::string format_param(const ParamValue& value, std::string (*number)(double),
                         std::string (*text)(std::string_view))
{
    const auto list = [](const auto& items, const auto& write) {
        std::string out = "[";
        for (const auto& item : items) out += (out.size() > 1 ? ", " : "") + write(item);
        return out + "]";
    };
    if (const auto* truth = std::get_if<bool>(&value)) return *truth ? "true" : "false";
    if (const auto* whole = std::get_if<std::int64_t>(&value)) return std::to_string(*whole);
    if (const auto* real = std::get_if<double>(&value)) return number(*real);
    if (const auto* words = std::get_if<std::string>(&value)) return text(*words);
    if (const auto* numbers = std::get_if<std::vector<double>>(&value))
        return list(*numbers, number);
    return list(std::get<std::vector<std::string>>(value), text);
}

} // namespace rayloom
