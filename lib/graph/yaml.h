// SPDX-License-Identifier: Apache-2.0
/// \file
/// YAML text as a tree that keeps what a graph file's messages need: the position of every key and
/// value, whether a scalar was quoted, and keys given twice. Reading is bounded in nesting, size
/// and alias expansion, so a hostile file costs no more than a large honest one.
#pragma once

#include "rayloom/core/error.h"

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace rayloom::yaml
{

/// Largest file, deepest nesting and most values (aliases counted as what they stand for).
inline constexpr std::size_t max_bytes = 1 << 20;
inline constexpr int max_depth = 32;
inline constexpr std::size_t max_values = 100'000;

struct Value;
using ValuePtr = std::shared_ptr<const Value>;

struct Entry {
    std::string key;
    SourcePosition where; ///< of the key
    ValuePtr value;
};

struct Value {
    enum class Kind { null, scalar, sequence, mapping };
    Kind kind = Kind::null;
    SourcePosition where;
    std::string text;            ///< of a scalar
    bool quoted = false;         ///< written in quotes, so never a number or true/false
    std::vector<ValuePtr> items; ///< of a sequence
    std::vector<Entry> entries;  ///< of a mapping: each key once, `<<` merged in
    std::size_t expanded = 1;    ///< values in here, aliases counted as what they stand for

    bool is_null() const { return kind == Kind::null; }
    bool is_scalar() const { return kind == Kind::scalar; }
    bool is_sequence() const { return kind == Kind::sequence; }
    bool is_mapping() const { return kind == Kind::mapping; }
    const Entry* find(std::string_view key) const;
    /// "a list", "a mapping", "the text 'x'" … for messages.
    std::string describe() const;
};

/// Reads one document. What is wrong is added to `problems`; the result is null when the text is
/// no YAML, holds nothing, or exceeds a limit.
ValuePtr parse(const std::string& text, const std::string& file, std::vector<Problem>& problems);

} // namespace rayloom::yaml
