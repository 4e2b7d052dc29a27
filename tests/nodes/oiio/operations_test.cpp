// SPDX-License-Identifier: Apache-2.0
/// \file
/// Every entry of the oiio.* table against the oiiotool command on the same files, and in odd tiles
/// against the whole image.
#include "tests/nodes/oiio/oiiotool.h"
#include "tests/support/folders.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>

namespace rayloom::node_test
{
namespace
{

using Reals = std::vector<double>;
using Texts = std::vector<std::string>;

/// One use of one node. Inputs name images of test_images().
struct Case {
    std::string name;
    std::string op;
    ParamValues params;
    std::map<std::string, std::string> inputs;
    std::string command;    ///< for oiiotool
    float tolerance = 0.0f; ///< 0: the same bits
};

std::ostream& operator<<(std::ostream& out, const Case& c) { return out << c.name; }

TestImagePtr holed_image()
{
    auto image = std::make_shared<TestImage>();
    const TestImagePtr sound = random_image({-3, 2, 40, 31}, {0, 0, 48, 32}, {"R", "G", "B"}, 9);
    image->desc = sound->desc;
    image->pixels = ImageBuffer(sound->desc.data, 3);
    copy_pixels(sound->pixels.view(), image->pixels.view());
    const float nan = std::numeric_limits<float>::quiet_NaN();
    const float inf = std::numeric_limits<float>::infinity();
    // None of these touch: see the node's documentation.
    image->pixels.view().at(0, -3, 2) = nan;
    image->pixels.view().at(1, 10, 10) = inf;
    image->pixels.view().at(2, 10, 10) = nan;
    image->pixels.view().at(0, 39, 30) = -inf;
    image->pixels.view().at(1, 20, 15) = nan;
    return image;
}

/// With an alpha that is no share of a pixel.
TestImagePtr loose_image()
{
    auto image = std::make_shared<TestImage>();
    const Region window{0, 0, 31, 23};
    const TestImagePtr sound = random_image(window, window, {"R", "G", "B", "A"}, 17);
    image->desc = sound->desc;
    image->pixels = ImageBuffer(window, 4);
    copy_pixels(sound->pixels.view(), image->pixels.view());
    for (int y = 0; y < window.y1; ++y)
        for (float& alpha : image->pixels.view().row_span(3, y)) alpha = 3.0f * alpha - 1.0f;
    return image;
}

const std::map<std::string, TestImagePtr>& test_images()
{
    static const std::map<std::string, TestImagePtr> images = [] {
        std::map<std::string, TestImagePtr> m;
        const Texts rgba = {"R", "G", "B", "A"};
        // Overscan with a negative origin, a window in a corner, and one that fits.
        m["over"] = random_image({-7, -5, 54, 38}, {0, 0, 47, 33}, rgba, 1);
        m["part"] = random_image({11, 4, 44, 40}, {0, 0, 61, 45}, rgba, 2);
        m["flat"] = random_image({0, 0, 61, 43}, {0, 0, 61, 43}, {"R", "G", "B"}, 3);
        m["other"] = random_image({0, 0, 61, 43}, {0, 0, 61, 43}, {"R", "G", "B"}, 4);
        m["grey"] = random_image({0, 0, 33, 21}, {0, 0, 33, 21}, {"Y"}, 5);
        m["far"] = random_image({-60, -20, -31, 2}, {-64, -32, 0, 0}, rgba, 6);
        m["holed"] = holed_image();
        m["weights"] = random_image({-2, -1, 3, 2}, {-2, -1, 3, 2}, {"Y"}, 7);
        m["one"] = random_image({5, 5, 6, 6}, {0, 0, 9, 9}, rgba, 8);
        m["deepest"] = random_image({-3, 0, 30, 19}, {0, 0, 30, 19}, {"R", "G", "B", "A", "Z"}, 10);
        m["nearest"] = random_image({4, -2, 33, 15}, {0, 0, 30, 19}, {"R", "G", "B", "A", "Z"}, 11);
        // Colour that does not stand first, and channels that are none by name.
        m["mixed"] = random_image({0, 0, 29, 17}, {0, 0, 29, 17}, {"A", "Z", "B", "G", "R"}, 12);
        m["unnamed"] = random_image({0, 0, 29, 17}, {0, 0, 29, 17}, {"p", "q", "s", "t", "u"}, 13);
        m["three"] = random_image({2, -3, 50, 30}, {0, 0, 47, 33}, {"U", "V", "W"}, 14);
        m["loose"] = loose_image();
        m["each"] = random_image({-1, -2, 2, 3}, {-1, -2, 2, 3}, rgba, 15);
        return m;
    }();
    return images;
}

const std::string ocio = test::source_folder().string() + "/tests/data/ocio/config.ocio";

std::vector<Case> cases()
{
    std::vector<Case> c;
    using In = std::map<std::string, std::string>;
    const In over = {{"image", "over"}}, part = {{"image", "part"}}, flat = {{"image", "flat"}};
    const auto inputs = [](const char* a, const char* port, const char* b) {
        return In{{"image", a}, {port, b}};
    };

    for (const std::string op : {"add", "sub", "mul", "div", "absdiff", "min", "max"}) {
        c.push_back({op + "_images",
                     "oiio." + op,
                     {},
                     inputs("flat", "other", "other"),
                     "%flat %other --" + op});
        c.push_back({op + "_windows",
                     "oiio." + op,
                     {},
                     inputs("over", "other", "part"),
                     "%over %part --" + op});
        c.push_back({op + "_constant",
                     "oiio." + op,
                     {{"value", Reals{0.3}}},
                     over,
                     "%over --" + op + "c 0.3"});
        c.push_back({op + "_constants",
                     "oiio." + op,
                     {{"value", Reals{0.5, -2, 1e-3, 1}}},
                     part,
                     "%part --" + op + "c 0.5,-2,0.001,1"});
    }
    c.push_back({"div_zero",
                 "oiio.div",
                 {{"value", Reals{0, 2, -0.0, 1}}},
                 over,
                 "%over --divc 0,2,-0.0,1"});
    c.push_back({"mad_images",
                 "oiio.mad",
                 {},
                 {{"image", "over"}, {"multiplier", "part"}, {"addend", "far"}},
                 "%over %part %far --mad"});
    c.push_back({"mad_same",
                 "oiio.mad",
                 {},
                 {{"image", "flat"}, {"multiplier", "other"}, {"addend", "flat"}},
                 "%flat %other %flat --mad"});
    c.push_back({"pow", "oiio.pow", {{"value", Reals{0.4545}}}, flat, "%flat --powc 0.4545"});
    c.push_back({"pow_each",
                 "oiio.pow",
                 {{"value", Reals{2, 2.2, -1, 1}}},
                 over,
                 "%over --powc 2,2.2,-1,1"});
    c.push_back({"abs", "oiio.abs", {}, over, "%over --abs"});
    c.push_back({"invert", "oiio.invert", {}, over, "%over --invert"});
    c.push_back({"clamp",
                 "oiio.clamp",
                 {{"min", Reals{0}}, {"max", Reals{1}}},
                 over,
                 "%over --clamp:min=0:max=1"});
    c.push_back({"clamp_each",
                 "oiio.clamp",
                 {{"min", Reals{0.1, 0.2, 0.3, 0}}, {"clampalpha", true}},
                 part,
                 "%part --clamp:min=0.1,0.2,0.3,0:clampalpha=1"});
    c.push_back({"clamp_nan",
                 "oiio.clamp",
                 {{"min", Reals{0}}, {"max", Reals{2}}},
                 {{"image", "holed"}},
                 "%holed --clamp:min=0:max=2"});
    c.push_back({"over", "oiio.over", {}, inputs("over", "under", "part"), "%over %part --over"});
    c.push_back({"over_far", "oiio.over", {}, inputs("far", "under", "part"), "%far %part --over"});
    c.push_back(
        {"over_loose", "oiio.over", {}, inputs("loose", "under", "part"), "%loose %part --over"});
    c.push_back({"clamp_alpha",
                 "oiio.clamp",
                 {{"clampalpha", true}},
                 {{"image", "loose"}},
                 "%loose --clamp:clampalpha=1"});
    c.push_back({"over_depth",
                 "oiio.over",
                 {},
                 inputs("deepest", "under", "nearest"),
                 "%deepest %nearest --over"});
    for (const std::string op : {"premult", "repremult", "unpremult"})
        c.push_back({op + "_depth", "oiio." + op, {}, {{"image", "deepest"}}, "%deepest --" + op});
    c.push_back({"premult", "oiio.premult", {}, over, "%over --premult"});
    c.push_back({"repremult", "oiio.repremult", {}, over, "%over --repremult"});
    c.push_back({"unpremult", "oiio.unpremult", {}, over, "%over --unpremult"});
    c.push_back({"unpremult_no_alpha", "oiio.unpremult", {}, flat, "%flat --unpremult"});

    c.push_back({"channels",
                 "oiio.channels",
                 {{"channels", Texts{"B", "A", "Y=R", "Z=0.5"}}},
                 over,
                 "%over --ch B,A,Y=R,Z=0.5"});
    c.push_back({"channels_swapped",
                 "oiio.channels",
                 {{"channels", Texts{"R=G", "G=R", "B", "A"}}},
                 over,
                 "%over --ch R=G,G=R,B,A"});
    c.push_back({"channel_append_several",
                 "oiio.channel_append",
                 {},
                 inputs("over", "other", "three"),
                 "%over %three --chappend"});
    c.push_back({"channel_append",
                 "oiio.channel_append",
                 {},
                 inputs("over", "other", "grey"),
                 "%over %grey --chappend"});

    const auto window = [](int x, int y, int w, int h) {
        return ParamValues{{"x", std::int64_t{x}},
                           {"y", std::int64_t{y}},
                           {"width", std::int64_t{w}},
                           {"height", std::int64_t{h}}};
    };
    c.push_back({"crop_inside", "oiio.crop", window(3, 5, 20, 11), over, "%over --crop 20x11+3+5"});
    c.push_back(
        {"crop_wider", "oiio.crop", window(-20, -9, 91, 70), part, "%part --crop 91x70-20-9"});
    c.push_back({"cut", "oiio.cut", window(-4, -5, 31, 22), over, "%over --cut 31x22-4-5"});
    c.push_back({"cut_wider", "oiio.cut", window(0, 0, 61, 45), part, "%part --cut 61x45+0+0"});
    for (const std::string op : {"flip", "flop", "rotate90", "rotate180", "rotate270", "transpose"})
        for (const std::string image : {"over", "part", "grey", "one"})
            c.push_back(
                {op + "_" + image, "oiio." + op, {}, {{"image", image}}, "%" + image + " --" + op});

    const auto number = [](int n) { return ParamValue(std::int64_t{n}); };
    for (const std::string image : {"over", "part", "flat", "one"}) {
        const In in = {{"image", image}};
        const std::string i = "%" + image;
        c.push_back({"blur_" + image, "oiio.blur", {{"width", 5.0}}, in, i + " --blur 5x5"});
        c.push_back({"blur_wide_" + image,
                     "oiio.blur",
                     {{"width", 9.0}, {"height", 3.0}, {"kernel", std::string("box")}},
                     in,
                     i + " --blur:kernel=box 9x3"});
        c.push_back({"convolve_" + image,
                     "oiio.convolve",
                     {},
                     {{"image", image}, {"kernel", "weights"}},
                     i + " %weights --convolve"});
        c.push_back({"median_" + image, "oiio.median", {}, in, i + " --median 3x3"});
        c.push_back({"median_wide_" + image,
                     "oiio.median",
                     {{"width", number(7)}, {"height", number(4)}},
                     in,
                     i + " --median 7x4"});
        c.push_back(
            {"dilate_" + image, "oiio.dilate", {{"width", number(5)}}, in, i + " --dilate 5x5"});
        c.push_back(
            {"erode_" + image, "oiio.erode", {{"width", number(3)}}, in, i + " --erode 3x3"});
        c.push_back({"unsharp_" + image,
                     "oiio.unsharp",
                     {{"width", 5.0}, {"contrast", 1.5}, {"threshold", 0.25}},
                     in,
                     i + " --unsharp:kernel=gaussian:width=5:contrast=1.5:threshold=0.25"});
        c.push_back({"unsharp_median_" + image,
                     "oiio.unsharp",
                     {{"kernel", std::string("median")}},
                     in,
                     i + " --unsharp:kernel=median"});
        c.push_back(
            {"resize_half_" + image, "oiio.resize", {{"ratio", 0.5}}, in, i + " --resize 50%"});
        c.push_back({"resize_up_" + image,
                     "oiio.resize",
                     {{"width", number(97)}, {"height", number(53)}},
                     in,
                     i + " --resize 97x53"});
        c.push_back(
            {"resize_mixed_" + image,
             "oiio.resize",
             {{"width", number(19)}, {"height", number(80)}, {"filter", std::string("mitchell")}},
             in,
             i + " --resize:filter=mitchell 19x80"});
        c.push_back({"resize_radial_" + image,
                     "oiio.resize",
                     {{"ratio", 0.5}, {"filter", std::string("radial-lanczos3")}},
                     in,
                     i + " --resize:filter=radial-lanczos3 50%"});
        c.push_back({"rotate_" + image, "oiio.rotate", {{"angle", 33.0}}, in, i + " --rotate 33"});
        c.push_back(
            {"rotate_center_" + image,
             "oiio.rotate",
             {{"angle", -100.0}, {"center", Reals{10, 8}}, {"filter", std::string("triangle")}},
             in,
             i + " --rotate:center=10,8:filter=triangle -100"});
    }

    const std::string config = " --colorconfig " + ocio + " ";
    for (const std::string image : {"over", "flat"}) {
        const In in = {{"image", image}};
        const std::string i = "%" + image;
        for (const bool divided : {false, true}) {
            const std::string unpremult = divided ? ":unpremult=1" : "";
            const std::string suffix = (divided ? "_unpremult_" : "_") + image;
            const ParamValue flag = divided;
            c.push_back({"to_srgb" + suffix,
                         "oiio.colorconvert",
                         {{"from", std::string("linear")},
                          {"to", std::string("sRGB")},
                          {"unpremult", flag}},
                         in,
                         i + " --colorconvert" + unpremult + " linear sRGB"});
            c.push_back({"from_srgb" + suffix,
                         "oiio.colorconvert",
                         {{"from", std::string("sRGB")},
                          {"to", std::string("linear")},
                          {"unpremult", flag}},
                         in,
                         i + " --colorconvert" + unpremult + " sRGB linear"});
            c.push_back({"config" + suffix,
                         "oiio.colorconvert",
                         {{"from", std::string("lin_wide")},
                          {"to", std::string("srgb")},
                          {"config", ocio},
                          {"unpremult", flag}},
                         in,
                         i + config + "--colorconvert" + unpremult + " lin_wide srgb"});
            c.push_back(
                {"display" + suffix,
                 "oiio.ociodisplay",
                 {{"config", ocio},
                  {"display", std::string("screen")},
                  {"view", std::string("film")},
                  {"unpremult", flag}},
                 in,
                 i + config + "--ociodisplay:from=scene_linear" + unpremult + " screen film"});
            c.push_back({"look" + suffix,
                         "oiio.ociolook",
                         {{"config", ocio}, {"looks", std::string("warm")}, {"unpremult", flag}},
                         in,
                         i + config + "--ociolook:from=scene_linear:to=scene_linear" + unpremult +
                             " warm"});
            c.push_back(
                {"file" + suffix,
                 "oiio.ociofiletransform",
                 {{"config", ocio}, {"file", std::string("grade.cube")}, {"unpremult", flag}},
                 in,
                 i + config + "--ociofiletransform" + unpremult + " grade.cube"});
        }
        c.push_back(
            {"saturate_" + image, "oiio.saturate", {{"scale", 0.4}}, in, i + " --saturate 0.4"});
        c.push_back({"contrast_" + image,
                     "oiio.contrast",
                     {{"black", Reals{0.1}}, {"white", Reals{0.75}}},
                     in,
                     i + " --contrast:black=0.1:white=0.75:clamp=0"});
        c.push_back({"contrast_curve_" + image,
                     "oiio.contrast",
                     {{"scontrast", Reals{5}}, {"sthresh", Reals{0.4}}},
                     in,
                     i + " --contrast:scontrast=5:sthresh=0.4:clamp=0"});
        c.push_back(
            {"rangecompress_" + image, "oiio.rangecompress", {}, in, i + " --rangecompress"});
        c.push_back({"rangeexpand_" + image,
                     "oiio.rangeexpand",
                     {{"luma", true}},
                     in,
                     i + " --rangeexpand:luma=1"});
    }
    c.push_back({"saturate_mixed",
                 "oiio.saturate",
                 {{"scale", 0.4}},
                 {{"image", "mixed"}},
                 "%mixed --saturate 0.4"});
    c.push_back({"look_inverse",
                 "oiio.ociolook",
                 {{"config", ocio}, {"looks", std::string("warm")}, {"inverse", true}},
                 flat,
                 "%flat" + config + "--ociolook:inverse=1:from=scene_linear:to=scene_linear warm"});
    c.push_back({"file_inverse",
                 "oiio.ociofiletransform",
                 {{"config", ocio}, {"file", std::string("grade.cube")}, {"inverse", true}},
                 flat,
                 "%flat" + config + "--ociofiletransform:inverse=1 grade.cube"});
    c.push_back({"contrast_range",
                 "oiio.contrast",
                 {{"black", Reals{0.1}}, {"min", Reals{0.2}}, {"max", Reals{0.7}}},
                 flat,
                 "%flat --contrast:black=0.1:min=0.2:max=0.7:clamp=0"});
    c.push_back({"color_map_channel",
                 "oiio.color_map",
                 {{"map", std::string("magma")}, {"channel", std::string("G")}},
                 flat,
                 "%flat --ch G --colormap magma"});
    for (const std::string image : {"flat", "grey"}) // oiiotool drops the display window here
        c.push_back({"color_map_" + image,
                     "oiio.color_map",
                     {{"map", std::string("turbo")}},
                     {{"image", image}},
                     "%" + image + " --colormap turbo"});
    c.push_back({"fixnan", "oiio.fixnan", {}, {{"image", "holed"}}, "%holed --fixnan box3", 1e-6f});
    c.push_back({"fixnan_black",
                 "oiio.fixnan",
                 {{"mode", std::string("black")}},
                 {{"image", "holed"}},
                 "%holed --fixnan black"});
    return c;
}

class OiioOperation : public testing::TestWithParam<Case>
{
protected:
    static TestInputs inputs()
    {
        TestInputs in;
        for (const auto& [port, image] : GetParam().inputs) in[port] = {test_images().at(image)};
        return in;
    }
};

TEST_P(OiioOperation, DoesWhatOiiotoolDoes)
{
    if (!have_oiiotool())
        GTEST_SKIP() << "there is no oiiotool command (package openimageio-tools)";
    const Case& c = GetParam();
    const NodeRun run = run_node(c.op, c.params, inputs());
    const TestImage& result = *run.outputs.at("image")[0];
    // Reading an EXR sorts its channels; the order is given back.
    const NodeRun expected = run_node("oiio.channels", {{"channels", result.desc.channels}},
                                      {{"image", {oiiotool(c.command, test_images())}}});
    EXPECT_EQ(expected.outputs.at("image")[0]->desc.channels.size(), result.desc.channels.size());
    EXPECT_EQ(difference(result, *expected.outputs.at("image")[0], c.tolerance), "");
}

TEST_P(OiioOperation, TilesEqualTheWhole)
{
    const Case& c = GetParam();
    const NodeRun whole = run_node(c.op, c.params, inputs());
    for (const auto& [width, height] : {std::pair{7, 5}, {64, 3}, {1, 64}, {16, 16}}) {
        const NodeRun tiled = run_node(c.op, c.params, inputs(), width, height);
        EXPECT_EQ(difference(*tiled.outputs.at("image")[0], *whole.outputs.at("image")[0]), "")
            << width << " x " << height;
        EXPECT_EQ(tiled.counts, whole.counts);
    }
}

/// What plan() calls untouched must be: the engine then never calls compute().
TEST_P(OiioOperation, DeclaredPassThroughIsExact)
{
    const Case& c = GetParam();
    const NodeRun run = run_node(c.op, c.params, inputs());
    const TestImage& result = *run.outputs.at("image")[0];
    for (const PlanResult::Alias& alias : run.plan.aliases)
        EXPECT_EQ(difference(result, *inputs().at(alias.input)[alias.input_element]), "");
    for (const PlanResult::ChannelAlias& alias : run.plan.channel_aliases) {
        const TestImage& in = *inputs().at(alias.input)[alias.input_element];
        ASSERT_EQ(in.desc.data, result.desc.data);
        for (int y = result.desc.data.y0; y < result.desc.data.y1; ++y)
            EXPECT_EQ(
                0, std::memcmp(result.pixels.view().row(alias.output_channel, y),
                               in.pixels.view().row(alias.input_channel, y),
                               static_cast<std::size_t>(result.desc.data.width()) * sizeof(float)));
    }
}

INSTANTIATE_TEST_SUITE_P(Table, OiioOperation, testing::ValuesIn(cases()),
                         [](const auto& use) { return use.param.name; });

TEST(OiioTable, EveryEntryIsCompared)
{
    std::set<std::string> tested;
    for (const Case& c : cases()) tested.insert(c.op);
    for (const std::string& name : Registry::instance().names())
        EXPECT_TRUE(!name.starts_with("oiio.") || tested.contains(name)) << name;
}

TEST(OiioTable, EveryEntryIsDocumented)
{
    for (const NodeInfo* info : Registry::instance().all()) {
        if (!info->name.starts_with("oiio.")) continue;
        EXPECT_FALSE(info->summary.empty()) << info->name;
        EXPECT_FALSE(info->doc.empty()) << info->name;
        EXPECT_FALSE(info->accuracy.empty()) << info->name;
        EXPECT_NE(info->example.find("op: " + info->name + ","), std::string::npos) << info->name;
        for (const PortInfo& port : info->inputs)
            EXPECT_FALSE(port.doc.empty()) << info->name << " " << port.name;
        for (const ParamInfo& param : info->params) {
            EXPECT_FALSE(param.doc.empty()) << info->name << " " << param.name;
            if (param.required) continue;
            EXPECT_NO_THROW(check_param(param, param.default_value))
                << info->name << " " << param.name;
        }
    }
}

// ------------------------------------------------------------- identities and errors of plan()

PlanResult plan_of(const char* op, const ParamValues& params, const char* image = "over")
{
    return run_node(op, params, {{"image", {test_images().at(image)}}}).plan;
}

TEST(OiioTable, NeutralParametersPassTheImageOn)
{
    EXPECT_EQ(plan_of("oiio.mul", {{"value", Reals{1}}}).aliases.size(), 1u);
    EXPECT_EQ(plan_of("oiio.div", {{"value", Reals{1}}}).aliases.size(), 1u);
    EXPECT_EQ(plan_of("oiio.mul", {{"value", Reals{1, 1, 1, 2}}}).aliases.size(), 0u);
    EXPECT_EQ(plan_of("oiio.sub", {{"value", Reals{0}}}).aliases.size(), 1u);
    EXPECT_EQ(plan_of("oiio.pow", {{"value", Reals{1}}}).aliases.size(), 1u);
    EXPECT_EQ(plan_of("oiio.channels", {{"channels", Texts{"R", "G", "B", "A"}}}).aliases.size(),
              1u);
    EXPECT_EQ(plan_of("oiio.resize", {{"ratio", 1.0}}).aliases.size(), 1u);
    EXPECT_EQ(plan_of("oiio.unpremult", {}, "flat").aliases.size(), 1u);
    EXPECT_EQ(plan_of("oiio.blur", {{"width", 1.0}, {"kernel", std::string("box")}}).aliases.size(),
              1u);
}

TEST(OiioTable, OneChannelServesForAll)
{
    const TestImagePtr image = test_images().at("flat");
    const TestImagePtr mask = random_image({0, 0, 61, 43}, {0, 0, 61, 43}, {"A"}, 11);
    const NodeRun run = run_node("oiio.mul", {}, {{"image", {image}}, {"other", {mask}}});
    for (int c = 0; c < 3; ++c)
        EXPECT_EQ(run.outputs.at("image")[0]->pixels.view().at(c, 17, 29),
                  image->pixels.view().at(c, 17, 29) * mask->pixels.view().at(0, 17, 29));
}

TEST(OiioTable, RotatesAroundADisplayWindowThatStartsAnywhere)
{
    const TestImagePtr image = random_image({8, -3, 29, 14}, {10, -2, 30, 12}, {"R", "G", "B"}, 12);
    TestImagePtr turned = image;
    for (int i = 0; i < 4; ++i)
        turned = run_node("oiio.rotate90", {}, {{"image", {turned}}}, 5, 3).outputs.at("image")[0];
    EXPECT_EQ(difference(*turned, *image), "");
    turned = run_node("oiio.rotate90", {}, {{"image", {image}}}).outputs.at("image")[0];
    EXPECT_EQ(turned->desc.display, (Region{10, -2, 24, 18}));
    turned = run_node("oiio.rotate270", {}, {{"image", {turned}}}).outputs.at("image")[0];
    EXPECT_EQ(difference(*turned, *image), "");
}

TEST(OiioTable, ResamplesFarFromTheOriginAsAtIt)
{
    const auto run = [](const char* op, const ParamValues& params, int x, int y, int tile_width) {
        const Region window{x, y, x + 40, y + 30};
        return run_node(op, params, {{"image", {random_image(window, window, {"R", "G"}, 12)}}},
                        tile_width, 9)
            .outputs.at("image")[0];
    };
    for (const auto& [op, params] :
         {std::pair<const char*, ParamValues>{"oiio.resize", {{"ratio", 0.7}}},
          {"oiio.rotate", {{"angle", 30.0}}}}) {
        const TestImagePtr here = run(op, params, 0, 0, 64),
                           there = run(op, params, 1 << 27, -(1 << 27), 5);
        for (int c = 0; c < 2; ++c)
            for (int y = 0; y < here->desc.data.y1; ++y)
                for (int x = 0; x < here->desc.data.x1; ++x)
                    ASSERT_EQ(there->pixels.view().at(c, (1 << 27) + x, y - (1 << 27)),
                              here->pixels.view().at(c, x, y))
                        << op << " " << x << "," << y;
    }
}

TEST(OiioTable, ColourIsFoundByNameAndTheRestStays)
{
    const ParamValues params = {
        {"from", std::string("linear")}, {"to", std::string("sRGB")}, {"unpremult", true}};
    const auto converted = [&](const TestImagePtr& image) {
        return run_node("oiio.colorconvert", params, {{"image", {image}}}).outputs.at("image")[0];
    };
    const auto picked = [](const TestImagePtr& image, const Texts& channels) {
        return run_node("oiio.channels", {{"channels", channels}}, {{"image", {image}}})
            .outputs.at("image")[0];
    };
    const TestImagePtr mixed = test_images().at("mixed");
    const Texts rgba = {"R", "G", "B", "A"};
    EXPECT_EQ(difference(*picked(converted(mixed), rgba), *converted(picked(mixed, rgba))), "");
    EXPECT_EQ(difference(*picked(converted(mixed), {"Z"}), *picked(mixed, {"Z"})), "");

    // Without names the first three are colour.
    const TestImagePtr unnamed = test_images().at("unnamed");
    const Texts first = {"R=p", "G=q", "B=s"}, rest = {"t", "u"};
    EXPECT_EQ(difference(*picked(converted(unnamed), first), *converted(picked(unnamed, first))),
              "");
    EXPECT_EQ(difference(*picked(converted(unnamed), rest), *picked(unnamed, rest)), "");
}

TEST(OiioTable, EachChannelHasItsOwnWeights)
{
    const TestImagePtr image = test_images().at("over"), weights = test_images().at("each");
    const ParamValues params = {{"normalize", false}};
    const TestImagePtr result =
        run_node("oiio.convolve", params, {{"image", {image}}, {"kernel", {weights}}})
            .outputs.at("image")[0];
    for (const std::string channel : {"R", "G", "B", "A"}) {
        const auto one = [&](const TestImagePtr& from) {
            return run_node("oiio.channels", {{"channels", Texts{channel}}}, {{"image", {from}}})
                .outputs.at("image")[0];
        };
        const NodeRun alone = run_node("oiio.convolve", params,
                                       {{"image", {one(image)}}, {"kernel", {one(weights)}}});
        EXPECT_EQ(difference(*one(result), *alone.outputs.at("image")[0]), "") << channel;
    }
}

TEST(OiioTable, RotatesAroundTheSamePlaceOfAnyWindow)
{
    const auto run = [](int x, int y) {
        const Region window{x, y, x + 40, y + 30};
        const Reals center{x + 9.0, y + 21.0};
        return run_node("oiio.rotate", {{"angle", 30.0}, {"center", center}},
                        {{"image", {random_image(window, window, {"R", "G"}, 12)}}})
            .outputs.at("image")[0];
    };
    const TestImagePtr here = run(0, 0), there = run(64, -128);
    for (int c = 0; c < 2; ++c)
        for (int y = 0; y < 30; ++y)
            for (int x = 0; x < 40; ++x)
                ASSERT_EQ(there->pixels.view().at(c, 64 + x, y - 128),
                          here->pixels.view().at(c, x, y))
                    << x << "," << y;
}

// Tiles that read so much that OpenImageIO gets them a few rows at a time.
TEST(OiioTable, WideWindowsTakeSeveralCallsATile)
{
    const Region window{0, 0, 300, 300};
    const TestInputs inputs = {{"image", {random_image(window, window, {"Y"}, 16)}}};
    const ParamValues params = {{"width", std::int64_t{61}}, {"height", std::int64_t{3}}};
    const NodeRun whole = run_node("oiio.dilate", params, inputs);
    const NodeRun tiled = run_node("oiio.dilate", params, inputs, 200, 290);
    EXPECT_EQ(difference(*tiled.outputs.at("image")[0], *whole.outputs.at("image")[0]), "");
}

TEST(OiioTable, KernelOfSigmaHasThatDeviation)
{
    auto dot = std::make_shared<TestImage>();
    dot->desc.data = dot->desc.display = {0, 0, 41, 41};
    dot->desc.channels = {"Y"};
    dot->pixels = ImageBuffer(dot->desc.data, 1);
    dot->pixels.fill(0.0f);
    dot->pixels.view().at(0, 20, 20) = 1.0f;
    const NodeRun run = run_node("oiio.blur", {{"sigma", 4.0}}, {{"image", {dot}}});
    const ConstImageView pixels = run.outputs.at("image")[0]->pixels.view();
    for (int d = 1; d < 8; ++d)
        EXPECT_NEAR(pixels.at(0, 20 + d, 20) / pixels.at(0, 20, 20), std::exp(-d * d / 32.0), 1e-4);
}

void expect_node_error(const char* op, const ParamValues& params, const TestInputs& inputs,
                       const char* text)
{
    try {
        run_node(op, params, inputs);
        ADD_FAILURE() << op << " should have failed with: " << text;
    } catch (const NodeError& error) {
        EXPECT_NE(std::string(error.what()).find(text), std::string::npos) << error.what();
    }
}

TEST(OiioTable, ErrorsSayWhatToDo)
{
    const TestInputs flat = {{"image", {test_images().at("flat")}}};
    const TestInputs mixed = {{"image", {test_images().at("flat")}},
                              {"other", {test_images().at("over")}}};
    expect_node_error("oiio.add", {}, flat, "there is neither");
    expect_node_error("oiio.add", {{"value", Reals{1}}}, mixed, "not both");
    expect_node_error("oiio.add", {}, mixed, "oiio.channels");
    expect_node_error("oiio.add", {{"value", Reals{1, 2}}}, flat, "one number for all");
    expect_node_error(
        "oiio.over", {},
        {{"image", {test_images().at("flat")}}, {"under", {test_images().at("over")}}},
        "no alpha channel");
    expect_node_error("oiio.clamp", {{"min", Reals{2}}, {"max", Reals{1}}}, flat, "above 'max'");
    expect_node_error("oiio.channels", {{"channels", Texts{"R", "Blue"}}}, flat, "'Blue'");
    expect_node_error("oiio.channels", {{"channels", Texts{"R", "R=G"}}}, flat, "given twice");
    expect_node_error("oiio.channel_append", {}, mixed, "prefix");
    expect_node_error("oiio.resize", {}, flat, "'ratio' or 'width'");
    expect_node_error("oiio.resize", {{"ratio", 0.5}, {"width", std::int64_t{5}}}, flat,
                      "'ratio' or 'width'");
    expect_node_error("oiio.resize",
                      {{"width", std::int64_t{20}},
                       {"height", std::int64_t{40}},
                       {"filter", std::string("radial-lanczos3")}},
                      flat, "not separable");
    expect_node_error("oiio.blur", {{"sigma", 2.0}, {"kernel", std::string("box")}}, flat,
                      "gaussian");
    expect_node_error("oiio.convolve", {{"named", std::string("gausian")}}, flat, "gausian");
    expect_node_error("oiio.convolve", {}, flat, "'kernel' or a kernel's name");
    expect_node_error("oiio.colorconvert",
                      {{"from", std::string("linear")}, {"to", std::string("sRBG")}}, flat, "sRGB");
    expect_node_error("oiio.colorconvert",
                      {{"from", std::string("linear")},
                       {"to", std::string("sRGB")},
                       {"config", std::string("/no/such/config.ocio")}},
                      flat, "/no/such/config.ocio");
    expect_node_error("oiio.ociodisplay", {}, flat, "config");
    expect_node_error("oiio.ociodisplay", {{"config", ocio}, {"view", std::string("flim")}}, flat,
                      "plain and film");
    expect_node_error("oiio.saturate", {{"scale", 0.5}}, {{"image", {test_images().at("grey")}}},
                      "three colour channels");
}

} // namespace
} // namespace rayloom::node_test
