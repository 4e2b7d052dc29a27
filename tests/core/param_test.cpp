// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/error.h"
#include "rayloom/core/param.h"
#include "rayloom/core/table.h"
#include "rayloom/core/text.h"

#include <gtest/gtest.h>

#include <cmath>

namespace rayloom
{
namespace
{

ParamInfo real_param()
{
    ParamInfo p;
    p.name = "kappa";
    p.type = ParamType::real;
    p.min = 0.0;
    p.max = 4.0;
    return p;
}

std::string error_of(const ParamInfo& p, const ParamValue& v)
{
    try {
        check_param(p, v);
    } catch (const NodeError& e) {
        return e.what();
    }
    return "no error";
}

TEST(Param, IntegersServeAsRealsNotTheOtherWayRound)
{
    EXPECT_EQ(check_param(real_param(), std::int64_t{2}), ParamValue(2.0));
    ParamInfo scales = real_param();
    scales.name = "scales";
    scales.type = ParamType::integer;
    EXPECT_EQ(error_of(scales, 2.5),
              "parameter 'scales' wants a value of type int, not a number (2.5)");
}

TEST(Param, RangeNamesWhatIsAllowed)
{
    EXPECT_EQ(error_of(real_param(), -0.5), "parameter 'kappa' must be from 0 to 4, not -0.5");
    EXPECT_EQ(error_of(real_param(), std::nan("")),
              "parameter 'kappa' must be from 0 to 4, not nan");
    ParamInfo open = real_param();
    open.max.reset();
    EXPECT_EQ(error_of(open, -1.0), "parameter 'kappa' must be at least 0, not -1");
}

TEST(Param, ChoiceSuggests)
{
    ParamInfo gate;
    gate.name = "gate";
    gate.type = ParamType::choice;
    gate.choices = {"one-sample", "two-sample", "none"};
    EXPECT_EQ(error_of(gate, std::string("twosample")),
              "parameter 'gate' cannot be 'twosample'; did you mean 'two-sample'?");
    EXPECT_EQ(error_of(gate, std::string("welch")),
              "parameter 'gate' cannot be 'welch'; there is: one-sample, two-sample and none");
}

TEST(Param, ListsTakeSingles)
{
    ParamInfo list = real_param();
    list.type = ParamType::reals;
    EXPECT_EQ(check_param(list, 1.5), ParamValue(std::vector<double>{1.5}));
    EXPECT_EQ(parse_param(list, "1,.25"), ParamValue(std::vector<double>{1.0, 0.25}));
    EXPECT_THROW(parse_param(list, "1,x"), NodeError);
    EXPECT_THROW(parse_param(list, "1,9"), NodeError);
}

TEST(Table, JsonAndNumbers)
{
    Table t;
    t.set("k", 0.1);
    t.set("what", std::string("a \"b\"\n"));
    t.set("bad", std::nan(""));
    EXPECT_EQ(t.json(), R"({"k": 0.1, "what": "a \"b\"\n", "bad": null})");
    EXPECT_EQ(t.number("k"), 0.1);
    EXPECT_THROW(t.number("kk"), InputError);
    EXPECT_THROW(t.number("what"), InputError);
}

TEST(Text, BytesRoundTripThroughUnits)
{
    EXPECT_EQ(parse_bytes("2G"), 2'000'000'000u);
    EXPECT_EQ(parse_bytes("1.5MB"), 1'500'000u);
    EXPECT_EQ(parse_bytes("300"), 300u);
    for (const char* bad :
         {"", "G", "-1G", "2X", "0", "1GG", "0.4", "9e99T", "9300000T", "inf", "nan"})
        EXPECT_THROW(parse_bytes(bad), UsageError) << bad;
    EXPECT_EQ(format_bytes(2'000'000'000u), "2.0 GB");
}

} // namespace
} // namespace rayloom
