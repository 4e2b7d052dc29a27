// SPDX-License-Identifier: Apache-2.0
#include "nodes/fuse/nlm_kernel.h"
#include "rayloom/core/registry.h"
#include "tests/oracle/nlm.h"
#include "tests/support/folders.h"
#include "tests/support/render_data.h"
#include "tests/support/run_node.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <random>

namespace rayloom
{
namespace
{

using test::differing_floats;
using test::make_image;
using test::NodeRun;
using test::run_node;
using test::TestImage;

const std::vector<std::string> rgb{"R", "G", "B"};

/// Everything a run of fuse.nlm takes, frame by frame.
struct Case {
    std::vector<TestImage> image, guide, guide_variance, low, high;

    std::vector<test::NodeInput> inputs() const
    {
        std::vector<test::NodeInput> all;
        const auto add = [&](const char* port, const std::vector<TestImage>& images) {
            if (images.empty()) return;
            all.push_back({port, {}, nullptr, true});
            for (const TestImage& i : images) all.back().images.push_back(&i);
        };
        add("image", image);
        add("guide", guide);
        add("guide_variance", guide_variance);
        add("low", low);
        add("high", high);
        return all;
    }
};

/// Noisy regions of different brightness; `brightness` scales everything.
Case random_case(const Region& data, int frames, unsigned seed, float brightness = 1.0f,
                 int channels = 3, int guides = 3)
{
    std::mt19937 random(seed);
    std::lognormal_distribution<float> noise(0.0f, 0.8f);
    std::normal_distribution<float> normal(0.0f, 0.05f);
    std::uniform_real_distribution<float> unit(0.0f, 1.0f);
    const auto names = [](int n) {
        return n == 3 ? rgb : std::vector<std::string>(static_cast<std::size_t>(n), "Y");
    };
    Case c;
    for (int f = 0; f < frames; ++f) {
        const auto scene = [&](int x, int y) { return (x + f) / 7 % 2 == y / 9 % 2 ? 0.3f : 1.1f; };
        c.image.push_back(make_image(data, names(channels), [&](int, int x, int y) {
            return brightness * scene(x, y) * noise(random);
        }));
        c.guide.push_back(make_image(
            data, names(guides), [&](int, int x, int y) { return scene(x, y) + normal(random); }));
        c.guide_variance.push_back(make_image(
            data, {"Y"}, [&](int, int, int) { return 0.0005f + 0.004f * unit(random); }));
        std::vector<float> width;
        const ConstImageView image = c.image.back().view();
        c.low.push_back(make_image(data, names(channels), [&](int, int, int) { return 0.0f; }));
        c.high.push_back(make_image(data, names(channels), [&](int, int, int) { return 0.0f; }));
        for (int y = data.y0; y < data.y1; ++y)
            for (int x = data.x0; x < data.x1; ++x)
                for (int k = 0; k < channels; ++k) {
                    const float h = unit(random) < 0.1f ? 0.0f : 0.6f * brightness * unit(random);
                    c.low.back().view().at(k, x, y) = image.at(k, x, y) - h;
                    c.high.back().view().at(k, x, y) = image.at(k, x, y) + h;
                }
    }
    return c;
}

ParamValues params(const std::string& gate, int window = 31, int patch = 5, int patch_frames = 1)
{
    return {{"gate", gate},
            {"window", std::int64_t{window}},
            {"patch", std::int64_t{patch}},
            {"patch_frames", std::int64_t{patch_frames}}};
}

oracle::NlmGate gate_of(const std::string& name)
{
    return name == "none"         ? oracle::NlmGate::none
           : name == "one-sample" ? oracle::NlmGate::one_sample
                                  : oracle::NlmGate::two_sample;
}

oracle::NlmResult<double> expected(const Case& c, const oracle::NlmSettings& settings,
                                   std::size_t centre = 0)
{
    std::vector<oracle::NlmFrame> frames;
    for (std::size_t f = 0; f < c.image.size(); ++f)
        frames.push_back({c.image[f].view(), c.guide[f].view(), c.guide_variance[f].view(),
                          c.low[f].view(), c.high[f].view()});
    return oracle::filter_nlm<double>(frames, centre, settings, c.image.front().desc.data);
}

/// Compares pixels whose gates do not hang on rounding; `tolerance` is relative to `scale`.
void expect_as_oracle(const TestImage& image, const oracle::NlmResult<double>& oracle,
                      double tolerance, double scale)
{
    const Region& r = image.desc.data;
    std::size_t ambiguous = 0;
    double worst = 0.0;
    for (int c = 0; c < image.desc.channel_count(); ++c)
        for (int y = r.y0; y < r.y1; ++y)
            for (int x = r.x0; x < r.x1; ++x) {
                const std::size_t at =
                    static_cast<std::size_t>(y - r.y0) * static_cast<std::size_t>(r.width()) +
                    static_cast<std::size_t>(x - r.x0);
                if (oracle.ambiguous[at]) {
                    ++ambiguous;
                    continue;
                }
                const double truth = oracle.pixels[static_cast<std::size_t>(c) * r.pixels() + at];
                worst = std::max(worst,
                                 std::fabs(static_cast<double>(image.view().at(c, x, y)) - truth) /
                                     scale);
            }
    EXPECT_LT(worst, tolerance);
    EXPECT_LT(ambiguous, r.pixels() * 3 / 50 + 1);
}

struct OracleCase {
    const char* name;
    Region data;
    const char* gate;
    int window, patch;
    float brightness = 1.0f;
    int channels = 3, guides = 3;
};
void PrintTo(const OracleCase& o, std::ostream* to) { *to << o.name; }

class NlmAgainstOracle : public testing::TestWithParam<OracleCase>
{
};

TEST_P(NlmAgainstOracle, SamePixels)
{
    const OracleCase& o = GetParam();
    const Case c = random_case(o.data, 1, 3, o.brightness, o.channels, o.guides);
    const NodeRun run = run_node("fuse.nlm", params(o.gate, o.window, o.patch), c.inputs());
    oracle::NlmSettings settings;
    settings.gate = gate_of(o.gate);
    settings.window = o.window;
    settings.patch = o.patch;
    settings.sigma_s = o.window / 3.0;
    expect_as_oracle(run.image(), expected(c, settings), 2e-5, static_cast<double>(o.brightness));
}

INSTANTIATE_TEST_SUITE_P(
    Cases, NlmAgainstOracle,
    testing::Values(OracleCase{"none", {0, 0, 40, 30}, "none", 15, 5},
                    OracleCase{"one_sample", {-5, 3, 35, 33}, "one-sample", 15, 5},
                    OracleCase{"two_sample", {-5, 3, 35, 33}, "two-sample", 15, 3},
                    OracleCase{"patch_1", {0, 0, 33, 20}, "two-sample", 9, 1},
                    OracleCase{"window_wider_than_image", {0, 0, 9, 5}, "two-sample", 31, 5},
                    OracleCase{"patch_wider_than_image", {7, 7, 10, 8}, "none", 31, 9},
                    OracleCase{"one_pixel", {0, 0, 1, 1}, "two-sample", 7, 5},
                    OracleCase{"patch_11", {0, 0, 30, 22}, "one-sample", 9, 11},
                    OracleCase{"patch_13", {0, 0, 30, 22}, "two-sample", 9, 13},
                    OracleCase{"wide_window", {0, 0, 60, 24}, "one-sample", 43, 7},
                    OracleCase{"seven_channels", {0, 0, 25, 20}, "one-sample", 7, 5, 1.0f, 7, 3},
                    OracleCase{"eight_channels", {0, 0, 25, 20}, "none", 7, 9, 1.0f, 8, 1},
                    OracleCase{"dim", {0, 0, 25, 20}, "two-sample", 7, 5, 1e-8f},
                    OracleCase{"bright", {0, 0, 25, 20}, "one-sample", 7, 5, 1e8f},
                    OracleCase{
                        "grey_and_two_guides", {0, 0, 25, 20}, "two-sample", 7, 5, 1.0f, 1, 2}),
    [](const auto& test) { return std::string(test.param.name); });

TEST(Nlm, FramesAndPatchesOverFramesAreAsTheOracleHasThem)
{
    const Case c = random_case({0, 0, 24, 18}, 4, 5);
    const TestImage none = make_image({0, 0, 24, 18}, rgb, [](int, int, int) { return 0.0f; });
    for (const int patch_frames : {1, 3}) {
        auto inputs = c.inputs();
        inputs.push_back({"earlier", {&none, &none}, nullptr, true});
        for (const char* gate : {"one-sample", "two-sample"}) {
            const NodeRun run = run_node("fuse.nlm", params(gate, 7, 3, patch_frames), inputs);
            oracle::NlmSettings settings;
            settings.gate = gate_of(gate);
            settings.window = 7;
            settings.patch = 3;
            settings.patch_frames = patch_frames;
            settings.sigma_s = 7.0 / 3.0;
            expect_as_oracle(run.image(), expected(c, settings, 2), 2e-5, 1.0);
        }
    }
}

TEST(Nlm, TilesAndSimdTargetsChangeNoBit)
{
    const Case c = random_case({-9, 4, 51, 60}, 2, 11);
    for (const char* gate : {"one-sample", "two-sample", "none"}) {
        const NodeRun whole = run_node("fuse.nlm", params(gate, 13, 5), c.inputs());
        for (const int tile : {16, 37}) {
            test::RunOptions options;
            options.tile_width = tile;
            options.tile_height = tile - 3;
            EXPECT_EQ(differing_floats(
                          run_node("fuse.nlm", params(gate, 13, 5), c.inputs(), options).image(),
                          whole.image()),
                      0u);
        }
        for (const auto target : hwy::SupportedAndGeneratedTargets()) {
            hwy::SetSupportedTargetsForTest(target);
            EXPECT_EQ(
                differing_floats(run_node("fuse.nlm", params(gate, 13, 5), c.inputs()).image(),
                                 whole.image()),
                0u)
                << hwy::TargetName(target);
        }
        hwy::SetSupportedTargetsForTest(0);
    }
}

TEST(Nlm, PowerOfTwoIsWithinItsBound)
{
    std::vector<float> x, y;
    for (float v = 0.0f; v < 130.0f; v += 0.0137f) x.push_back(v);
    x.push_back(1e-30f);
    y.resize(x.size());
    nlm_power_of_two_negative(x, y);
    for (std::size_t i = 0; i < x.size(); ++i) {
        const double truth = std::exp2(-static_cast<double>(x[i]));
        if (x[i] >= 115.0f)
            EXPECT_EQ(y[i], 0.0f);
        else
            EXPECT_NEAR(static_cast<double>(y[i]) / truth, 1.0, 3e-7) << x[i];
    }
    EXPECT_EQ(y[0], 1.0f);
}

TEST(Nlm, AConstantImageStaysConstant)
{
    Case c = random_case({0, 0, 40, 40}, 1, 2);
    for (std::size_t f = 0; f < 1; ++f) {
        c.image[f].pixels.fill(0.7f);
        c.low[f].pixels.fill(0.7f);
        c.high[f].pixels.fill(0.7f);
    }
    for (const char* gate : {"one-sample", "two-sample", "none"}) {
        const NodeRun run = run_node("fuse.nlm", params(gate, 15, 5), c.inputs());
        for (int y = 0; y < 40; ++y)
            for (int x = 0; x < 40; ++x)
                for (int k = 0; k < 3; ++k)
                    ASSERT_NEAR(run.image().view().at(k, x, y), 0.7f, 2e-6f) << gate;
    }
}

TEST(Nlm, AConstantGuideAndAnInfiniteIntervalGiveThePlainGaussian)
{
    Case c = random_case({0, 0, 45, 35}, 1, 9);
    c.guide[0].pixels.fill(0.4f);
    c.low[0].pixels.fill(-1e30f);
    c.high[0].pixels.fill(1e30f);
    const double sigma = 21.0 / 3.0;
    for (const char* gate : {"one-sample", "none"}) {
        const NodeRun run = run_node("fuse.nlm", params(gate, 21, 5), c.inputs());
        for (int y = 0; y < 35; ++y)
            for (int x = 0; x < 45; ++x) {
                double sum = 0.0, total = 0.0;
                for (int v = std::max(0, y - 10); v <= std::min(34, y + 10); ++v)
                    for (int u = std::max(0, x - 10); u <= std::min(44, x + 10); ++u) {
                        const double w = std::exp(-((u - x) * (u - x) + (v - y) * (v - y)) /
                                                  (2.0 * sigma * sigma));
                        sum += w * static_cast<double>(c.image[0].view().at(1, u, v));
                        total += w;
                    }
                ASSERT_NEAR(static_cast<double>(run.image().view().at(1, x, y)), sum / total, 1e-5);
            }
    }
}

TEST(Nlm, NoNoiseInTheGuideMeansNoMixingAcrossIt)
{
    Case c = random_case({0, 0, 30, 20}, 1, 4);
    c.guide_variance[0].pixels.fill(0.0f);
    c.guide[0] = make_image({0, 0, 30, 20}, rgb, [](int k, int x, int y) {
        return static_cast<float>(k + x * 31 + y * 7);
    });
    const NodeRun run = run_node("fuse.nlm", params("none", 15, 3), c.inputs());
    EXPECT_EQ(differing_floats(run.image(), c.image[0]), 0u);
}

TEST(Nlm, VarianceOfTheResultIsThatOfItsWeights)
{
    const Case c = random_case({0, 0, 20, 20}, 1, 6);
    const TestImage one = make_image({0, 0, 20, 20}, rgb, [](int, int, int) { return 1.0f; });
    auto inputs = c.inputs();
    inputs.push_back({"variance", {&one}, nullptr, true});
    const NodeRun run = run_node("fuse.nlm", params("none", 9, 3), inputs);
    oracle::NlmSettings settings;
    settings.gate = oracle::NlmGate::none;
    settings.window = 9;
    settings.patch = 3;
    settings.sigma_s = 3.0;
    const oracle::NlmResult<double> truth = expected(c, settings);
    for (int y = 0; y < 20; ++y)
        for (int x = 0; x < 20; ++x)
            ASSERT_NEAR(static_cast<double>(run.image("variance").view().at(2, x, y)),
                        truth.variances[static_cast<std::size_t>(y * 20 + x)], 1e-6);
}

/// Mean, interval and guide of a real render.
struct Render {
    TestImage mean, variance;
    NodeRun interval, noise;
};
Render real_render(const char* scene, int samples)
{
    const auto folder = test::source_folder() / "tests/data/cycles" / scene;
    const auto stack = test::read_stack(folder, samples);
    std::vector<const TestImage*> images;
    for (const TestImage& i : stack) images.push_back(&i);
    NodeRun statistics = run_node("transform.statistics", {}, {{"stack", images, nullptr, true}});
    Render r{std::move(statistics.outputs.at("mean").front()),
             std::move(statistics.outputs.at("variance").front()),
             {},
             {}};
    r.interval = run_node("threshold.interval", {{"samples", static_cast<double>(samples)}},
                          {{"mean", {&r.mean}}, {"variance", {&r.variance}}});
    r.noise = run_node("transform.local_variance", {}, {{"image", {&r.mean}}});
    return r;
}

TEST(Nlm, TheResultLiesInTheIntervalInEveryPixelAndChannelOfARender)
{
    for (const char* scene : {"caustics", "interior", "dof"}) {
        const Render r = real_render(scene, 8);
        const auto check = [&](const ParamValues& p, const std::vector<test::NodeInput>& more) {
            std::vector<test::NodeInput> inputs{{"image", {&r.mean}},
                                                {"guide_variance", {&r.noise.image("variance")}},
                                                {"low", {&r.interval.image("low")}},
                                                {"high", {&r.interval.image("high")}}};
            inputs.insert(inputs.end(), more.begin(), more.end());
            const NodeRun run = run_node("fuse.nlm", p, inputs);
            const Region& d = r.mean.desc.data;
            std::size_t outside = 0;
            for (int c = 0; c < 3; ++c)
                for (int y = d.y0; y < d.y1; ++y)
                    for (int x = d.x0; x < d.x1; ++x) {
                        const float v = run.image().view().at(c, x, y);
                        if (!(v >= r.interval.image("low").view().at(c, x, y) &&
                              v <= r.interval.image("high").view().at(c, x, y)))
                            ++outside;
                    }
            EXPECT_EQ(outside, 0u) << scene;
        };
        check(params("one-sample"), {});
        ParamValues clamped = params("two-sample");
        clamped["clamp"] = std::string("interval");
        check(clamped, {});
    }
}

std::string error_of(const ParamValues& p, const std::vector<test::NodeInput>& inputs)
{
    try {
        run_node("fuse.nlm", p, inputs);
    } catch (const Error& e) {
        return e.what();
    }
    return "no error";
}

TEST(Nlm, MistakesAreExplained)
{
    const Case c = random_case({0, 0, 12, 10}, 1, 1);
    const TestImage& image = c.image[0];
    EXPECT_EQ(error_of(params("none", 4), {{"image", {&image}}}),
              "window is 4; it must be odd, so that there is a middle (3 or 5)");
    EXPECT_EQ(error_of(params("two-sample"), {{"image", {&image}}}),
              "gate 'two-sample' and clamp 'none' need the inputs low and high (from "
              "threshold.interval); without sample statistics set gate: none and clamp: none");
    const TestImage other = make_image({0, 0, 11, 10}, rgb, [](int, int, int) { return 0.0f; });
    EXPECT_NE(error_of(params("none"), {{"image", {&image}}, {"guide", {&other}}}).find("11x10"),
              std::string::npos);
    EXPECT_EQ(
        error_of(params("none"), {{"image", {&image, &image}, nullptr, true}, {"guide", {&image}}}),
        "'image' has 2 frames and 'guide' 1; every list must have one element a frame");
    EXPECT_EQ(error_of(params("none"), {{"image", {&image}}, {"earlier", {&image}}}),
              "there are 1 earlier frames and 1 in 'image', which must hold them and the current "
              "frame");
}

} // namespace
} // namespace rayloom
