// SPDX-License-Identifier: Apache-2.0
/// \file
/// The small grammar of a graph file's words: names, references, numbers.
#pragma once

#include "rayloom/core/param.h"
#include "rayloom/graph/model.h"

#include <optional>
#include <string>
#include <string_view>

namespace rayloom
{

/// Letters, digits, '_' and '-', beginning with a letter or '_'.
bool is_graph_name(std::string_view text);

/// Reads `name`, `name.port`, `name[2]` or `name.port[2]`. On failure the result is empty and
/// `reason` says what is wrong.
std::optional<StreamReference>
parse_stream_reference(std::string_view text, const SourcePosition& where, std::string& reason);

/// `name`, `name.port[2]`: the reference as a graph file spells it.
std::string stream_text(const StreamReference& stream);

/// What an unquoted scalar means: true or false, an integer, a number, else text.
ParamValue plain_scalar(const std::string& text);

} // namespace rayloom
