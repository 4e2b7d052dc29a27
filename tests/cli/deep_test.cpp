// SPDX-License-Identifier: Apache-2.0
// Deep images through the command: what goes in comes out, however it is run, complete or not at
// all.
#include "rayloom/engine/load_image.h"
#include "tests/image/image_files.h"
#include "tests/support/command.h"
#include "tests/support/engine_nodes_for_tests.h"
#include "tests/support/folders.h"
#include "tests/support/made_up_deep.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace rayloom::test
{
namespace
{

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

const char* const same = "rayloom: 1\nname: same\ninputs: {deep: {kind: deep}}\n"
                         "outputs: {deep: deep}\n";
const std::vector<std::string> mixed = {"half", "half", "float", "half", "float", "uint"};

class Deep : public ::testing::Test
{
protected:
    std::string file(const std::string& name) const { return m_folder.file(name); }
    void write(const std::string& name, const std::string& text) const
    {
        std::ofstream(file(name)) << text;
    }
    CommandResult run(std::vector<std::string> arguments) const
    {
        return rayloom(std::move(arguments), m_folder.path());
    }
    std::vector<std::string> names() const { return m_folder.names(); }
    /// R, G, B, A, Z and ids of 32 bits in channels of all types; 0 to 10 000 samples a pixel.
    void write_render(const std::string& name, bool tiled = false) const
    {
        const MemoryDeep made = made_up_deep(window);
        const MemoryDeep deep = make_deep(
            window, {"R", "G", "B", "A", "Z", "id"},
            [&](int x, int y) {
                return x == -3 && y == 9 ? 10000
                                         : static_cast<int>(samples_at(made, 0, x, y).size());
            },
            [&](int c, int x, int y, int s) {
                const auto values = samples_at(made, std::min(c, 4), x, y);
                return values.empty() ? 0.5f : values[static_cast<std::size_t>(s) % values.size()];
            });
        write_deep_exr(file(name), deep, mixed, tiled, [](int x, int y, int s) {
            return 0xfff00000u + static_cast<std::uint32_t>(s * 131 + x * 17 + y);
        });
    }
    const Region window{-11, -4, 30, 33};
    TemporaryFolder m_folder;
};

TEST_F(Deep, WhatGoesInComesOutSampleForSample)
{
    write("same.yaml", same);
    for (const bool tiled : {false, true}) {
        write_render("in.exr", tiled);
        const CommandResult r =
            run({"run", "same.yaml", "-i", "deep=in.exr", "-o", "deep=out.exr"});
        ASSERT_EQ(r.exit_code, 0) << r.err;
        EXPECT_EQ(deep_exr_text(file("out.exr")), deep_exr_text(file("in.exr")));
        const auto out = OIIO::ImageInput::open(file("out.exr"));
        ASSERT_TRUE(out);
        EXPECT_TRUE(out->spec().deep);
        EXPECT_EQ(out->spec().tile_width, 0);
        EXPECT_EQ(out->spec().get_string_attribute("compression"), "zips");
        EXPECT_EQ(out->spec().get_string_attribute("Software"), "made up");
        EXPECT_EQ(out->spec().get_string_attribute("rayloom:note"), "kept");
    }
}

TEST_F(Deep, ThreadsTilesBudgetsAndCachesChangeNoByte)
{
    write("recolor.yaml", "rayloom: 1\nname: recolor\ninputs: {deep: {kind: deep}}\n"
                          "nodes:\n"
                          "  flat: {op: transform.deep_flatten, deep: deep}\n"
                          "  soft: {op: oiio.blur, image: flat, width: 5}\n"
                          "  out: {op: transform.deep_recolor, deep: deep, color: soft}\n"
                          "outputs: {deep: out, flat: soft}\n");
    write_render("in.exr");
    const auto with = [&](std::vector<std::string> more, const std::string& out) {
        std::vector<std::string> all = {"run",         "recolor.yaml", "-i",
                                        "deep=in.exr", "-o",           "deep=" + out};
        all.insert(all.end(), more.begin(), more.end());
        return run(all);
    };
    ASSERT_EQ(with({"--threads", "1"}, "first.exr").exit_code, 0);
    const std::vector<char> expected = bytes_of(file("first.exr"));
    for (const std::vector<std::string>& more :
         std::vector<std::vector<std::string>>{{"--threads", "2"},
                                               {"--threads", "7", "--tile", "16"},
                                               {"--threads", "2", "--tile", "37", "--no-skip"},
                                               {"--memory", "6M", "--threads", "1"},
                                               {"--cache", "kept"},
                                               {"--cache", "kept"}}) {
        const CommandResult r = with(more, "other.exr");
        ASSERT_EQ(r.exit_code, 0) << more.front() << ' ' << more.back() << '\n' << r.err;
        EXPECT_EQ(bytes_of(file("other.exr")), expected) << more.front() << ' ' << more.back();
    }
    // The flat image behind it comes from the cache; the deep one is made again.
    const CommandResult cached = with({"--cache", "kept", "--stats"}, "other.exr");
    EXPECT_THAT(cached.err + cached.out, HasSubstr("its result is in the cache"));
    const CommandResult little = with({"--memory", "10K"}, "none.exr");
    EXPECT_EQ(little.exit_code, 5) << little.err;
    EXPECT_THAT(little.err, HasSubstr("needs at least"));
    EXPECT_THAT(names(), Not(::testing::Contains("none.exr")));
}

TEST_F(Deep, ARegionOfInterestIsWrittenAsItsDataWindow)
{
    write("same.yaml", same);
    write_render("in.exr");
    const CommandResult r =
        run({"run", "same.yaml", "-i", "deep=in.exr", "-o", "deep=out.exr", "--roi=-5,3,9,12"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    OIIO::ImageBuf in(file("in.exr")), out(file("out.exr"));
    ASSERT_TRUE(in.read() && out.read());
    EXPECT_EQ(out.roi(), OIIO::ROI(-5, 4, 3, 15, 0, 1, 0, 6));
    EXPECT_EQ(out.roi_full(), in.roi_full());
    for (int y = 3; y < 15; ++y)
        for (int x = -5; x < 4; ++x) {
            ASSERT_EQ(out.deep_samples(x, y), in.deep_samples(x, y));
            for (int s = 0; s < in.deep_samples(x, y); ++s)
                EXPECT_EQ(out.deep_value(x, y, 0, 4, s), in.deep_value(x, y, 0, 4, s));
        }
    const CommandResult outside =
        run({"run", "same.yaml", "-i", "deep=in.exr", "-o", "deep=no.exr", "--roi", "500,500,3,3"});
    EXPECT_EQ(outside.exit_code, 2);
}

TEST_F(Deep, TypesAndCompressionOfTheCallersChoice)
{
    write("same.yaml", same);
    write_render("in.exr");
    const auto with = [&](std::vector<std::string> more) {
        std::vector<std::string> all = {"run",         "same.yaml", "-i",
                                        "deep=in.exr", "-o",        "deep=out.exr"};
        all.insert(all.end(), more.begin(), more.end());
        return run(all);
    };
    const CommandResult r = with({"--type", "half", "--compression", "rle"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    const auto out = OIIO::ImageInput::open(file("out.exr"));
    ASSERT_TRUE(out);
    EXPECT_EQ(out->spec().get_string_attribute("compression"), "rle");
    EXPECT_EQ(out->spec().channelformat(4), OIIO::TypeHalf);
    EXPECT_EQ(out->spec().channelformat(5), OIIO::TypeUInt) << "ids stay integers";
    const auto refused = [&](std::vector<std::string> more, const std::string& message) {
        fs::remove(file("out.exr"));
        const CommandResult bad = with(std::move(more));
        EXPECT_EQ(bad.exit_code, 2) << bad.err;
        EXPECT_THAT(bad.err, HasSubstr(message));
        EXPECT_FALSE(fs::exists(file("out.exr")));
    };
    refused({"--compression", "dwaa"}, "a deep EXR is compressed with none, rle or zips");
    refused({"--type", "uint8"}, "EXR holds half and float, not uint8");
    refused({"--pass-through"}, "no other layers can be kept beside it");
    const CommandResult tiff = run({"run", "same.yaml", "-i", "deep=in.exr", "-o", "deep=out.tif"});
    EXPECT_EQ(tiff.exit_code, 2);
    EXPECT_THAT(tiff.err, HasSubstr("only an EXR holds deep images"));
}

TEST_F(Deep, DamagedInputAndFullDisksLeaveNothing)
{
    write("same.yaml", same);
    write_render("in.exr");
    const std::vector<char> whole = bytes_of(file("in.exr"));
    for (const std::size_t share : {9u, 6u, 2u}) {
        std::ofstream(file("cut.exr"), std::ios::binary)
            .write(whole.data(), static_cast<std::streamsize>(whole.size() * share / 10));
        const CommandResult r =
            run({"run", "same.yaml", "-i", "deep=cut.exr", "-o", "deep=out.exr"});
        EXPECT_EQ(r.exit_code, 3) << r.err;
        EXPECT_THAT(r.err, HasSubstr("cut.exr"));
        EXPECT_THAT(names(), ElementsAre("cut.exr", "in.exr", "same.yaml"));
    }
    write("out.exr", "the earlier file");
    const CommandResult full =
        run_command({"sh", "-c", "trap '' XFSZ; ulimit -f 16; exec \"$0\" \"$@\"",
                     build_folder().string() + "/bin/rayloom", "run", "same.yaml", "-i",
                     "deep=in.exr", "-o", "deep=out.exr"},
                    m_folder.path());
    EXPECT_EQ(full.exit_code, 4) << full.err;
    EXPECT_THAT(full.err, HasSubstr("out.exr: cannot be written"));
    EXPECT_THAT(names(), ElementsAre("cut.exr", "in.exr", "out.exr", "same.yaml"));
    std::ifstream in(file("out.exr"));
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(in), {}), "the earlier file");
    EXPECT_EQ(run({"run", "same.yaml", "-i", "deep=in.exr", "-o", "deep=no/out.exr"}).exit_code, 4);
}

TEST_F(Deep, AStopLeavesNothing)
{
    write("slow.yaml", "rayloom: 1\nname: slow\ninputs: {deep: {kind: deep}}\n"
                       "nodes:\n"
                       "  flat: {op: transform.deep_flatten, deep: deep}\n"
                       "  slow: {op: oiio.median, image: flat, width: 71}\n"
                       "  out: {op: transform.deep_recolor, deep: deep, color: slow}\n"
                       "outputs: {deep: out}\n");
    write_deep_exr(file("in.exr"), made_up_deep({0, 0, 600, 500}),
                   {"half", "half", "half", "half", "float"});
    const StartedCommand started({"run", "slow.yaml", "-i", "deep=in.exr", "-o", "deep=out.exr"},
                                 m_folder.path());
    ASSERT_TRUE(started.says("filtered"));
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    const pid_t child = started.process();
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, WNOHANG), 0) << "it ended before it could be stopped";
    ::kill(child, SIGINT);
    ::waitpid(child, &status, 0);
    ASSERT_TRUE(WIFEXITED(status));
    EXPECT_EQ(WEXITSTATUS(status), 130);
    EXPECT_THAT(names(), ElementsAre("in.exr", "slow.yaml"));
}

TEST_F(Deep, ADenoisedFlatRenderRecoloursTheDeepOne)
{
    const MemoryDeep deep = made_up_deep(window);
    write_deep_exr(file("in.exr"), deep, {"float", "float", "float", "float", "float"});
    // A histogram of the flattened deep image's own colours.
    write("histogram.yaml",
          "rayloom: 1\nname: histogram\ninputs: {deep: {kind: deep}}\n"
          "nodes: {h: {op: transform.histogram, deep: deep}}\noutputs: {histogram: h}\n");
    const CommandResult h =
        run({"run", "histogram.yaml", "-i", "deep=in.exr", "-o", "histogram=h.exr"});
    ASSERT_EQ(h.exit_code, 0) << h.err;
    const CommandResult planned = run({"plan", "deep-recolor", "-i", "deep=in.exr", "-i",
                                       "histogram=h.exr", "-o", "deep=out.exr"});
    EXPECT_EQ(planned.exit_code, 0) << planned.err;
    EXPECT_EQ(run({"picture", "deep-recolor"}).exit_code, 0);
    const CommandResult r =
        run({"run", "deep-recolor", "-i", "deep=in.exr", "-i", "histogram=h.exr", "-o",
             "deep=out.exr", "-o", "image=flat.exr", "--type", "float", "--stats"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    write("flatten.yaml",
          "rayloom: 1\nname: flatten\ninputs: {deep: {kind: deep}}\n"
          "nodes: {flat: {op: transform.deep_flatten, deep: deep}}\noutputs: {image: flat}\n");
    ASSERT_EQ(run({"run", "flatten.yaml", "-i", "deep=out.exr", "-o", "image=again.exr", "--type",
                   "float"})
                  .exit_code,
              0);
    const MemoryImage flat = load_image(file("flat.exr")), again = load_image(file("again.exr"));
    for (int y = window.y0; y < window.y1; ++y)
        for (int x = window.x0; x < window.x1; ++x)
            for (int c = 0; c < 3; ++c) {
                if (samples_at(deep, 0, x, y).empty()) continue;
                const float v = flat.pixels.view().at(c, x, y);
                ASSERT_NEAR(again.pixels.view().at(c, x, y), v, 1e-5f * std::max(1.0f, v));
            }
}

} // namespace
} // namespace rayloom::test
