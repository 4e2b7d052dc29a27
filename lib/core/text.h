// SPDX-License-Identifier: Apache-2.0
/// \file
/// Helpers for messages a user can act on.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace rayloom
{

/// "a, b and c"; quoted with single quotes when asked.
std::string join_names(std::span<const std::string> names, bool quoted = false);

/// The name closest to `word`, empty when none is close enough to be a slip of the finger.
std::string closest_name(std::string_view word, std::span<const std::string> names);

/// "; did you mean 'x'?" or "; there is: a, b, c" for an unknown name.
std::string suggestion(std::string_view word, std::span<const std::string> names);

/// Text with `"`, `\` and control characters escaped, in double quotes.
std::string json_quote(std::string_view text);
/// Shortest number that reads back as the same double; null for NaN and infinities.
std::string json_number(double value);

/// 1.5 GB, 12 MB, 800 B.
std::string format_bytes(std::size_t bytes);
/// "2G", "500M", "1048576"; throws UsageError.
std::size_t parse_bytes(std::string_view text);

} // namespace rayloom
