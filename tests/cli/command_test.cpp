// SPDX-License-Identifier: Apache-2.0
// The command as its users meet it: real files in, real files out, messages and exit codes.
#include "rayloom/engine/load_image.h"
#include "tests/support/command.h"
#include "tests/support/engine_nodes_for_tests.h"
#include "tests/support/folders.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <csignal>
#include <fstream>
#include <limits>
#include <sstream>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace rayloom::test
{
namespace
{

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

const fs::path source = test::source_folder();
const fs::path scene = source / "tests/data/cycles/interior";

std::string stack_input(const fs::path& folder = scene)
{
    return "stack=" + (folder / "stack/s%02d.exr").string() + "@1-8:Combined";
}

const char* const rhf = "ray-histogram-fusion-stack.yaml";

class Command : public ::testing::Test
{
protected:
    const fs::path& folder() const { return m_folder.path(); }
    fs::path file(const std::string& name) const { return m_folder.path() / name; }
    fs::path write(const std::string& name, const std::string& text) const
    {
        std::ofstream(file(name)) << text;
        return file(name);
    }
    CommandResult run(std::vector<std::string> arguments,
                      const std::vector<std::string>& environment = {}) const
    {
        return rayloom(std::move(arguments), m_folder.path(), environment);
    }
    std::vector<std::string> names() const { return m_folder.names(); }

private:
    TemporaryFolder m_folder;
};

TEST_F(Command, DenoisesAStackAndSaysWhatItDid)
{
    const CommandResult r =
        run({"run", rhf, "-i", stack_input(), "-o", "image=out.exr", "--stats=json"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_THAT(names(), ElementsAre("out.exr"));
    EXPECT_THAT(r.err, HasSubstr("wrote out.exr"));
    const YAML::Node stats = YAML::Load(r.out); // JSON is YAML
    EXPECT_GT(stats["seconds"].as<double>(), 0.0);
    EXPECT_EQ(stats["written"][0].as<std::string>(), "out.exr");
    const CommandResult c =
        run({"compare", "out.exr", (scene / "stack/s01.exr").string() + ":Combined", "--ref",
             (scene / "ref.exr").string(), "--json", "--no-flip"});
    ASSERT_EQ(c.exit_code, 0) << c.err;
    const YAML::Node errors = YAML::Load(c.out);
    EXPECT_GT(errors["equal_error_sample_factor"].as<double>(), 10.0);
}

TEST_F(Command, TheSameBytesHoweverItIsRun)
{
    ASSERT_EQ(run({"run", rhf, "-i", stack_input(), "-o", "image=a.exr"}).exit_code, 0);
    const MemoryImage expected = load_image(file("a.exr").string());
    const std::vector<std::vector<std::string>> ways{{"--threads", "1"},   {"--tile", "23"},
                                                     {"--no-skip"},        {"--memory", "8M"},
                                                     {"--cache", "cache"}, {"--cache", "cache"}};
    for (const auto& way : ways) {
        std::vector<std::string> arguments{"run", rhf, "-i", stack_input(), "-o", "image=b.exr"};
        arguments.insert(arguments.end(), way.begin(), way.end());
        const CommandResult r = run(arguments);
        ASSERT_EQ(r.exit_code, 0) << way[0] << ": " << r.err;
        EXPECT_TRUE(same_bits(load_image(file("b.exr").string()), expected)) << way[0];
    }
    for (const char* target : {"AVX3", "AVX2", "SSE4", "SSSE3"}) {
        const CommandResult r =
            run({"--simd", target, "run", rhf, "-i", stack_input(), "-o", "image=c.exr"});
        if (r.exit_code == 2 && r.err.find("no SIMD target") != std::string::npos) continue;
        ASSERT_EQ(r.exit_code, 0) << r.err;
        EXPECT_TRUE(same_bits(load_image(file("c.exr").string()), expected)) << target;
    }
}

TEST_F(Command, MistakesAreNamedAndNothingIsWritten)
{
    const auto expect = [&](const std::vector<std::string>& arguments, int code,
                            const std::string& message) {
        const CommandResult r = run(arguments);
        EXPECT_EQ(r.exit_code, code) << r.err;
        EXPECT_THAT(r.err, HasSubstr(message));
        EXPECT_THAT(names(), Not(::testing::Contains(HasSubstr("out")))) << message;
    };
    expect({"run", rhf, "-i", stack_input(), "-o", "image=out.exr", "-p", "kapa=1"}, 2,
           "did you mean 'kappa'?");
    expect({"run", rhf, "-i", stack_input(), "-o", "image=out.exr", "-p", "kappa=-1"}, 2,
           "parameter 'kappa' must be at least 0, not -1");
    expect({"run", rhf, "-i", stack_input()}, 2, "did you forget -o? The graph makes 'image'");
    expect({"run", rhf, "-o", "image=out.exr"}, 2, "needs input 'stack'");
    expect({"run", "ray-histogram-fusio.yaml", "-o", "image=out.exr"}, 3, "ray-histogram-fusio");
    expect({"run", rhf, "-i", "stack=nothing%02d.exr@1-4", "-o", "image=out.exr"}, 3,
           "nothing01.exr");
    expect({"run", rhf, "-i", stack_input() + "x", "-o", "image=out.exr"}, 3, "Combined");
    expect({"run", rhf, "-i", stack_input(), "-o", "image=missing/out.exr"}, 4, "missing");
    expect({"run", rhf, "-i", stack_input(), "-o", "image=out.exr", "--memory", "10k"}, 5,
           "the budget is 10.0 kB");
    expect({"run", rhf, "-i", stack_input(), "-o", "image=out.exr", "--frames", "1:10"}, 2, "1:10");
    expect({"run", rhf, "-i", stack_input(), "-o", "image=out.exr", "--frames", "1-3"}, 2,
           "give output 'image' a place for the frame");
    expect({"run", rhf, "-i", stack_input(), "-o", "image=out.exr", "--roi", "1,2,3"}, 2,
           "x,y,width,height");
    expect({"run", rhf, "--wrong"}, 2, "--wrong");
    expect({"nosuchcommand"}, 2, "");
    expect({"help", "fuse.histgram"}, 2, "did you mean 'fuse.histogram'?");
}

TEST_F(Command, AnErrorRepeatsTheCommandLine)
{
    const CommandResult r = run({"run", rhf, "-i", "stack=a b.exr", "-o", "image=out.exr"});
    EXPECT_THAT(
        r.err,
        HasSubstr("run ray-histogram-fusion-stack.yaml -i 'stack=a b.exr' -o image=out.exr"));
}

TEST_F(Command, FramesRunOneByOne)
{
    const fs::path graph =
        write("copy.yaml", "rayloom: 1\nname: copy\ninputs: {color: {channels: RGB}}\n"
                           "nodes: {twice: {op: transform.statistics, stack: [color, color]}}\n"
                           "outputs: {image: twice.mean}\n");
    for (int i = 1; i <= 3; ++i)
        fs::copy(scene / ("stack/s0" + std::to_string(i) + ".exr"),
                 file("shot.000" + std::to_string(i) + ".exr"));
    CommandResult r = run({"run", graph.string(), "-i", "color=shot.%04d.exr:Combined", "-o",
                           "image=out.####.exr", "--frames", "1-3"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    for (int i = 1; i <= 3; ++i)
        EXPECT_TRUE(fs::exists(file("out.000" + std::to_string(i) + ".exr"))) << i;
    // Up to date: nothing is made again; a missing frame alone is.
    fs::remove(file("out.0002.exr"));
    r = run({"run", graph.string(), "-i", "color=shot.%04d.exr:Combined", "-o",
             "image=out.####.exr", "--frames", "1-3", "-u"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_THAT(r.err, HasSubstr("frame 1: up to date"));
    EXPECT_THAT(r.err, HasSubstr("wrote out.0002.exr"));
    // A bad frame ends the run, or with --keep-going only itself.
    write("shot.0002.exr", "no image");
    r = run({"run", graph.string(), "-i", "color=shot.%04d.exr:Combined", "-o",
             "image=new.%04d.exr", "--frames", "1-3", "--keep-going"});
    EXPECT_EQ(r.exit_code, 3);
    EXPECT_THAT(r.err, HasSubstr("frame 2"));
    EXPECT_TRUE(fs::exists(file("new.0003.exr")));
    EXPECT_FALSE(fs::exists(file("new.0002.exr")));
}

TEST_F(Command, AnAnimationFindsItsNeighbourFrames)
{
    // One noisy frame after the other of a still scene, which averaging over frames helps most.
    constexpr int last = 24;
    for (int i = 1; i <= last; ++i)
        fs::create_symlink(scene / ("stack/s0" + std::to_string(1 + i % 8) + ".exr"),
                           file("shot." + std::to_string(i) + ".exr"));
    fs::create_symlink(scene / "noisy_16.exr", file("albedo.exr"));
    const std::vector<std::string> arguments{"run", "virtual-flash-sequence",
                                             "-i",  "frame=shot.%d.exr:Combined",
                                             "-i",  "guide=albedo.exr:Denoising Albedo",
                                             "-p",  "window=5",
                                             "-p",  "patch=1"};
    const auto with = [&](std::vector<std::string> more) {
        more.insert(more.begin(), arguments.begin(), arguments.end());
        return run(more);
    };
    const auto guides = [](int count) {
        std::vector<std::string> out;
        for (int i = 0; i < count; ++i) {
            out.push_back("-i");
            out.push_back("guide_before=albedo.exr:Denoising Albedo");
            out.push_back("-i");
            out.push_back("guide_after=albedo.exr:Denoising Albedo");
        }
        return out;
    };
    // Five frames on either side without being asked, three when asked.
    std::vector<std::string> five = guides(5);
    five.insert(five.end(), {"-o", "image=five.%d.exr", "--frames", "12", "--stats=json"});
    const CommandResult by_itself = with(five);
    ASSERT_EQ(by_itself.exit_code, 0) << by_itself.err;
    const auto named = [&](const char* before, const char* after, int count,
                           const std::string& output, const char* frame) {
        std::vector<std::string> more = guides(count);
        more.insert(more.end(), {"-i", std::string("before=shot.%d.exr@") + before + ":Combined",
                                 "-i", std::string("after=shot.%d.exr@") + after + ":Combined",
                                 "-o", "image=" + output, "--frames", frame, "-q"});
        return with(more);
    };
    EXPECT_EQ(named("7-11", "13-17", 5, "named.%d.exr", "12").exit_code, 0);
    EXPECT_EQ(named("-3..-1", "+1..+3", 3, "three.%d.exr", "12").exit_code, 0);
    const auto bytes = [&](const char* name) {
        std::ifstream in(file(name), std::ios::binary);
        return std::string(std::istreambuf_iterator<char>(in), {});
    };
    EXPECT_EQ(bytes("five.12.exr"), bytes("named.12.exr"));
    EXPECT_NE(bytes("five.12.exr"), bytes("three.12.exr"));
    // A list whose frames are all beyond the end is as good as not given, …
    std::vector<std::string> at_end{"-i",       "guide_before=albedo.exr:Denoising Albedo",
                                    "-i",       "before=shot.%d.exr@-1..-1:Combined",
                                    "-o",       "image=end.%d.exr",
                                    "--frames", "24"};
    EXPECT_EQ(with(at_end).exit_code, 0);
    // … a gap inside what is to be rendered is an error.
    fs::remove(file("shot.13.exr"));
    const CommandResult gap = named("-1..-1", "+1..+1", 1, "gap.%d.exr", "12-14");
    EXPECT_EQ(gap.exit_code, 3);
    EXPECT_THAT(gap.err, HasSubstr("shot.13.exr"));
}

TEST_F(Command, AnAnimationTakesNoMoreMemoryForBeingLong)
{
    for (int i = 1; i <= 40; ++i) {
        fs::create_symlink(scene / ("stack/s0" + std::to_string(1 + i % 8) + ".exr"),
                           file("shot." + std::to_string(i) + ".exr"));
        fs::create_symlink(scene / "noisy_16.exr", file("albedo." + std::to_string(i) + ".exr"));
    }
    // Pixels in memory for frame 12 at most, in a run of so many frames; resident memory at the
    // end.
    const auto memory = [&](const std::string& frames) {
        const CommandResult r =
            run({"run", "virtual-flash-sequence", "-i", "frame=shot.%d.exr:Combined", "-i",
                 "guide=albedo.%d.exr:Denoising Albedo", "-p", "window=3", "-p", "patch=1", "-o",
                 "image=out.%d.exr", "--frames", frames, "--stats=json", "--threads", "1"});
        EXPECT_EQ(r.exit_code, 0) << r.err;
        double most = 0.0;
        std::istringstream lines(r.out);
        for (std::string line; std::getline(lines, line);) {
            const std::size_t at = line.find("\"peak_bytes\": ");
            if (at != std::string::npos) most = std::max(most, std::stod(line.substr(at + 14)));
        }
        struct rusage usage {
        };
        getrusage(RUSAGE_CHILDREN, &usage);
        return std::pair(most, static_cast<double>(usage.ru_maxrss));
    };
    const auto [pixels, resident] = memory("6-13");
    const auto [more_pixels, more_resident] = memory("1-40");
    EXPECT_GT(pixels, 0.0);
    EXPECT_EQ(more_pixels, pixels);
    EXPECT_LT(more_resident, 1.05 * resident);
}

TEST_F(Command, CtrlCStopsWithinASecondAndLeavesNothing)
{
    // Large enough to run for many seconds.
    const fs::path graph = write(
        "slow.yaml", "rayloom: 1\nname: slow\ninputs: {color: {channels: RGB}}\nnodes:\n"
                     "  stats: {op: transform.statistics, stack: [color, color, color]}\n"
                     "  hist: {op: transform.histogram, stack: [color, color, color]}\n"
                     "  a: {op: fuse.histogram, image: stats.mean, histogram: hist, window: 61}\n"
                     "  b: {op: fuse.histogram, image: a, histogram: hist, window: 61}\n"
                     "outputs: {image: b}\n");
    const std::string input = "color=" + (source / "tests/data/cycles/cornell/ref.exr").string();
    const StartedCommand started({"run", graph.string(), "-i", input, "-o", "image=out.exr"},
                                 file("").parent_path());
    // Which layers are read is said when pixels begin to be computed.
    ASSERT_TRUE(started.says("(input 'color')")) << "the run ended before it could be stopped";
    const pid_t child = started.process();
    const auto asked = std::chrono::steady_clock::now();
    ::kill(child, SIGINT);
    int status = 0;
    ::waitpid(child, &status, 0);
    const double waited =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - asked).count();
    ASSERT_TRUE(WIFEXITED(status));
    EXPECT_EQ(WEXITSTATUS(status), 130);
    EXPECT_LT(waited, slowness());
    EXPECT_THAT(names(), ElementsAre("slow.yaml"));
}

TEST_F(Command, NaNAndInfinityDoNotSpreadAndAreCounted)
{
    std::vector<std::string> arguments{"run",    rhf,     "-o",          "image=out.exr",
                                       "--type", "float", "--stats=json"};
    for (int k = 1; k <= 4; ++k) {
        MemoryImage image = load_image((scene / ("stack/s0" + std::to_string(k) + ".exr")).string(),
                                       "Combined", "R,G,B");
        if (k == 2) image.pixels.view().at(1, 20, 30) = std::numeric_limits<float>::quiet_NaN();
        if (k == 3)
            for (int x = 50; x < 60; ++x)
                image.pixels.view().at(0, x, 41) = std::numeric_limits<float>::infinity();
        const std::string name = "s" + std::to_string(k) + ".exr";
        ASSERT_TRUE(to_image_buf(image).write(file(name).string(), OIIO::TypeFloat));
        arguments.insert(arguments.end(), {"-i", "stack=" + name});
    }
    const CommandResult r = run(arguments);
    ASSERT_EQ(r.exit_code, 0) << r.err;
    std::size_t repaired = 0;
    for (const auto& node : YAML::Load(r.out)["nodes"])
        for (const auto& count : node["counts"]) repaired += count.second.as<std::size_t>();
    EXPECT_EQ(repaired, 11u);
    const MemoryImage out = load_image(file("out.exr").string());
    for (int y = out.desc.data.y0; y < out.desc.data.y1; ++y)
        for (int c = 0; c < 3; ++c)
            for (const float v : out.pixels.view().row_span(c, y)) ASSERT_TRUE(std::isfinite(v));
}

TEST_F(Command, OneFileInTheSameFileOut)
{
    const fs::path render = scene / "noisy_16.exr";
    const fs::path graph = write(
        "half.yaml", "rayloom: 1\nname: half\ninputs: {color: {channels: RGB, role: beauty}}\n"
                     "nodes: {mean: {op: transform.statistics, stack: [color, color]}}\n"
                     "outputs: {image: mean.mean}\n");
    const CommandResult r = run({"run", graph.string(), "-i", "color=" + render.string(), "-o",
                                 "image=out.exr", "--pass-through"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    // The plan of the channels is said before anything runs.
    EXPECT_THAT(r.err, HasSubstr("ViewLayer.Combined: filtered (input 'color')"));
    EXPECT_THAT(r.err, HasSubstr("ViewLayer.DiffInd: passed through"));
    // The mean of an image with itself is the image: every channel of the file is bit for bit the
    // same.
    const MemoryImage before = load_image(render.string(), "ViewLayer"),
                      after = load_image(file("out.exr").string(), "ViewLayer");
    EXPECT_TRUE(same_bits(before, after));
}

TEST_F(Command, PlanShowsWhatWouldRunAndRunsNothing)
{
    const CommandResult r =
        run({"plan", rhf, "-i", stack_input(), "-p", "scales=2", "-o", "image=out.exr"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_THAT(r.out, HasSubstr("fuse.histogram"));
    EXPECT_THAT(r.out, HasSubstr("sums over the image first"));
    EXPECT_THAT(r.out, HasSubstr("of pixels in memory"));
    EXPECT_THAT(names(), IsEmpty());
}

TEST_F(Command, ExplainsNodesAndGraphs)
{
    EXPECT_THAT(run({"nodes"}).out, HasSubstr("fuse.histogram"));
    EXPECT_THAT(run({"help", "fuse.histogram"}).out, HasSubstr("kappa: float at least 0"));
    EXPECT_THAT(run({"--version"}).out, HasSubstr("OpenImageIO 2."));
    EXPECT_EQ(YAML::Load(run({"schema"}).out)["type"].as<std::string>(), "object");
    const CommandResult docs = run({"docs", "--out", "pages"});
    EXPECT_EQ(docs.exit_code, 0) << docs.err;
    EXPECT_TRUE(fs::exists(file("pages/fuse.histogram.md")));
    EXPECT_TRUE(fs::exists(file("pages/README.md")));
    EXPECT_THAT(run({"picture", rhf}).out, HasSubstr("digraph"));
    EXPECT_EQ(run({"picture", rhf, "-o", "graph.svg"}).exit_code, 0);
    EXPECT_TRUE(fs::exists(file("graph.svg")));
    EXPECT_THAT(run({"check", rhf}).out, HasSubstr("no mistake found"));
    const YAML::Node interface = YAML::Load(run({"check", "--json", rhf}).out);
    EXPECT_EQ(interface["inputs"][0]["name"].as<std::string>(), "stack");
    EXPECT_EQ(interface["inputs"][0]["kind"].as<std::string>(), "list");
    EXPECT_EQ(interface["inputs"][0]["role"].as<std::string>(), "beauty");
    EXPECT_TRUE(interface["inputs"][0]["required"].as<bool>());
    EXPECT_EQ(interface["outputs"][0]["name"].as<std::string>(), "image");
    const CommandResult info = run({"info", (scene / "noisy_16.exr").string()});
    EXPECT_EQ(info.exit_code, 0) << info.err;
    EXPECT_THAT(info.out, HasSubstr("ViewLayer.DiffInd"));
}

TEST_F(Command, CheckReportsEveryMistakeAtItsPlace)
{
    const fs::path graph =
        write("bad.yaml", "rayloom: 1\nname: bad\ninputs: {stack: {kind: list}}\nnodes:\n"
                          "  h: {op: transform.histogram, stack: stak}\n"
                          "  f: {op: fuse.histogram, image: h, histogram: h, kapa: 2}\n"
                          "outputs: {image: f}\n");
    const CommandResult r = run({"check", "bad.yaml"});
    EXPECT_EQ(r.exit_code, 2);
    EXPECT_THAT(r.err, HasSubstr("bad.yaml:5:39: "));
    EXPECT_THAT(r.err, HasSubstr("did you mean 'stack'?"));
    EXPECT_THAT(
        r.err,
        HasSubstr(
            "bad.yaml:6:51: node 'f' (fuse.histogram): parameter 'kapa' is not known; did you mean "
            "'kappa'?"));
}

TEST_F(Command, CompareServesAsARegressionTest)
{
    const std::string ref = (scene / "ref.exr").string(),
                      noisy = (scene / "stack/s01.exr").string() + ":Combined";
    EXPECT_EQ(run({"compare", ref, ref, "--fail", "relmse=1e-9", "--fail", "psnr=100"}).exit_code,
              0);
    const CommandResult r =
        run({"compare", noisy, ref, "--fail", "relmse=0.001", "--map", "map.png"});
    EXPECT_EQ(r.exit_code, 1);
    EXPECT_THAT(r.err, HasSubstr("relmse"));
    EXPECT_THAT(names(), ElementsAre("map.png"));
    EXPECT_EQ(run({"compare", noisy, ref, "--fail", "relmze=1"}).exit_code, 2);
    EXPECT_EQ(
        run({"compare", noisy, (source / "tests/data/cycles/cornell/ref.exr").string()}).exit_code,
        3);
    const CommandResult gone = run({"compare", "gone.exr", ref});
    EXPECT_EQ(gone.exit_code, 3);
    EXPECT_THAT(gone.err, StartsWith("rayloom: gone.exr: No such file"));
}

TEST_F(Command, SlipsOnTheCommandLineAreUnderstood)
{
    const auto refused = [&](const std::vector<std::string>& arguments, const std::string& what) {
        const CommandResult r = run(arguments);
        EXPECT_EQ(r.exit_code, 2);
        EXPECT_THAT(r.err, StartsWith(what));
    };
    refused({"runn", "g.yaml"}, "rayloom: there is no command 'runn'; did you mean 'run'?");
    refused({"run", "g.yaml", "--fames", "1"},
            "rayloom run: there is no option '--fames'; did you mean '--frames'?");
    refused({"help", "fuse.histgram"},
            "rayloom: there is no node, graph or command 'fuse.histgram'; did you mean "
            "'fuse.histogram'?");
    refused({"help", "virtual-flsh"}, "rayloom: there is no node, graph or command 'virtual-flsh'; "
                                      "did you mean 'virtual-flash'?");
    refused({}, "rayloom: which command? There is: run, plan, ");
    EXPECT_THAT(run({"help", "run"}).out, HasSubstr("--pass-through"));
    EXPECT_THAT(run({"help"}).out, HasSubstr("Exit codes:"));
    EXPECT_THAT(run({"graphs"}).out, HasSubstr("\nray-histogram-fusion-stack "));
}

TEST_F(Command, WhatCannotBePrintedIsAnError)
{
    for (const char* what : {"nodes", "--help", "--version", "run --help"}) {
        const CommandResult r = run_command(
            {"sh", "-c", test::build_folder().string() + "/bin/rayloom " + what + " > /dev/full"},
            folder());
        EXPECT_EQ(r.exit_code, 4) << what << ": " << r.err;
    }
}

TEST_F(Command, FiguresGoToJsonOrToADevice)
{
    write("g.yaml", "rayloom: 1\nname: g\ninputs: {a: {channels: RGB, role: beauty}}\n"
                    "nodes: {m: {op: measure.error, image: a, reference: a, flip: false}}\n"
                    "outputs: {figures: m.errors}\n");
    const std::string a = "a=" + (scene / "ref.exr").string();
    const auto to = [&](const std::string& path) {
        return run({"run", "g.yaml", "-q", "-i", a, "-o", "figures=" + path});
    };
    EXPECT_EQ(to("f.exr").exit_code, 2);
    EXPECT_EQ(to("nowhere/f.json").exit_code, 4);
    EXPECT_THAT(names(), ElementsAre("g.yaml"));
    EXPECT_EQ(to("f.json").exit_code, 0);
    EXPECT_EQ(YAML::LoadFile(file("f.json").string())["rmse"].as<double>(), 0.0);
    // A device is written to, not replaced.
    fs::create_symlink("/dev/null", file("null.json"));
    EXPECT_EQ(to("null.json").exit_code, 0);
    EXPECT_TRUE(fs::is_character_file(file("null.json")));
    EXPECT_EQ(to("/dev/full").exit_code, 4);
}

TEST_F(Command, CompletesWhatIsTyped)
{
    ASSERT_EQ(run({"docs", "--completion", "rayloom.bash", "--man", "rayloom.1"}).exit_code, 0);
    const auto completed = [&](const std::string& words, int at) {
        const CommandResult r = run_command(
            {"bash", "-c",
             "PATH='" + test::build_folder().string() +
                 "/bin':$PATH; compopt() { :; }; . ./rayloom.bash; COMP_WORDS=(" + words +
                 "); COMP_CWORD=" + std::to_string(at) + "; _rayloom; echo \"${COMPREPLY[*]}\""},
            folder());
        EXPECT_EQ(r.exit_code, 0) << r.err;
        return r.out;
    };
    EXPECT_EQ(completed("rayloom com", 1), "compare\n");
    EXPECT_EQ(completed("rayloom run --pas", 2), "--pass-through\n");
    EXPECT_EQ(completed("rayloom run ray-histogram-fusion-s", 2), "ray-histogram-fusion-stack\n");
    EXPECT_EQ(completed("rayloom help fuse.hist", 2), "fuse.histogram\n");
    EXPECT_EQ(completed("rayloom run ray-histogram-fusion-stack -i ''", 4), "stack=\n");
    EXPECT_EQ(completed("rayloom run ray-histogram-fusion-stack -p ka", 4), "kappa=\n");
}

} // namespace
} // namespace rayloom::test
