// SPDX-License-Identifier: Apache-2.0
#include "rayloom/graph/expression.h"

#include <gtest/gtest.h>

#include <map>
#include <stdexcept>

namespace rayloom
{
namespace
{

/// Two streams: `color`, a list of three images of four channels, and `dark`, one black image.
class Facts final : public ExpressionScope
{
public:
    ParamValue param(const std::string& name) const override { return m_params.at(name); }
    bool has(const StreamReference& s) const override
    {
        return s.node == "color" || s.node == "dark";
    }
    std::size_t count(const StreamReference& s) const override
    {
        return s.node == "color" ? 3 : s.node == "dark" ? 1 : 0;
    }
    std::size_t channels(const StreamReference& s) const override
    {
        if (!has(s)) throw std::logic_error("asked for the channels of what is not there");
        return 4;
    }
    bool black(const StreamReference& s) const override { return s.node == "dark"; }

private:
    std::map<std::string, ParamValue> m_params{
        {"on", true}, {"three", std::int64_t{3}}, {"half", 0.5}, {"mode", std::string("fast")}};
};

Expression parse(const std::string& text)
{
    std::vector<Problem> problems;
    auto out = parse_expression(text, {"g.yaml", 1, 1}, true, problems);
    if (!out) throw std::runtime_error(problems.at(0).text());
    return *out;
}

bool holds(const std::string& text) { return evaluate(parse(text), Facts()); }

TEST(Expression, Evaluates)
{
    EXPECT_TRUE(holds("true"));
    EXPECT_FALSE(holds("false"));
    EXPECT_TRUE(holds("$on"));
    EXPECT_FALSE(holds("not $on"));
    EXPECT_TRUE(holds("not not $on"));
    EXPECT_TRUE(holds("has(color)"));
    EXPECT_FALSE(holds("has( albedo )"));
    EXPECT_TRUE(holds("black(dark) and not black(color)"));
    EXPECT_TRUE(holds("count(color) == 3"));
    EXPECT_TRUE(holds("count(color) == $three"));
    EXPECT_TRUE(holds("count(albedo) == 0"));
    EXPECT_TRUE(holds("channels(color)>=4"));
    EXPECT_FALSE(holds("channels(color) > 4"));
    EXPECT_TRUE(holds("channels(color) <= 4.0"));
    EXPECT_TRUE(holds("$half < 1"));
    EXPECT_TRUE(holds("$half == 5e-1"));
    EXPECT_TRUE(holds("-1 < -0.5"));
    EXPECT_TRUE(holds("$mode == 'fast'"));
    EXPECT_TRUE(holds("\"slow\" != $mode"));
    EXPECT_TRUE(holds("$on == true"));
    EXPECT_TRUE(holds("$on != false"));
}

TEST(Expression, BindsNotThenAndThenOr)
{
    EXPECT_TRUE(holds("true or true and false"));
    EXPECT_FALSE(holds("(true or true) and false"));
    EXPECT_TRUE(holds("not false or true"));
    EXPECT_FALSE(holds("not (false or true)"));
    EXPECT_FALSE(holds("not true and false"));
    EXPECT_FALSE(holds("not 1 == 1"));
    EXPECT_FALSE(holds("false and false or false"));
}

TEST(Expression, StopsAtWhatDecides)
{
    EXPECT_FALSE(holds("has(albedo) and channels(albedo) > 3"));
    EXPECT_TRUE(holds("not has(albedo) or channels(albedo) > 3"));
    EXPECT_THROW(holds("channels(albedo) > 3"), std::logic_error);
}

TEST(Expression, TextReadsBackAsTheSame)
{
    for (const char* text :
         {"has(color) and not black(levels[1]) or $mode == 'fast'", "(true or $on) and false",
          "not (true and false)", "$a == ($b == $c)", "($a < 1) == ($b > 2)",
          "true and (false and true)", "$text == \"it's\"", "channels(lobes.radiance[2]) >= 3",
          "not not true", "-0.5 < $half"}) {
        SCOPED_TRACE(text);
        EXPECT_EQ(expression_text(parse(text)), text);
    }
    EXPECT_EQ(expression_text(parse("((has(color)))  and(true)")), "has(color) and true");
}

TEST(Expression, NamesWhatItUses)
{
    const Expression e = parse("has(a.b[1]) and ($x == 1 or not black(c)) and $y");
    const auto streams = references(e);
    ASSERT_EQ(streams.size(), 2u);
    EXPECT_EQ(streams[0].node, "a");
    EXPECT_EQ(streams[0].port, "b");
    EXPECT_EQ(streams[0].index, 1);
    EXPECT_EQ(streams[1].node, "c");
    EXPECT_EQ(parameters(e), (std::vector<std::string>{"x", "y"}));
}

TEST(Expression, TellsWhereTheMistakeIs)
{
    std::vector<Problem> problems;
    EXPECT_FALSE(parse_expression("has(color) and ]", {"g.yaml", 7, 11}, true, problems));
    ASSERT_EQ(problems.size(), 1u);
    EXPECT_EQ(problems[0].text(), "g.yaml:7:26: ']' is not expected here");
    // A folded text does not stand in the file as it reads, so its beginning is all that is known.
    EXPECT_FALSE(parse_expression("has(color) and ]", {"g.yaml", 7, 11}, false, problems));
    EXPECT_EQ(problems[1].where.column, 11);
}

TEST(Expression, BoundsNestingAndLength)
{
    EXPECT_THROW(parse(std::string(100'000, '(')), std::runtime_error);
    std::string nots;
    for (int i = 0; i < 100'000; ++i) nots += "not ";
    EXPECT_THROW(parse(nots + "true"), std::runtime_error);
    std::string chain = "true";
    for (int i = 0; i < 100'000; ++i) chain += " and true";
    EXPECT_THROW(parse(chain), std::runtime_error);
}

} // namespace
} // namespace rayloom
