// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/frames.h"

#include "rayloom/core/error.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <random>

namespace rayloom
{
namespace
{
using Frames = std::vector<int>;

std::string error_of(auto&& call)
{
    try {
        call();
    } catch (const Error& e) {
        return e.what();
    }
    return "";
}

TEST(Frames, Ranges)
{
    EXPECT_EQ(parse_frame_range("7"), (Frames{7}));
    EXPECT_EQ(parse_frame_range("1-10x2,15"), (Frames{1, 3, 5, 7, 9, 15}));
    EXPECT_EQ(parse_frame_range("-5--2"), (Frames{-5, -4, -3, -2}));
    EXPECT_EQ(parse_frame_range("-2-1"), (Frames{-2, -1, 0, 1}));
    EXPECT_EQ(parse_frame_range("5-1x2"), (Frames{5, 3, 1}));
    EXPECT_EQ(parse_frame_range("1-10y3"), (Frames{2, 3, 5, 6, 8, 9}));
    EXPECT_EQ(parse_frame_range("3,1-4"), (Frames{3, 1, 2, 4}));
    EXPECT_EQ(parse_frame_range("4-4"), (Frames{4}));
}

TEST(Frames, BadRangesSayWhatToWrite)
{
    for (const char* text : {"", "a", "1-", "1-10x0", "1-10x", "1,,2", "1-10z2", "1 - 3", "--2",
                             "0-99999999999", "1-2000000", "1-1y1", "1-10x-2"})
        EXPECT_NE(error_of([&] { parse_frame_range(text); }).find("1-10x2"), std::string::npos)
            << text;
    const std::string colon = error_of([] { parse_frame_range("1-10:2"); });
    EXPECT_NE(colon.find("every n-th"), std::string::npos) << colon;
    EXPECT_NE(colon.find("interleaved"), std::string::npos) << colon;
}

TEST(Frames, FormattedRangeReadsBack)
{
    EXPECT_EQ(format_frame_range(Frames{1, 3, 5, 7, 9, 15}), "1-9x2,15");
    EXPECT_EQ(format_frame_range(Frames{-5, -4, -3}), "-5--3");
    EXPECT_EQ(format_frame_range(Frames{}), "");
    std::mt19937 random(7);
    for (int round = 0; round < 200; ++round) {
        Frames frames;
        for (int i = 0; i < 8; ++i) frames.push_back(static_cast<int>(random() % 12) - 6);
        Frames unique;
        for (const int f : frames)
            if (std::find(unique.begin(), unique.end(), f) == unique.end()) unique.push_back(f);
        EXPECT_EQ(parse_frame_range(format_frame_range(unique)), unique);
    }
}

TEST(Frames, Patterns)
{
    EXPECT_EQ(FramePattern("shot.%04d.exr").path(7), "shot.0007.exr");
    EXPECT_EQ(FramePattern("shot.%04d.exr").path(-7), "shot.-007.exr");
    EXPECT_EQ(FramePattern("s%d").path(12), "s12");
    EXPECT_EQ(FramePattern("s%3d").path(12), "s 12");
    EXPECT_EQ(FramePattern("s.##.exr").path(7), "s.07.exr");
    EXPECT_EQ(FramePattern("s.#.exr").path(7), "s.0007.exr") << "a lone # is four digits";
    EXPECT_EQ(FramePattern("s.####.exr").path(12345), "s.12345.exr");
    EXPECT_EQ(FramePattern("#1/s.%02d.exr").path(7), "#1/s.07.exr") << "% makes # a character";
    EXPECT_EQ(FramePattern("%02d/s.%04d.exr").path(7), "07/s.0007.exr");
    EXPECT_EQ(FramePattern("50%%.\\#.exr").path(7), "50%.#.exr");
    EXPECT_FALSE(FramePattern("plain@.exr").has_frame());
    EXPECT_THROW(FramePattern("50%.exr"), UsageError);
    EXPECT_THROW(FramePattern("%s.exr"), UsageError);
    EXPECT_THROW(FramePattern("%99999d.exr"), UsageError);
}

TEST(Frames, InputSources)
{
    const auto same = [](const char* text, const char* name, const char* path, const char* range,
                         const char* layer) {
        const InputSource s = parse_input_source(text);
        EXPECT_EQ(s.name, name) << text;
        EXPECT_EQ(s.path, path) << text;
        EXPECT_EQ(s.frames ? format_frame_range(*s.frames) : "", range) << text;
        EXPECT_EQ(s.layer, layer) << text;
    };
    same("color=a.exr", "color", "a.exr", "", "");
    same("color=dir=1/a.exr", "color", "dir=1/a.exr", "", "");
    same("s=stack/s%02d.exr@1-16:Combined", "s", "stack/s%02d.exr", "1-16", "Combined");
    same("n=a.exr:ViewLayer.Denoising Normal", "n", "a.exr", "", "ViewLayer.Denoising Normal");
    same("a=me@home/a.exr", "a", "me@home/a.exr", "", "");
    same("a=me@home/s%d.exr@-5--2", "a", "me@home/s%d.exr", "-5--2", "");
    same("a=v\\@2", "a", "v@2", "", "");
    same("a=take\\:2.exr:L", "a", "take:2.exr", "", "L");
    same("a=\"take:2@1.exr\":\"L:x\"", "a", "take:2@1.exr", "", "L:x");
    same("a=s%d.exr@1-4:\"5\"", "a", "s%d.exr", "1-4", "5");
    same("a=a.exr:L:x", "a", "a.exr", "", "L:x");
}

TEST(Frames, RelativeRanges)
{
    const InputSource s = parse_input_source("a=shot.%04d.exr@-5..+5:Combined");
    ASSERT_TRUE(s.relative.has_value());
    EXPECT_FALSE(s.frames.has_value());
    EXPECT_EQ(s.path, "shot.%04d.exr");
    EXPECT_EQ(s.layer, "Combined");
    EXPECT_EQ(s.relative->first, -5);
    EXPECT_EQ(s.relative->last, 5);
    EXPECT_EQ(parse_input_source("a=\"s%d.exr\"@+1..+2").relative->first, 1);
    EXPECT_EQ(parse_input_source("a=s%d.exr@0..+2").relative->first, 0);
    EXPECT_EQ(parse_input_source("a=s%d.exr@-3..-1").relative->last, -1);
    EXPECT_FALSE(parse_input_source("a=me@1..2.exr").relative.has_value()) << "part of the path";
    for (const char* text : {"a=s%d.exr@1..5", "a=s%d.exr@-5..5", "a=s%d.exr@+5..-5",
                             "a=s%d.exr@-5..", "a=s%d.exr@-5...+5", "a=s%d.exr@-9999999..+1"})
        EXPECT_THROW(parse_input_source(text), UsageError) << text;
    EXPECT_NE(error_of([] { parse_input_source("a=s%d.exr@1..5"); }).find("'1' has no sign"),
              std::string::npos);
}

TEST(Frames, BadInputSources)
{
    for (const char* text : {"color", "=a.exr", "a=", "a=:L", "a=a.exr:", "a=\"a.exr", "a=\"a\"b",
                             "a=s%d.exr@1-x", "a=s%d.exr@3-,", "a=b:\"L\"x"})
        EXPECT_THROW(parse_input_source(text), UsageError) << text;
    const std::string colon = error_of([] { parse_input_source("a=s%d.exr@1-10:5"); });
    EXPECT_NE(colon.find("x5"), std::string::npos) << colon;
    EXPECT_NE(colon.find("interleaved"), std::string::npos) << colon;
}

TEST(Frames, OutputTargets)
{
    EXPECT_EQ(parse_output_target("image=out.%04d.exr").path, "out.%04d.exr");
    EXPECT_EQ(parse_output_target("image=out.exr:Filtered.Beauty").layer, "Filtered.Beauty");
    EXPECT_THROW(parse_output_target("image"), UsageError);
    EXPECT_THROW(parse_output_target("image=a:"), UsageError);
}

TEST(Frames, ResolveFilesPatternsAndGlobs)
{
    const std::filesystem::path dir =
        std::filesystem::path(testing::TempDir()) / "rayloom_frames_test";
    std::filesystem::remove_all(dir);
    std::filesystem::create_directories(dir);
    for (const char* name : {"s1.exr", "s2.exr", "s10.exr", "odd[1].exr", "b#.exr"})
        std::ofstream(dir / name) << "x";
    const std::string base = dir.string() + "/";
    const auto resolve = [&](const std::string& right, std::optional<int> frame = {}) {
        return resolve_files(parse_input_source("x=" + base + right), frame);
    };
    const ResolvedFiles glob = resolve("s*.exr");
    EXPECT_TRUE(glob.is_list);
    EXPECT_EQ(glob.paths,
              (std::vector<std::string>{base + "s1.exr", base + "s2.exr", base + "s10.exr"}));
    const ResolvedFiles one = resolve("s%d.exr@2");
    EXPECT_TRUE(one.is_list);
    EXPECT_EQ(one.paths, (std::vector<std::string>{base + "s2.exr"}));
    EXPECT_EQ(resolve("s%d.exr", 10).paths.at(0), base + "s10.exr");
    EXPECT_FALSE(resolve("s%d.exr", 10).is_list);
    EXPECT_THROW(resolve("s%d.exr"), UsageError);
    EXPECT_THROW(resolve("s1.exr@1-2"), UsageError) << "no place for the frame";
    EXPECT_THROW(resolve("t*.exr"), InputError);
    // Around a frame: what exists, and what the run asks for.
    const InputSource around = parse_input_source("x=" + base + "s%d.exr@-2..+2");
    EXPECT_EQ(resolve_files(around, 2).paths,
              (std::vector<std::string>{base + "s1.exr", base + "s2.exr"}));
    EXPECT_TRUE(resolve_files(around, 2).is_list);
    EXPECT_EQ(resolve_files(around, 2, std::vector<int>{2, 3, 9}).paths.back(), base + "s3.exr");
    EXPECT_TRUE(resolve_files(around, 20).paths.empty());
    EXPECT_THROW(resolve_files(around, {}), UsageError);
    EXPECT_THROW(resolve("s1.exr@-1..+1", 2), UsageError) << "no place for the frame";
    EXPECT_EQ(resolve("odd[1].exr").paths.at(0), base + "odd[1].exr");
    EXPECT_EQ(resolve("b#.exr").paths.at(0), base + "b#.exr");
    EXPECT_EQ(resolve("missing.exr").paths.at(0), base + "missing.exr");
    std::filesystem::remove_all(dir);
}

} // namespace
} // namespace rayloom
