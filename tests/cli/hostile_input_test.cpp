// SPDX-License-Identifier: Apache-2.0
// What renders, disks and users really do to a command: damaged files, pixels that are no numbers,
// full disks, kills, unusual windows and parts. A clear error or a counted repair, and never a file
// that is half there.
#include "rayloom/engine/load_image.h"
#include "tests/image/image_files.h"
#include "tests/support/command.h"
#include "tests/support/engine_nodes_for_tests.h"
#include "tests/support/folders.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <fstream>
#include <iterator>
#include <limits>
#include <sstream>
#include <sys/resource.h>
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
using ::testing::IsEmpty;

const fs::path source = test::source_folder();
const fs::path scene = source / "tests/data/cycles/interior";
const char* const rhf = "ray-histogram-fusion-stack";
const char* const twice =
    "rayloom: 1\nname: twice\ninputs: {color: {channels: RGB, role: beauty}}\n"
    "nodes: {twice: {op: oiio.mul, image: color, value: 2}}\noutputs: {image: twice}\n";

/// A median over a window so wide that it takes many seconds, of code that cannot be interrupted.
const char* const slow =
    "rayloom: 1\nname: slow\ninputs: {color: {channels: RGB}}\n"
    "nodes: {slow: {op: oiio.median, image: color, width: 71}}\noutputs: {image: slow}\n";

class HostileInput : public ::testing::Test
{
protected:
    fs::path file(const std::string& name) const { return m_folder.path() / name; }
    void write(const std::string& name, const std::string& text) const
    {
        std::ofstream(file(name)) << text;
    }
    CommandResult run(std::vector<std::string> arguments) const
    {
        return rayloom(std::move(arguments), m_folder.path());
    }
    std::vector<std::string> names() const { return m_folder.names(); }
    /// Copies the first `count` renders of the scene to s01.exr, s02.exr, …
    void copy_stack(int count) const
    {
        for (int i = 1; i <= count; ++i) {
            const std::string name = "s0" + std::to_string(i) + ".exr";
            fs::copy(scene / "stack" / name, file(name));
        }
    }
    CommandResult denoise(std::vector<std::string> more = {}) const
    {
        std::vector<std::string> arguments{"run",          rhf, "-i", "stack=s%02d.exr@1-4", "-o",
                                           "image=out.exr"};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return run(arguments);
    }
    /// Starts a run of slow.yaml in the folder and waits until it says which layers it reads, which
    /// is when pixels begin to be computed.
    StartedCommand start_slow_run() const
    {
        write("slow.yaml", slow);
        const std::string input =
            "color=" + (source / "tests/data/cycles/cornell/ref.exr").string();
        return StartedCommand({"run", "slow.yaml", "-i", input, "-o", "image=out.exr"},
                              m_folder.path());
    }

private:
    TemporaryFolder m_folder;
};

TEST_F(HostileInput, NanAndInfinityInARenderAreRepairedAndSaid)
{
    copy_stack(4);
    for (const char* name : {"s01.exr", "s03.exr"}) {
        const MemoryImage render = load_image(file(name).string(), "Combined");
        ASSERT_TRUE(to_image_buf(render).write(file(name).string()));
    }
    MemoryImage render = load_image(file("s02.exr").string(), "Combined");
    const float nan = std::numeric_limits<float>::quiet_NaN();
    for (int y = 10; y < 14; ++y)
        for (int x = 20; x < 25; ++x) render.pixels.view().at(x % 3, x, y) = nan;
    render.pixels.view().at(1, 50, 50) = std::numeric_limits<float>::infinity();
    ASSERT_TRUE(to_image_buf(render).write(file("s02.exr").string()));
    const CommandResult r =
        run({"run", rhf, "-i", "stack=s%02d.exr@1-3", "-o", "image=out.exr", "-q"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_THAT(r.err,
                HasSubstr("warning: node 'clean' (threshold.sanitize): NaN pixels repaired"));
    const MemoryImage out = load_image(file("out.exr").string());
    for (int c = 0; c < out.desc.channel_count(); ++c)
        for (int y = out.desc.data.y0; y < out.desc.data.y1; ++y)
            for (int x = out.desc.data.x0; x < out.desc.data.x1; ++x)
                ASSERT_TRUE(std::isfinite(out.pixels.view().at(c, x, y)))
                    << c << " " << x << " " << y;
}

TEST_F(HostileInput, ATruncatedRenderIsNamedAndNothingIsWritten)
{
    copy_stack(4);
    for (const std::uintmax_t share : {2u, 40u, 0u}) { // in the pixels, in the header, empty
        fs::copy(scene / "stack/s03.exr", file("s03.exr"), fs::copy_options::overwrite_existing);
        fs::resize_file(file("s03.exr"), share == 0 ? 0 : fs::file_size(file("s03.exr")) / share);
        const CommandResult r = denoise();
        EXPECT_EQ(r.exit_code, 3) << r.err;
        EXPECT_THAT(r.err, HasSubstr("s03.exr"));
        EXPECT_FALSE(fs::exists(file("out.exr")));
    }
    fs::remove(file("s03.exr"));
    const CommandResult r = denoise();
    EXPECT_EQ(r.exit_code, 3);
    EXPECT_THAT(r.err, HasSubstr("s03.exr: No such file"));
}

TEST_F(HostileInput, RendersOfAnotherSizeOrWithoutTheLayerAreRefused)
{
    copy_stack(4);
    fs::copy(source / "tests/data/cycles/cornell/stack/s03.exr", file("s03.exr"),
             fs::copy_options::overwrite_existing);
    CommandResult r = denoise();
    EXPECT_EQ(r.exit_code, 3);
    EXPECT_THAT(r.err, HasSubstr("rayloom: input 'stack': s01.exr and s03.exr: "));
    EXPECT_THAT(r.err, HasSubstr("they have 96x96+0+0 and 288x288+0+0"));
    r = run({"run", rhf, "-i", "stack=s%02d.exr@1-2:DiffDir", "-o", "image=out.exr"});
    EXPECT_EQ(r.exit_code, 3);
    EXPECT_THAT(r.err, HasSubstr("has no layer 'DiffDir'; there is: ViewLayer.Combined"));
    EXPECT_FALSE(fs::exists(file("out.exr")));
}

TEST_F(HostileInput, AFullDiskKeepsTheEarlierFile)
{
    copy_stack(4);
    write("out.exr", "the earlier file");
    // Files of this process may not grow beyond 8 KiB: what a full disk looks like from inside.
    const CommandResult r =
        run_command({"sh", "-c", "trap '' XFSZ; ulimit -f 16; exec \"$0\" \"$@\"",
                     test::build_folder().string() + "/bin/rayloom", "run", rhf, "-i",
                     "stack=s%02d.exr@1-4", "-o", "image=out.exr"},
                    file("").parent_path());
    EXPECT_EQ(r.exit_code, 4) << r.err;
    EXPECT_THAT(r.err, HasSubstr("out.exr: cannot be written"));
    EXPECT_THAT(names(), ElementsAre("out.exr", "s01.exr", "s02.exr", "s03.exr", "s04.exr"));
    std::ifstream in(file("out.exr"));
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(in), {}), "the earlier file");
}

TEST_F(HostileInput, AKillLeavesNothing)
{
    const StartedCommand started = start_slow_run();
    ASSERT_TRUE(started.says("filtered"));
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    const pid_t child = started.process();
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, WNOHANG), 0) << "it ended before it could be killed";
    ::kill(child, SIGKILL);
    ::waitpid(child, &status, 0);
    EXPECT_TRUE(WIFSIGNALED(status));
    EXPECT_THAT(names(), ElementsAre("slow.yaml"));
}

/// What all threads of a process have used so far.
double processor_seconds(pid_t process)
{
    std::ifstream file("/proc/" + std::to_string(process) + "/stat");
    std::string text((std::istreambuf_iterator<char>(file)), {});
    std::istringstream fields(text.substr(text.rfind(')') + 1));
    std::string field;
    for (int i = 3; i < 14; ++i) fields >> field; // the state is the third, utime the fourteenth
    double user = 0.0, system = 0.0;
    fields >> user >> system;
    return (user + system) / static_cast<double>(::sysconf(_SC_CLK_TCK));
}

TEST_F(HostileInput, SlowFiltersStopWithinASecond)
{
    const StartedCommand started = start_slow_run();
    ASSERT_TRUE(started.says("filtered"));
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    const pid_t child = started.process();
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, WNOHANG), 0) << "it ended before it could be stopped";
    const double asked = processor_seconds(child);
    ASSERT_GT(asked, 0.0);
    ::kill(child, SIGINT);
    rusage used{};
    ::wait4(child, &status, 0, &used);
    ASSERT_TRUE(WIFEXITED(status));
    EXPECT_EQ(WEXITSTATUS(status), 130);
    const auto seconds = [](const timeval& t) {
        return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
    };
    // Processor time, which other programs do not stretch: a second of each core.
    EXPECT_LT(seconds(used.ru_utime) + seconds(used.ru_stime) - asked,
              std::thread::hardware_concurrency());
    EXPECT_THAT(names(), ElementsAre("slow.yaml"));
}

TEST_F(HostileInput, OptionsThatMeanNothingAreRefused)
{
    copy_stack(4);
    const auto refused = [&](const std::vector<std::string>& arguments,
                             const std::string& message) {
        const CommandResult r = run(arguments);
        EXPECT_EQ(r.exit_code, 2) << r.err;
        EXPECT_THAT(r.err, HasSubstr(message));
        EXPECT_FALSE(fs::exists(file("out.exr")));
    };
    const std::string stack = "stack=s%02d.exr@1-4", image = "image=out.exr";
    refused({"run", rhf, "-i", stack, "-o", image, "--compression", "zop"},
            "there is no compression 'zop'; did you mean 'zip'?");
    refused({"run", rhf, "-i", stack, "-o", image, "--type", "hlaf"},
            "there is no pixel type 'hlaf'");
    refused({"run", rhf, "-i", stack, "-o", image, "-p", "window=12"}, "window must be odd");
    refused({"run", rhf, "-i", stack, "-o", image, "-p", "kappa=nan"},
            "parameter 'kappa' must be at least 0, not nan");
    refused({"run", rhf, "-i", stack, "-o", image, "--roi", "5000,0,8,8"}, "lies outside output");
    refused({"run", rhf, "-i", "stack=s%02d.exr", "-o", image}, "needs a frame number");
    refused({"run", rhf, "-i", stack, "-o", image, "--memory", "much"}, "'much' is not a size");
    refused(
        {"run", rhf, "-i", "stack=s01.exr:Combined", "-i", "stack=s02.exr:DiffDir", "-o", image},
        "not 'Combined' and 'DiffDir'");
    refused({"picture", rhf, "-o", "out.png"}, ".svg or .dot, not 'out.png'");
}

TEST_F(HostileInput, AStackForEachFrameOfAnAnimation)
{
    for (int frame = 1; frame <= 2; ++frame)
        for (int seed = 1; seed <= 3; ++seed)
            fs::copy(scene / ("stack/s0" + std::to_string(3 * (frame - 1) + seed) + ".exr"),
                     file("f000" + std::to_string(frame) + "_s" + std::to_string(seed) + ".exr"));
    const CommandResult r = run({"run", rhf, "-i", "stack=f%04d_s*.exr", "-o", "image=o.%04d.exr",
                                 "--frames", "1-2", "-q"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_EQ(r.err, "");
    const MemoryImage second = load_image(file("o.0002.exr").string());
    EXPECT_FALSE(same_bits(load_image(file("o.0001.exr").string()), second));
    ASSERT_EQ(run({"run", rhf, "-i", "stack=" + (scene / "stack/s%02d.exr").string() + "@4-6", "-o",
                   "image=alone.exr"})
                  .exit_code,
              0);
    EXPECT_TRUE(same_bits(load_image(file("alone.exr").string()), second));
}

TEST_F(HostileInput, NegativeOriginAndOverscanComeOutAsTheyWentIn)
{
    write("twice.yaml", twice);
    MemoryImage image = load_image((scene / "ref.exr").string());
    OIIO::ImageBuf moved = to_image_buf(image);
    moved.set_origin(-17, -9);
    moved.set_roi_full(OIIO::ROI(0, 70, 0, 60));
    ASSERT_TRUE(moved.write(file("in.exr").string()));
    ASSERT_EQ(run({"run", "twice.yaml", "-i", "color=in.exr", "-o", "image=out.exr"}).exit_code, 0);
    const MemoryImage out = load_image(file("out.exr").string());
    EXPECT_EQ(out.desc.data, (Region{-17, -9, 79, 87}));
    EXPECT_EQ(out.desc.display, (Region{0, 0, 70, 60}));
    ASSERT_EQ(run({"run", "twice.yaml", "-i", "color=in.exr", "-o", "image=part.exr", "--roi",
                   "-10,-5,20,10"})
                  .exit_code,
              0);
    const MemoryImage part = load_image(file("part.exr").string());
    EXPECT_EQ(part.desc.data, (Region{-10, -5, 10, 5}));
    for (int c = 0; c < 3; ++c)
        for (int y = -5; y < 5; ++y)
            for (int x = -10; x < 10; ++x)
                ASSERT_EQ(part.pixels.view().at(c, x, y), out.pixels.view().at(c, x, y));
}

TEST_F(HostileInput, OnePartOfSeveralIsReplacedAndTheOthersKept)
{
    write("twice.yaml", twice);
    const std::vector<Channel> rgb{{"R"}, {"G"}, {"B"}};
    write_exr(file("in.exr").string(), {{.name = "beauty", .channels = rgb},
                                        {.name = "light", .channels = rgb},
                                        {.name = "ids", .channels = {{"id", OIIO::TypeFloat}}}});
    const CommandResult r = run(
        {"run", "twice.yaml", "-i", "color=in.exr:light", "-o", "image=out.exr", "--pass-through"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_THAT(r.err, HasSubstr("light: filtered (input 'color')"));
    const auto layer = [&](const char* name, const char* of) {
        return load_image(file(name).string(), of);
    };
    EXPECT_TRUE(same_bits(layer("in.exr", "beauty"), layer("out.exr", "beauty")));
    EXPECT_TRUE(same_bits(layer("in.exr", "ids"), layer("out.exr", "ids")));
    const MemoryImage before = layer("in.exr", "light"), after = layer("out.exr", "light");
    ASSERT_EQ(after.desc.channels, before.desc.channels);
    EXPECT_EQ(after.pixels.view().at(1, 7, 9), 2.0f * before.pixels.view().at(1, 7, 9));
}

TEST_F(HostileInput, DeepSamplesBecomeAHistogram)
{
    write("deep.yaml", "rayloom: 1\nname: deep\ninputs: {samples: {kind: deep}}\n"
                       "nodes: {h: {op: transform.histogram, deep: samples, bins: 4}}\n"
                       "outputs: {histogram: h}\n");
    OIIO::ImageSpec spec(6, 4, 4, OIIO::TypeFloat);
    spec.channelnames = {"R", "G", "B", "Z"};
    spec.deep = true;
    OIIO::ImageBuf deep(spec);
    for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 6; ++x) {
            deep.set_deep_samples(x, y, 0, x);
            for (int s = 0; s < x; ++s)
                for (int c = 0; c < 4; ++c)
                    deep.set_deep_value(x, y, 0, c, s, c == 3 ? static_cast<float>(s) : 0.0f);
        }
    ASSERT_TRUE(deep.write(file("in.exr").string())) << deep.geterror();
    const CommandResult r =
        run({"run", "deep.yaml", "-i", "samples=in.exr", "-o", "histogram=out.exr"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    const MemoryImage out = load_image(file("out.exr").string());
    ASSERT_EQ(out.desc.channel_count(), 13);
    for (int x = 0; x < 6; ++x) {
        EXPECT_EQ(out.pixels.view().at(12, x, 2), static_cast<float>(x)) << "samples";
        EXPECT_EQ(out.pixels.view().at(0, x, 2), static_cast<float>(x)) << "black ones of R";
        EXPECT_EQ(out.pixels.view().at(1, x, 2), 0.0f);
    }
}

TEST_F(HostileInput, ARendererNobodyKnowsIsTaughtByAMapOfOnesOwn)
{
    fs::create_directories(file("mine/renderers"));
    write("mine/renderers/mine.yaml", "renderer: mine\ndoc: A renderer of our own.\n"
                                      "detect: {channels: [\"picture.*\"]}\n"
                                      "roles: {beauty: picture, normal: shape}\n");
    write("mine/doubled.yaml", twice);
    write_exr(file("in.exr").string(), {{.name = "",
                                         .channels = {{"picture.R"},
                                                      {"picture.G"},
                                                      {"picture.B"},
                                                      {"shape.X"},
                                                      {"shape.Y"},
                                                      {"shape.Z"}}}});
    const std::vector<std::string> environment{"RAYLOOM_GRAPH_PATH=" + file("mine").string()};
    const CommandResult info = rayloom({"info", "in.exr"}, file("").parent_path(), environment);
    EXPECT_EQ(info.exit_code, 0) << info.err;
    EXPECT_THAT(info.out, HasSubstr("layers as in mine renders"));
    EXPECT_THAT(info.out, HasSubstr("normal"));
    const CommandResult r = rayloom({"run", "doubled", "-i", "color=in.exr", "-o", "image=out.exr"},
                                    file("").parent_path(), environment);
    EXPECT_EQ(r.exit_code, 0) << r.err;
    EXPECT_THAT(r.err, HasSubstr("picture: filtered (input 'color')"));
}

TEST_F(HostileInput, HelpTellsWhatAGraphWants)
{
    const CommandResult r = run({"help", rhf});
    EXPECT_EQ(r.exit_code, 0) << r.err;
    EXPECT_THAT(r.out, HasSubstr("stack: list of images"));
    EXPECT_THAT(r.out, HasSubstr("kappa: floats at least 0; default [1, 0.3]"));
    EXPECT_THAT(run({"help", "no-such-thing"}).err,
                HasSubstr("there is no node, graph or command 'no-such-thing'"));
    EXPECT_THAT(names(), IsEmpty());
}

} // namespace
} // namespace rayloom::test
