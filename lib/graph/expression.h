// SPDX-License-Identifier: Apache-2.0
/// \file
/// `when:` conditions: reading, checking and evaluating them.
///
///     expression = and ("or" and)*
///     and        = not ("and" not)*
///     not        = "not" not | comparison
///     comparison = operand (("==" | "!=" | "<" | "<=" | ">" | ">=") operand)?
///     operand    = "(" expression ")" | $param | function "(" reference ")"
///                | number | "true" | "false" | 'text' | "text"
///     function   = "has" | "count" | "channels" | "black"
#pragma once

#include "rayloom/graph/model.h"

#include <string>
#include <vector>

namespace rayloom
{

/// Reads a condition. `where` is the position of its first character; `exact` says that the text
/// stands in the file as it is given here, so that positions inside it can be told. Adds the first
/// mistake to `problems` and returns nothing when there is one.
std::optional<Expression> parse_expression(const std::string& text, const SourcePosition& where,
                                           bool exact, std::vector<Problem>& problems);

/// Checks the types of a condition against the graph's parameters: comparisons are between like
/// things, `and`, `or`, `not` and the whole are true or false. Parameters the graph does not have
/// are reported too; references are not looked at.
void check_expression(const Expression& expression, const Graph& graph,
                      std::vector<Problem>& problems);

/// What a condition can ask. Given by the planner.
class ExpressionScope
{
public:
    virtual ~ExpressionScope() = default;
    virtual ParamValue param(const std::string& name) const = 0;
    /// Whether the stream is there (an optional input may be absent).
    virtual bool has(const StreamReference& stream) const = 0;
    /// Elements of the stream: 1 for an image, 0 when absent.
    virtual std::size_t count(const StreamReference& stream) const = 0;
    /// Channels of the stream's first image, 0 when absent.
    virtual std::size_t channels(const StreamReference& stream) const = 0;
    /// Whether every pixel is known to be zero; false when absent or not known.
    virtual bool black(const StreamReference& stream) const = 0;
};

/// The value of a checked condition. `and` and `or` stop at the first operand that decides.
bool evaluate(const Expression& expression, const ExpressionScope& scope);

/// Every reference in a condition.
std::vector<StreamReference> references(const Expression& expression);
/// Names of every parameter in a condition.
std::vector<std::string> parameters(const Expression& expression);

/// The condition as a graph file would write it.
std::string expression_text(const Expression& expression);

} // namespace rayloom
