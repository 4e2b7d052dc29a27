// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/renderer_map.h"

#include "tests/image/image_files.h"
#include "tests/support/folders.h"

#include <algorithm>

namespace rayloom
{
namespace
{
using namespace test;

const std::string maps_folder = test::source_folder().string() + "/graphs/renderers";
const std::string cycles_file =
    test::source_folder().string() + "/tests/data/cycles/dof/noisy_16.exr";

std::vector<Channel> channels(const std::vector<std::string>& names)
{
    std::vector<Channel> out;
    for (const std::string& name : names) out.push_back({name, OIIO::TypeFloat});
    return out;
}

// Layer a role is resolved to in a file of these channels; "" for none.
std::string resolved(const std::vector<std::string>& names, const std::string& role,
                     std::string* renderer = nullptr)
{
    const TemporaryFolder folder;
    write_exr(folder.file("a.exr"), {{"", channels(names), 0, 0, 4, 4}});
    const auto file = ImageFile::open(folder.file("a.exr"));
    const auto maps = read_renderer_maps(maps_folder);
    const RendererMap& map = detect_renderer(maps, *file);
    if (renderer != nullptr) *renderer = map.name();
    const auto found = map.resolve(*file, role);
    return found ? found->layer + ":" + found->names.front() : "";
}

TEST(RendererMap, EveryShippedMapReads)
{
    const auto maps = read_renderer_maps(maps_folder);
    std::vector<std::string> names;
    for (const RendererMap& map : maps) {
        names.push_back(map.name());
        EXPECT_FALSE(map.doc().empty()) << map.name();
        EXPECT_NE(map.rule("beauty"), nullptr) << map.name();
    }
    for (const char* name : {"arnold", "cycles", "pbrt", "renderman", "vray", "generic"})
        EXPECT_NE(std::find(names.begin(), names.end(), name), names.end()) << name;
    EXPECT_TRUE(maps.back().is_fallback());
}

TEST(RendererMap, Cycles)
{
    const auto file = ImageFile::open(cycles_file);
    const auto maps = read_renderer_maps(maps_folder);
    const RendererMap& map = detect_renderer(maps, *file);
    EXPECT_EQ(map.name(), "cycles");
    EXPECT_EQ(map.resolve(*file, "beauty")->layer, "ViewLayer.Combined");
    EXPECT_EQ(map.resolve(*file, "albedo")->layer, "ViewLayer.Denoising Albedo");
    EXPECT_EQ(map.resolve(*file, "depth")->layer, "ViewLayer.Denoising Depth");
    EXPECT_EQ(map.resolve(*file, "glossy_indirect")->layer, "ViewLayer.GlossInd");
    EXPECT_FALSE(map.resolve(*file, "variance"));
    const std::string message = message_of([&] { default_layer(*file, "cryptomatte"); });
    EXPECT_NE(message.find("'Crypto*'"), std::string::npos) << message;
    EXPECT_NE(message.find("ViewLayer.DiffCol"), std::string::npos) << message;
    EXPECT_EQ(choose_channels(*file, {"", "", "", "RGB"}).names,
              (std::vector<std::string>{"R", "G", "B", "A"}));
    EXPECT_EQ(choose_channels(*file, {"", "", "normal", ""}).layer, "ViewLayer.Denoising Normal");
    EXPECT_EQ(choose_channels(*file, {"Emit", "", "normal", ""}).layer, "ViewLayer.Emit");
}

TEST(RendererMap, OtherRenderers)
{
    std::string renderer;
    const std::vector<std::string> pbrt = {"R",        "G",          "B",          "Albedo.R",
                                           "Albedo.G", "Albedo.B",   "Ns.X",       "Ns.Y",
                                           "Ns.Z",     "Variance.R", "Variance.G", "Variance.B"};
    EXPECT_EQ(resolved(pbrt, "beauty", &renderer), ":R");
    EXPECT_EQ(renderer, "pbrt");
    EXPECT_EQ(resolved(pbrt, "variance"), "Variance:R");
    const std::vector<std::string> arnold = {"R",   "G",   "B",   "A",          "Z",
                                             "N.X", "N.Y", "N.Z", "variance.R", "denoise_albedo.R"};
    EXPECT_EQ(resolved(arnold, "albedo", &renderer), "denoise_albedo:R");
    EXPECT_EQ(renderer, "arnold");
    EXPECT_EQ(resolved(arnold, "depth"), "Z:Z");
    const std::vector<std::string> renderman = {"Ci.r",  "Ci.g",     "Ci.b",
                                                "mse.r", "albedo.r", "sampleCount"};
    EXPECT_EQ(resolved(renderman, "variance", &renderer), "mse:r");
    EXPECT_EQ(renderer, "renderman");
    EXPECT_EQ(resolved(renderman, "count"), "sampleCount:sampleCount");
    EXPECT_EQ(resolved({"R", "G", "B", "noiseLevel.R"}, "variance", &renderer), "noiseLevel:R");
    EXPECT_EQ(renderer, "vray");
    EXPECT_EQ(resolved({"Bin_0000", "Bin_0001", "Bin_0002"}, "histogram", &renderer),
              "Bin_*:Bin_0000");
    EXPECT_EQ(renderer, "generic");
}

TEST(RendererMap, MistakesHaveTheirPlace)
{
    const auto mistake = [](const std::string& text) {
        return message_of([&] { RendererMap::parse(text, "m.yaml"); });
    };
    const std::string all = mistake("renderer: x\nrole: {}\nroles:\n  albdo: A\n  variance: V\n"
                                    "  depth: {layers: Z, variance_of: pixel}\n");
    for (const char* part : {"m.yaml:2:1: a renderer map has no 'role'; did you mean 'roles'?",
                             "m.yaml:4:3: 'roles' has no 'albdo'; did you mean 'albedo'?",
                             "m.yaml:5:13: a variance needs", "m.yaml:6:35: 'variance_of' is"})
        EXPECT_NE(all.find(part), std::string::npos) << part << " in\n" << all;
    EXPECT_NE(mistake("a: [").find("m.yaml:"), std::string::npos);
    EXPECT_NE(mistake("- 1").find("renderer: NAME"), std::string::npos);
    EXPECT_NE(mistake("").find("renderer: NAME"), std::string::npos);
    EXPECT_NE(mistake("renderer: x").find("'roles' is missing"), std::string::npos);
    EXPECT_NE(mistake("renderer: x\nroles: {beauty: []}").find("empty"), std::string::npos);
    EXPECT_NE(mistake("renderer: x\nroles: {beauty: A, beauty: B}").find("twice"),
              std::string::npos);
}

TEST(RendererMap, NamesDoNotSteerTheTerminal)
{
    const TemporaryFolder folder;
    const std::string path = folder.file("a.exr");
    write_exr(path, {{"", channels({"a\x1b[31m.R", "b\nc.R"}), 0, 0, 4, 4}});
    const std::string text = describe_layers(path).text();
    EXPECT_EQ(text.find('\x1b'), std::string::npos) << text;
    EXPECT_NE(text.find("\"b\\nc\""), std::string::npos) << text;
}

TEST(RendererMap, DescriptionOfAFile)
{
    const FileDescription d = describe_layers(cycles_file);
    EXPECT_EQ(d.renderer, "cycles");
    const std::string text = d.text();
    EXPECT_NE(text.find("ViewLayer.Denoising Normal  X Y Z"), std::string::npos) << text;
    EXPECT_NE(text.find("float  normal"), std::string::npos) << text;
    const std::string json = d.json();
    EXPECT_NE(json.find("{\"layer\":\"ViewLayer.Combined\",\"part\":\"\",\"channels\":[\"R\",\"G\","
                        "\"B\",\"A\"],\"type\":\"half\",\"roles\":[\"beauty\"]}"),
              std::string::npos)
        << json;
}

} // namespace
} // namespace rayloom
