// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/expression.h"

#include "rayloom/core/text.h"
#include "rayloom/graph/names.h"

#include <algorithm>
#include <utility>

namespace rayloom
{

namespace
{

const std::vector<std::string> function_names{"has", "count", "channels", "black"};
constexpr int max_expression_depth = 64;

/// A syntax error; there is one a condition, because nothing after it can be trusted.
struct SyntaxError {
    std::size_t offset;
    std::string message;
};

bool is_space(char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; }
bool is_name_start(char c) { return is_graph_name(std::string_view(&c, 1)); }
bool is_name_char(char c) { return is_name_start(c) || c == '-' || (c >= '0' && c <= '9'); }

class Parser
{
public:
    Parser(const std::string& text, const SourcePosition& where, bool exact)
        : m_text(text), m_where(where), m_exact(exact)
    {
    }

    Expression parse()
    {
        Expression out = parse_or();
        skip_space();
        if (m_at < m_text.size()) fail("'" + next_word() + "' is not expected here");
        return out;
    }

    SourcePosition position(std::size_t offset) const
    {
        SourcePosition out = m_where;
        if (m_exact) {
            // Columns count characters, not bytes.
            for (std::size_t i = 0; i < offset; ++i)
                if ((static_cast<unsigned char>(m_text[i]) & 0xc0) != 0x80) ++out.column;
        }
        return out;
    }

private:
    [[noreturn]] void fail(std::string message) const
    {
        throw SyntaxError{m_at, std::move(message)};
    }
    [[noreturn]] void fail_at(std::size_t offset, std::string message) const
    {
        throw SyntaxError{offset, std::move(message)};
    }

    void skip_space()
    {
        while (m_at < m_text.size() && is_space(m_text[m_at])) ++m_at;
    }

    /// The word or sign that begins here, for messages.
    std::string next_word() const
    {
        std::size_t end = m_at;
        while (end < m_text.size() && is_name_char(m_text[end])) ++end;
        if (end == m_at) {
            ++end;
            while (end < m_text.size() && (static_cast<unsigned char>(m_text[end]) & 0xc0) == 0x80)
                ++end;
        }
        return m_text.substr(m_at, end - m_at);
    }

    std::string read_name()
    {
        const std::size_t start = m_at;
        if (m_at < m_text.size() && is_name_start(m_text[m_at]))
            while (m_at < m_text.size() && is_name_char(m_text[m_at])) ++m_at;
        return m_text.substr(start, m_at - start);
    }

    bool accept_word(std::string_view word)
    {
        skip_space();
        const std::size_t start = m_at;
        if (read_name() == word) return true;
        m_at = start;
        return false;
    }

    bool accept(std::string_view sign)
    {
        skip_space();
        if (!std::string_view(m_text).substr(m_at).starts_with(sign)) return false;
        m_at += sign.size();
        return true;
    }

    Expression binary(std::string op, std::size_t offset, Expression left, Expression right) const
    {
        Expression out;
        out.kind = Expression::Kind::binary;
        out.name = std::move(op);
        out.where = position(offset);
        out.operands.push_back(std::move(left));
        out.operands.push_back(std::move(right));
        return out;
    }

    Expression parse_or()
    {
        if (++m_depth > max_expression_depth) fail("the condition is nested too deep");
        Expression left = parse_and();
        for (skip_space();; skip_space()) {
            const std::size_t offset = m_at;
            if (accept("||")) fail_at(offset, "write 'or' for '||'");
            if (!accept_word("or")) break;
            count_operator();
            left = binary("or", offset, std::move(left), parse_and());
        }
        --m_depth;
        return left;
    }

    Expression parse_and()
    {
        Expression left = parse_not();
        for (skip_space();; skip_space()) {
            const std::size_t offset = m_at;
            if (accept("&&")) fail_at(offset, "write 'and' for '&&'");
            if (!accept_word("and")) break;
            count_operator();
            left = binary("and", offset, std::move(left), parse_not());
        }
        return left;
    }

    /// A chain of operators is a tree as deep as it is long.
    void count_operator()
    {
        if (++m_operators > 1000) fail("the condition is longer than any condition should be");
    }

    Expression parse_not()
    {
        skip_space();
        const std::size_t offset = m_at;
        if (m_at < m_text.size() && m_text[m_at] == '!') fail("write 'not' for '!'");
        if (!accept_word("not")) return parse_comparison();
        if (++m_depth > max_expression_depth) fail("the condition is nested too deep");
        Expression out;
        out.kind = Expression::Kind::unary_not;
        out.name = "not";
        out.where = position(offset);
        out.operands.push_back(parse_not());
        --m_depth;
        return out;
    }

    std::string accept_comparison()
    {
        for (const char* sign : {"==", "!=", "<=", ">=", "<", ">"})
            if (accept(sign)) return sign;
        if (m_at < m_text.size() && m_text[m_at] == '=') fail("write '==' to compare");
        return "";
    }

    Expression parse_comparison()
    {
        Expression left = parse_operand();
        skip_space();
        const std::size_t offset = m_at;
        const std::string sign = accept_comparison();
        if (sign.empty()) return left;
        Expression out = binary(sign, offset, std::move(left), parse_operand());
        skip_space();
        const std::size_t second = m_at;
        if (!accept_comparison().empty())
            fail_at(second, "comparisons do not chain; join two with 'and'");
        return out;
    }

    Expression parse_operand()
    {
        skip_space();
        const std::size_t offset = m_at;
        if (m_at >= m_text.size())
            fail(m_text.find_first_not_of(" \t\r\n") == std::string::npos
                     ? "the condition is empty"
                     : "the condition ends too early");
        const char c = m_text[m_at];
        if (c == '(') {
            ++m_at;
            Expression inner = parse_or();
            if (!accept(")")) fail_at(offset, "this '(' has no ')'");
            return inner;
        }
        Expression out;
        out.where = position(offset);
        if (c == '$') {
            ++m_at;
            out.kind = Expression::Kind::param;
            out.name = read_name();
            if (out.name.empty()) fail_at(offset, "'$' wants the name of a parameter");
            return out;
        }
        if (c == '\'' || c == '"') {
            const std::size_t end = m_text.find(c, m_at + 1);
            if (end == std::string::npos) fail("this quote is not closed");
            out.literal = m_text.substr(m_at + 1, end - m_at - 1);
            m_at = end + 1;
            return out;
        }
        if (is_name_start(c)) return word(std::move(out), offset);
        const std::size_t start = m_at;
        while (m_at < m_text.size() && is_number_char(m_at, start)) ++m_at;
        const ParamValue number = plain_scalar(m_text.substr(start, m_at - start));
        if (m_at == start || std::holds_alternative<std::string>(number)) {
            m_at = start;
            fail("'" + next_word() + "' is not expected here");
        }
        out.literal = number;
        return out;
    }

    bool is_number_char(std::size_t at, std::size_t start) const
    {
        const char c = m_text[at];
        if ((c >= '0' && c <= '9') || c == '.' || c == 'e' || c == 'E') return true;
        return (c == '-' || c == '+') &&
               (at == start || m_text[at - 1] == 'e' || m_text[at - 1] == 'E');
    }

    Expression word(Expression out, std::size_t offset)
    {
        const std::string name = read_name();
        if (name == "true" || name == "false") {
            out.literal = name == "true";
            return out;
        }
        if (!accept("(")) {
            if (std::find(function_names.begin(), function_names.end(), name) !=
                function_names.end())
                fail_at(offset,
                        "'" + name + "' wants a stream in parentheses: " + name + "(color)");
            fail_at(offset, "'" + name + "' stands alone; write $" + name +
                                " for a parameter, has(" + name + ") for a stream, '" + name +
                                "' in quotes for text");
        }
        if (std::find(function_names.begin(), function_names.end(), name) == function_names.end())
            fail_at(offset,
                    "function '" + name + "' is not known" + suggestion(name, function_names));
        out.kind = Expression::Kind::call;
        out.name = name;
        skip_space();
        const std::size_t start = m_at;
        const std::size_t end = m_text.find_first_of(")(,", m_at);
        if (end == std::string::npos || m_text[end] == '(')
            fail_at(offset, "'" + name + "(' has no ')'");
        if (m_text[end] == ',') fail_at(end, "'" + name + "' takes one stream");
        std::size_t stop = end;
        while (stop > start && is_space(m_text[stop - 1])) --stop;
        const std::string text = m_text.substr(start, stop - start);
        if (text.empty()) fail_at(offset, "'" + name + "' wants a stream in parentheses");
        std::string reason;
        const auto stream = parse_stream_reference(text, position(start), reason);
        if (!stream) fail_at(start, "'" + text + "': " + reason);
        out.argument = *stream;
        m_at = end + 1;
        return out;
    }

    const std::string& m_text;
    SourcePosition m_where;
    bool m_exact;
    std::size_t m_at = 0;
    int m_depth = 0;
    int m_operators = 0;
};

enum class Type { boolean, number, text, list, unknown };

const char* type_name(Type type)
{
    switch (type) {
    case Type::boolean: return "true or false";
    case Type::number: return "a number";
    case Type::text: return "text";
    case Type::list: return "a list";
    case Type::unknown: break;
    }
    return "unknown";
}

Type type_of(const ParamInfo& info)
{
    switch (info.type) {
    case ParamType::boolean: return Type::boolean;
    case ParamType::integer:
    case ParamType::real: return Type::number;
    case ParamType::text:
    case ParamType::choice:
    case ParamType::path: return Type::text;
    case ParamType::reals:
    case ParamType::texts:
    case ParamType::paths: return Type::list;
    }
    return Type::unknown;
}

Type literal_type(const ParamValue& value)
{
    if (std::holds_alternative<bool>(value)) return Type::boolean;
    return std::holds_alternative<std::string>(value) ? Type::text : Type::number;
}

class Checker
{
public:
    Checker(const Graph& graph, std::vector<Problem>& problems)
        : m_graph(graph), m_problems(problems)
    {
    }

    void want_truth(const Expression& e, const std::string& where)
    {
        const Type type = check(e);
        if (type != Type::boolean && type != Type::unknown)
            m_problems.push_back({e.where, where + " wants true or false; '" + expression_text(e) +
                                               "' is " + type_name(type)});
    }

private:
    Type check(const Expression& e)
    {
        switch (e.kind) {
        case Expression::Kind::literal: return literal_type(e.literal);
        case Expression::Kind::call:
            return e.name == "has" || e.name == "black" ? Type::boolean : Type::number;
        case Expression::Kind::param: return check_param_name(e);
        case Expression::Kind::unary_not: want_truth(e.operands[0], "'not'"); return Type::boolean;
        case Expression::Kind::binary: break;
        }
        if (e.name == "and" || e.name == "or") {
            for (const Expression& operand : e.operands) want_truth(operand, "'" + e.name + "'");
            return Type::boolean;
        }
        check_comparison(e);
        return Type::boolean;
    }

    Type check_param_name(const Expression& e)
    {
        if (const GraphParam* param = m_graph.param(e.name)) return type_of(param->info);
        std::vector<std::string> names;
        for (const GraphParam& p : m_graph.params) names.push_back(p.info.name);
        m_problems.push_back({e.where, "parameter '$" + e.name + "' is not declared under params" +
                                           suggestion(e.name, names)});
        return Type::unknown;
    }

    void check_comparison(const Expression& e)
    {
        const Type left = check(e.operands[0]);
        const Type right = check(e.operands[1]);
        if (left == Type::unknown || right == Type::unknown) return;
        const bool ordered = e.name != "==" && e.name != "!=";
        if (left == Type::list || right == Type::list)
            m_problems.push_back({e.where, "lists cannot be compared"});
        else if (left != right)
            m_problems.push_back({e.where, "'" + e.name + "' compares " + type_name(left) +
                                               " with " + type_name(right)});
        else if (ordered && left != Type::number)
            m_problems.push_back(
                {e.where, "'" + e.name + "' compares numbers, not " + type_name(left)});
        else if (left == Type::text)
            check_choice(e);
    }

    /// A text a choice can never be, or a path that depends on where the graph lies, is a slip: the
    /// condition would silently never hold.
    void check_choice(const Expression& e)
    {
        for (int i = 0; i < 2; ++i) {
            const Expression& param = e.operands[static_cast<std::size_t>(i)];
            const Expression& literal = e.operands[static_cast<std::size_t>(1 - i)];
            if (param.kind != Expression::Kind::param || literal.kind != Expression::Kind::literal)
                continue;
            const ParamInfo& info = m_graph.param(param.name)->info;
            const std::string& text = std::get<std::string>(literal.literal);
            if (is_path(info.type) && !text.empty())
                m_problems.push_back(
                    {literal.where, "the path '$" + info.name + "' can only be compared with ''"});
            if (info.type == ParamType::choice &&
                std::find(info.choices.begin(), info.choices.end(), text) == info.choices.end())
                m_problems.push_back({literal.where, "parameter '" + info.name + "' cannot be '" +
                                                         text + "'" +
                                                         suggestion(text, info.choices)});
        }
    }

    const Graph& m_graph;
    std::vector<Problem>& m_problems;
};

ParamValue value_of(const Expression& e, const ExpressionScope& scope);

double number_of(const ParamValue& value)
{
    if (const auto* whole = std::get_if<std::int64_t>(&value)) return static_cast<double>(*whole);
    return std::get<double>(value);
}

bool is_number(const ParamValue& value)
{
    return std::holds_alternative<std::int64_t>(value) || std::holds_alternative<double>(value);
}

bool compare(const std::string& op, const ParamValue& left, const ParamValue& right)
{
    if (is_number(left) && is_number(right)) {
        const double a = number_of(left);
        const double b = number_of(right);
        if (op == "==") return a == b;
        if (op == "!=") return a != b;
        if (op == "<") return a < b;
        if (op == "<=") return a <= b;
        if (op == ">") return a > b;
        return a >= b;
    }
    return (op == "==") == (left == right);
}

ParamValue value_of(const Expression& e, const ExpressionScope& scope)
{
    switch (e.kind) {
    case Expression::Kind::literal: return e.literal;
    case Expression::Kind::param: return scope.param(e.name);
    case Expression::Kind::unary_not: return !evaluate(e.operands[0], scope);
    case Expression::Kind::call:
        if (e.name == "has") return scope.has(e.argument);
        if (e.name == "black") return scope.black(e.argument);
        return static_cast<std::int64_t>(e.name == "count" ? scope.count(e.argument)
                                                           : scope.channels(e.argument));
    case Expression::Kind::binary: break;
    }
    if (e.name == "and") return evaluate(e.operands[0], scope) && evaluate(e.operands[1], scope);
    if (e.name == "or") return evaluate(e.operands[0], scope) || evaluate(e.operands[1], scope);
    return compare(e.name, value_of(e.operands[0], scope), value_of(e.operands[1], scope));
}

int precedence(const Expression& e)
{
    if (e.kind == Expression::Kind::unary_not) return 3;
    if (e.kind != Expression::Kind::binary) return 5;
    if (e.name == "or") return 1;
    return e.name == "and" ? 2 : 4;
}

std::string operand_text(const Expression& operand, int parent)
{
    const std::string text = expression_text(operand);
    // Comparisons do not chain, so an equal precedence needs parentheses there too.
    const bool inside = precedence(operand) < parent || (parent == 4 && precedence(operand) == 4);
    return inside ? "(" + text + ")" : text;
}

} // namespace

std::optional<Expression> parse_expression(const std::string& text, const SourcePosition& where,
                                           bool exact, std::vector<Problem>& problems)
{
    Parser parser(text, where, exact);
    try {
        return parser.parse();
    } catch (const SyntaxError& error) {
        problems.push_back({parser.position(error.offset), error.message});
        return std::nullopt;
    }
}

void check_expression(const Expression& expression, const Graph& graph,
                      std::vector<Problem>& problems)
{
    Checker(graph, problems).want_truth(expression, "'when'");
}

bool evaluate(const Expression& expression, const ExpressionScope& scope)
{
    return std::get<bool>(value_of(expression, scope));
}

std::vector<StreamReference> references(const Expression& expression)
{
    std::vector<StreamReference> out;
    if (expression.kind == Expression::Kind::call) out.push_back(expression.argument);
    for (const Expression& operand : expression.operands)
        for (StreamReference& inner : references(operand)) out.push_back(std::move(inner));
    return out;
}

std::vector<std::string> parameters(const Expression& expression)
{
    std::vector<std::string> out;
    if (expression.kind == Expression::Kind::param) out.push_back(expression.name);
    for (const Expression& operand : expression.operands)
        for (std::string& inner : parameters(operand)) out.push_back(std::move(inner));
    return out;
}

std::string expression_text(const Expression& expression)
{
    switch (expression.kind) {
    case Expression::Kind::literal: {
        const auto* text = std::get_if<std::string>(&expression.literal);
        if (!text) return format_param(expression.literal);
        const char quote = text->find('\'') == std::string::npos ? '\'' : '"';
        return quote + *text + quote;
    }
    case Expression::Kind::param: return "$" + expression.name;
    case Expression::Kind::call:
        return expression.name + "(" + stream_text(expression.argument) + ")";
    case Expression::Kind::unary_not: return "not " + operand_text(expression.operands[0], 3);
    case Expression::Kind::binary: break;
    }
    const int level = precedence(expression);
    // Operators associate to the left, so a right operand of the same kind keeps its parentheses.
    return operand_text(expression.operands[0], level) + " " + expression.name + " " +
           operand_text(expression.operands[1], level == 4 ? level : level + 1);
}

} // namespace rayloom
