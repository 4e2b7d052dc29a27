// SPDX-License-Identifier: Apache-2.0
/// \file
/// The one parameter schema: nodes and graph files describe their parameters with it, and parsing,
/// range checks, help, reference pages, the JSON schema and Python arguments are made from it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace rayloom
{

/// What a parameter can hold. Integers are kept apart from reals so that 2.5 scales is refused.
using ParamValue = std::variant<bool, std::int64_t, double, std::string, std::vector<double>,
                                std::vector<std::string>>;

enum class ParamType {
    boolean,
    integer,
    real,
    text,
    choice, ///< text out of ParamInfo::choices
    reals,  ///< list of numbers; a single number is a list of one
    texts,  ///< list of texts; a single text is a list of one
    path,   ///< text that names a file; in a graph file relative to that file
    paths,  ///< list of paths; a single path is a list of one
};

/// Name of a type as graph files spell it: bool, int, float, string, choice, floats, strings, path,
/// paths.
const char* param_type_name(ParamType type);
/// All of those names.
std::vector<std::string> param_type_names();
std::optional<ParamType> param_type_from_name(const std::string& name);
/// Whether values are lists: floats, strings, paths.
bool is_list(ParamType type);
/// Whether values are text or lists of text: string, choice, path, strings, paths.
bool is_textual(ParamType type);
/// Whether values name files: path, paths.
bool is_path(ParamType type);

/// Declaration of one parameter.
struct ParamInfo {
    std::string name;
    ParamType type = ParamType::real;
    ParamValue default_value = 0.0;
    std::optional<double> min, max; ///< inclusive; for `reals` each element
    std::vector<std::string> choices;
    std::string unit;      ///< "px", "radiance", "1" … empty when it has none
    std::string doc;       ///< one sentence
    std::string source;    ///< paper file and equation, empty when it has none
    bool required = false; ///< no default: the graph must give a value
};

/// Checks type, range and choices and brings the value to the declared type (an integer where a
/// real is wanted, a single value where a list is). Throws NodeError with what is allowed.
ParamValue check_param(const ParamInfo& info, const ParamValue& value);

/// Reads a value typed on a command line ("1.5", "true", "0.2,0.4", "two-sample") as the declared
/// type. Throws NodeError as check_param() does.
ParamValue parse_param(const ParamInfo& info, const std::string& text);

/// The value as a graph file would write it.
std::string format_param(const ParamValue& value);
/// The same with other words for numbers and texts (JSON's).
std::string format_param(const ParamValue& value, std::string (*number)(double),
                         std::string (*text)(std::string_view));

} // namespace rayloom
