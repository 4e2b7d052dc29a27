// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/graph_reader.h"

#include "rayloom/core/text.h"
#include "rayloom/graph/names.h"

#include <algorithm>

namespace rayloom::reading
{

namespace
{

const std::vector<std::string> param_keys{"type",    "default", "min", "max",
                                          "choices", "unit",    "doc", "source"};

/// A value of the declared type for a parameter that has no default.
ParamValue neutral(const ParamInfo& info)
{
    switch (info.type) {
    case ParamType::boolean: return false;
    case ParamType::integer: return std::int64_t{0};
    case ParamType::real: return 0.0;
    case ParamType::text:
    case ParamType::path: return std::string();
    case ParamType::choice: return info.choices.front();
    case ParamType::reals: return std::vector<double>();
    case ParamType::texts:
    case ParamType::paths: return std::vector<std::string>();
    }
    return 0.0;
}

/// A scalar as the parameter's type wants it: text parameters keep it as written.
ParamValue scalar(const ParamInfo& info, const Value& value)
{
    return value.quoted || is_textual(info.type) ? ParamValue(value.text)
                                                 : plain_scalar(value.text);
}

/// Paths as the process takes them; any other value as it is.
ParamValue from_folder(const ParamInfo& info, ParamValue value, const std::string& folder)
{
    if (!is_path(info.type)) return value;
    if (auto* path = std::get_if<std::string>(&value)) *path = path_from(folder, *path);
    if (auto* paths = std::get_if<std::vector<std::string>>(&value))
        for (std::string& path : *paths) path = path_from(folder, path);
    return value;
}

} // namespace

void GraphReader::read_param(const Entry& entry)
{
    if (!check_name(entry.key, entry.where, "parameter") ||
        reserved(entry.key, entry.where, "a parameter"))
        return;
    const std::string what = "parameter '" + entry.key + "': ";
    GraphParam param;
    param.info.name = entry.key;
    param.where = entry.where;
    bool valid = true;
    if (entry.value->is_mapping())
        valid = read_param_mapping(param.info, *entry.value, what);
    else
        valid = read_default(param.info, *entry.value, false, what);
    // One that failed is kept, so that references to it are not reported as well.
    if (!valid) m_broken_params.insert(entry.key);
    m_graph.params.push_back(std::move(param));
}

bool GraphReader::read_param_mapping(ParamInfo& info, const Value& value, const std::string& what)
{
    bool valid = true;
    bool typed = false;
    for (const Entry& entry : value.entries)
        if (unknown_key(entry, param_keys, what)) valid = false;
    if (const Entry* entry = value.find("type")) {
        const auto text = text_of(*entry, what);
        const auto type = text ? param_type_from_name(*text) : std::nullopt;
        if (text && !type)
            problem(entry->value->where, what + "type '" + *text + "' is not known" +
                                             suggestion(*text, param_type_names()));
        if (!type) return false;
        info.type = *type;
        typed = true;
    }
    if (const Entry* entry = value.find("choices")) {
        if (!typed) info.type = ParamType::choice;
        typed = true;
        valid = read_choices(info, *entry, what) && valid;
    } else if (typed && info.type == ParamType::choice) {
        problem(value.where, what + "a choice lists its 'choices'");
        return false;
    }
    for (const char* key : {"unit", "doc", "source"})
        if (const Entry* entry = value.find(key)) {
            const auto text = text_of(*entry, what);
            if (!text) continue;
            (entry->key == "unit"  ? info.unit
             : entry->key == "doc" ? info.doc
                                   : info.source) = *text;
        }
    const Entry* fallback = value.find("default");
    if (!fallback && !typed) {
        problem(value.where, what + "wants a 'type' or a 'default'");
        return false;
    }
    // The type comes first, the range next: both are needed to judge the default.
    if (!typed && !infer_type(info, *fallback->value, what)) return false;
    valid = read_range(info, value, what) && valid;
    if (!valid) return false;
    if (fallback) return read_default(info, *fallback->value, true, what);
    info.required = true;
    info.default_value = neutral(info);
    return true;
}

bool GraphReader::read_choices(ParamInfo& info, const Entry& entry, const std::string& what)
{
    if (info.type != ParamType::choice && info.type != ParamType::text) {
        problem(entry.where,
                what + "'choices' are for text, not for type " + param_type_name(info.type));
        return false;
    }
    info.type = ParamType::choice;
    if (!entry.value->is_sequence() || entry.value->items.empty()) {
        problem(entry.value->where,
                what + "'choices' wants a list of texts, this is " +
                    (entry.value->is_sequence() ? "an empty list" : entry.value->describe()));
        return false;
    }
    for (const auto& item : entry.value->items) {
        if (!item->is_scalar()) {
            problem(item->where, what + "a choice is text, this is " + item->describe());
            return false;
        }
        info.choices.push_back(item->text);
    }
    return true;
}

bool GraphReader::read_range(ParamInfo& info, const Value& value, const std::string& what)
{
    bool valid = true;
    for (const char* key : {"min", "max"}) {
        const Entry* entry = value.find(key);
        if (!entry) continue;
        if (info.type != ParamType::integer && info.type != ParamType::real &&
            info.type != ParamType::reals) {
            problem(entry->where, what + "'" + key + "' is for numbers, not for type " +
                                      param_type_name(info.type));
            valid = false;
            continue;
        }
        const auto number = number_of(*entry, what);
        (std::string_view(key) == "min" ? info.min : info.max) = number;
        valid = valid && number.has_value();
    }
    if (valid && info.min && info.max && *info.min > *info.max) {
        problem(value.find("min")->value->where, what + "'min' " + format_param(*info.min) +
                                                     " is above 'max' " + format_param(*info.max));
        valid = false;
    }
    return valid;
}

bool GraphReader::infer_type(ParamInfo& info, const Value& value, const std::string& what)
{
    const auto type_of_scalar = [](const Value& v) {
        const ParamValue plain = v.quoted ? ParamValue(v.text) : plain_scalar(v.text);
        if (std::holds_alternative<bool>(plain)) return ParamType::boolean;
        if (std::holds_alternative<std::int64_t>(plain)) return ParamType::integer;
        return std::holds_alternative<double>(plain) ? ParamType::real : ParamType::text;
    };
    if (value.is_scalar()) {
        info.type = type_of_scalar(value);
        return true;
    }
    if (value.is_sequence() && !value.items.empty() &&
        std::all_of(value.items.begin(), value.items.end(),
                    [](const auto& item) { return item->is_scalar(); })) {
        const bool numbers =
            std::all_of(value.items.begin(), value.items.end(), [&](const auto& item) {
                const ParamType type = type_of_scalar(*item);
                return type == ParamType::integer || type == ParamType::real;
            });
        info.type = numbers ? ParamType::reals : ParamType::texts;
        return true;
    }
    problem(value.where, what + "the type cannot be told from a default that is " +
                             (value.is_sequence() ? "such a list" : value.describe()) +
                             "; give a 'type'");
    return false;
}

bool GraphReader::read_default(ParamInfo& info, const Value& value, bool typed,
                               const std::string& what)
{
    if (!typed && !infer_type(info, value, what)) return false;
    std::string reason;
    const auto fallback = literal(info, value, reason);
    if (!fallback) {
        problem(value.where, "the default of " + reason);
        return false;
    }
    info.default_value = *fallback;
    return true;
}

std::optional<ParamValue> GraphReader::literal(const ParamInfo& info, const Value& value,
                                               std::string& reason) const
{
    try {
        const auto checked = [&](const ParamValue& v) {
            return from_folder(info, check_param(info, v), m_graph.folder);
        };
        if (value.is_scalar()) return checked(scalar(info, value));
        if (!value.is_sequence()) {
            reason = "parameter '" + info.name + "' wants a value of type " +
                     param_type_name(info.type) + ", this is " + value.describe();
            return std::nullopt;
        }
        std::vector<double> numbers;
        std::vector<std::string> texts;
        for (const auto& item : value.items) {
            if (!item->is_scalar()) {
                reason = "parameter '" + info.name + "' holds " + item->describe() + " in its list";
                return std::nullopt;
            }
            const ParamValue v = scalar(info, *item);
            if (const auto* whole = std::get_if<std::int64_t>(&v))
                numbers.push_back(static_cast<double>(*whole));
            else if (const auto* real = std::get_if<double>(&v))
                numbers.push_back(*real);
            else
                texts.push_back(item->text);
        }
        if (info.type == ParamType::reals && !texts.empty()) {
            reason = "parameter '" + info.name + "' is a list of numbers, and '" + texts[0] +
                     "' is none";
            return std::nullopt;
        }
        if (texts.empty()) return checked(numbers);
        return checked(texts);
    } catch (const NodeError& error) {
        reason = error.what();
        if (info.type == ParamType::boolean) reason += "; write true or false";
        return std::nullopt;
    }
}

} // namespace rayloom::reading
