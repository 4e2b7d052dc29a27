// SPDX-License-Identifier: Apache-2.0
// What a graph file means: conditions, graphs as nodes, mapping over lists, facts about pixels.
#include "rayloom/engine/plan.h"
#include "rayloom/engine/run.h"

#include "rayloom/graph/reader.h"
#include "tests/support/command.h"
#include "tests/support/engine_nodes_for_tests.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

namespace rayloom::test
{
namespace
{

using ::testing::Contains;
using ::testing::HasSubstr;

std::shared_ptr<MemoryImage> flat_image(float value, int channels = 3)
{
    auto image = noise_image({0, 0, 9, 7}, channels);
    image->pixels.fill(value);
    return image;
}

float first_pixel(const MemoryImage& image)
{
    return image.pixels.view().at(0, image.desc.data.x0, image.desc.data.y0);
}

class PlanTest : public ::testing::Test
{
protected:
    void SetUp() override { register_engine_nodes(); }

    static RunReport run(const std::string& text, const std::map<std::string, InputBinding>& inputs,
                         const RunOptions& options = {})
    {
        const Graph graph = parse_graph(text, "plan.yaml");
        RunRequest request;
        for (const auto& [name, binding] : inputs) request.inputs[name] = binding;
        return run_graph(graph, request, options);
    }
    static InputBinding one(std::shared_ptr<const MemoryImage> image)
    {
        InputBinding binding;
        binding.images = {std::move(image)};
        return binding;
    }
    static InputBinding list(std::initializer_list<float> values)
    {
        InputBinding binding;
        binding.is_list = true;
        for (const float v : values) binding.images.push_back(flat_image(v));
        return binding;
    }
    static std::string error_of(const std::string& text,
                                const std::map<std::string, InputBinding>& inputs)
    {
        try {
            run(text, inputs);
        } catch (const Error& e) {
            return e.what();
        }
        return "no error";
    }
};

TEST_F(PlanTest, AScalarParameterGoesElementByElementAndTheLastRepeats)
{
    const RunReport r = run("rayloom: 1\nname: g\ninputs: {stack: {kind: list}}\n"
                            "nodes:\n  scaled: {op: engine.gain, image: stack, factor: [2, 3]}\n"
                            "outputs: {image: scaled}\n",
                            {{"stack", list({1, 10, 100})}});
    const auto& images = r.images.at("image");
    ASSERT_EQ(images.size(), 3u);
    EXPECT_EQ(first_pixel(images[0]), 2.0f);
    EXPECT_EQ(first_pixel(images[1]), 30.0f);
    EXPECT_EQ(first_pixel(images[2]), 300.0f);
}

TEST_F(PlanTest, AListForANodeThatIsNotMappedIsAMistake)
{
    EXPECT_EQ(error_of("rayloom: 1\nname: g\ninputs: {color: any}\n"
                       "nodes:\n  scaled: {op: engine.gain, image: color, factor: [2, 3]}\n"
                       "outputs: {image: scaled}\n",
                       {{"color", one(flat_image(1))}}),
              "plan.yaml:5:51: node 'scaled' (engine.gain): parameter 'factor' takes one value; a "
              "list of values goes "
              "along a list of images, and no input here is one");
}

TEST_F(PlanTest, ConditionsChooseBranches)
{
    const std::string text =
        "rayloom: 1\nname: g\nparams: {strong: false}\n"
        "inputs: {color: any, extra: {optional: true}}\nnodes:\n"
        "  a: {op: engine.gain, image: color, factor: 2, when: $strong, otherwise: color}\n"
        "  b: {op: engine.gain, image: extra, factor: 5, when: has(extra), otherwise: a}\n"
        "  c: {op: engine.gain, image: b, factor: 10, when: channels(b) == 4, otherwise: b}\n"
        "outputs: {image: c}\n";
    EXPECT_EQ(first_pixel(run(text, {{"color", one(flat_image(1))}}).images.at("image")[0]), 1.0f);
    EXPECT_EQ(first_pixel(run(text, {{"color", one(flat_image(1))}, {"extra", one(flat_image(3))}})
                              .images.at("image")[0]),
              15.0f);
    EXPECT_EQ(first_pixel(run(text, {{"color", one(flat_image(1, 4))}}).images.at("image")[0]),
              10.0f);
    Graph graph = parse_graph(text, "plan.yaml");
    RunRequest request;
    request.inputs["color"] = one(flat_image(1));
    request.param_texts["strong"] = "true";
    EXPECT_EQ(first_pixel(run_graph(graph, request).images.at("image")[0]), 2.0f);
}

TEST_F(PlanTest, WhatNeedsAnAbsentInputIsAbsentToo)
{
    const std::string text =
        "rayloom: 1\nname: g\ninputs: {color: any, extra: {optional: true}}\nnodes:\n"
        "  a: {op: engine.gain, image: extra, factor: 2}\n"
        "  b: {op: engine.box, image: a}\n"
        "  s: {op: engine.sum, images: [color, b]}\n"
        "outputs: {image: s, other: b}\n";
    const RunReport r = run(text, {{"color", one(flat_image(1))}});
    EXPECT_EQ(first_pixel(r.images.at("image")[0]), 1.0f);
    EXPECT_FALSE(r.images.contains("other"));
    RunRequest request;
    request.inputs["color"] = one(flat_image(1));
    request.outputs["other"] = {};
    const Graph graph = parse_graph(text, "plan.yaml");
    try {
        make_plan(graph, request);
        FAIL() << "planned an output that cannot be made";
    } catch (const GraphError& e) {
        EXPECT_THAT(e.what(), HasSubstr("output 'other' cannot be made"));
    }
}

TEST_F(PlanTest, BlackImagesAreKnownAndMakeNoDifferenceWithoutShortcuts)
{
    const std::string text = "rayloom: 1\nname: g\ninputs: {color: any, glossy: any}\nnodes:\n"
                             "  g: {op: engine.box, image: glossy, when: not black(glossy)}\n"
                             "  s: {op: engine.sum, images: [color, g]}\n"
                             "outputs: {image: s}\n";
    const Graph graph = parse_graph(text, "plan.yaml");
    RunRequest request;
    request.inputs["color"] = one(flat_image(1));
    request.inputs["glossy"] = one(flat_image(0));
    const Plan plan = make_plan(graph, request);
    EXPECT_THAT(plan.pruned, Contains(::testing::Field(&PrunedNode::id, "g")));
    EXPECT_EQ(first_pixel(run_graph(graph, request).images.at("image")[0]), 1.0f);
    // One pixel is enough to be seen.
    auto spark = flat_image(0);
    spark->pixels.view().at(2, 8, 6) = 1e-20f;
    request.inputs["glossy"] = one(spark);
    EXPECT_THAT(make_plan(graph, request).pruned, ::testing::IsEmpty());
}

TEST_F(PlanTest, GraphsAreNodes)
{
    const TemporaryFolder folder;
    std::ofstream(folder.path() / "inner.yaml")
        << "rayloom: 1\nname: inner\nparams: {gain: 2.0}\n"
           "inputs: {color: any, more: {optional: true}}\nnodes:\n"
           "  a: {op: engine.gain, image: color, factor: $gain}\n"
           "  s: {op: engine.sum, images: [a, more]}\n"
           "outputs: {image: s, plain: color}\n";
    const std::string text =
        "rayloom: 1\nname: outer\ninputs: {stack: {kind: list}, color: any}\nnodes:\n"
        "  each: {op: 'graph:inner.yaml', color: stack, gain: [3, 4]}\n"
        "  both: {op: 'graph:inner.yaml', color: 'each.image[0]', more: color, gain: 10}\n"
        "  all: {op: engine.sum, images: each}\n"
        "outputs: {both: both, all: all, list: each}\n";
    const Graph graph = parse_graph(text, "outer.yaml", folder.path().string());
    RunRequest request;
    request.inputs["stack"] = list({1, 100});
    request.inputs["color"] = one(flat_image(7));
    const RunReport r = run_graph(graph, request);
    EXPECT_EQ(first_pixel(r.images.at("both")[0]), 37.0f);
    EXPECT_EQ(first_pixel(r.images.at("all")[0]), 403.0f);
    EXPECT_EQ(r.images.at("list").size(), 2u);
}

/// Writes graphs a parameter can name: they give `image` from `color`.
void write_filters(const std::filesystem::path& folder)
{
    const std::string begin = "rayloom: 1\n";
    std::ofstream(folder / "gain.yaml")
        << begin << "params: {gain: 2.0}\ninputs: {color: any, more: {optional: true}}\nnodes:\n"
        << "  a: {op: engine.gain, image: color, factor: $gain}\n"
        << "  s: {op: engine.sum, images: [a, more]}\noutputs: {image: s}\n";
    // Knows neither `more` nor `gain`.
    std::ofstream(folder / "tenfold.yaml")
        << begin << "inputs: {color: any}\nnodes:\n"
        << "  a: {op: engine.gain, image: color, factor: 10}\noutputs: {result: a}\n";
    std::ofstream(folder / "asks.yaml")
        << begin << "inputs: {color: any, flash: any}\nnodes:\n"
        << "  a: {op: engine.sum, images: [color, flash]}\noutputs: {result: a}\n";
    std::ofstream(folder / "bad.yaml") << begin << "inputs: {color: any}\nnodes:\n"
                                       << "  a: {op: engine.gian, image: color}\n"
                                       << "outputs: {image: a}\n";
    std::ofstream(folder / "middle.yaml")
        << begin << "params: {filter: 'graph:tenfold.yaml'}\ninputs: {color: any}\nnodes:\n"
        << "  a: {op: $filter, color: color}\noutputs: {image: a}\n";
    std::ofstream(folder / "self.yaml")
        << begin << "params: {filter: 'graph:tenfold.yaml'}\ninputs: {color: any}\nnodes:\n"
        << "  a: {op: 'graph:middle.yaml', filter: 'graph:self.yaml', color: color}\n"
        << "outputs: {image: a}\n";
}

const std::string filtered = "rayloom: 1\nname: outer\nparams: {filter: 'graph:gain.yaml'}\n"
                             "inputs: {color: any, more: any}\nnodes:\n"
                             "  f: {op: $filter, color: color, more: more, gain: 3}\n"
                             "outputs: {image: f}\n";

TEST_F(PlanTest, AParameterNamesTheGraphOfANode)
{
    const TemporaryFolder folder;
    write_filters(folder.path());
    const Graph graph = parse_graph(filtered, "outer.yaml", folder.path().string());
    RunRequest request;
    request.inputs["color"] = one(flat_image(7));
    request.inputs["more"] = one(flat_image(100));
    EXPECT_EQ(first_pixel(run_graph(graph, request).images.at("image")[0]), 121.0f);

    request.params["filter"] = "graph:" + (folder.path() / "tenfold.yaml").string();
    const RunReport ten = run_graph(graph, request);
    EXPECT_EQ(first_pixel(ten.images.at("image")[0]), 70.0f);
    EXPECT_THAT(ten.notes, Contains(HasSubstr("does without 'more' and 'gain'")));

    // From a command line a path is relative to the folder the command runs in.
    const auto before = std::filesystem::current_path();
    std::filesystem::current_path(folder.path());
    request.params.clear();
    request.param_texts["filter"] = "graph:tenfold.yaml";
    const Plan plan =
        make_plan(parse_graph(filtered, "outer.yaml", folder.path().string()), request);
    std::filesystem::current_path(before);
    EXPECT_THAT(plan.ops, Contains(::testing::Field(&PlannedOp::id, "f/a")));

    // Any node will do that has the inputs.
    request.param_texts["filter"] = "engine.nothing";
    EXPECT_THROW(make_plan(graph, request), GraphError);
}

TEST_F(PlanTest, AParameterThatNamesAGraphGoesThroughGraphs)
{
    const TemporaryFolder folder;
    write_filters(folder.path());
    const auto text = [](const std::string& value) {
        return "rayloom: 1\nname: outer\nparams: {inside: 'graph:tenfold.yaml'}\n"
               "inputs: {color: any}\nnodes:\n"
               "  f: {op: 'graph:middle.yaml', color: color, filter: " +
               value + "}\noutputs: {image: f}\n";
    };
    RunRequest request;
    request.inputs["color"] = one(flat_image(7));
    const auto result = [&](const std::string& value) {
        const Graph graph = parse_graph(text(value), "outer.yaml", folder.path().string());
        return first_pixel(run_graph(graph, request).images.at("image")[0]);
    };
    EXPECT_EQ(result("'graph:tenfold.yaml'"), 70.0f);
    EXPECT_EQ(result("'graph:gain.yaml'"), 14.0f);
    EXPECT_EQ(result("$inside"), 70.0f);
    request.params["inside"] = "graph:" + (folder.path() / "gain.yaml").string();
    EXPECT_EQ(result("$inside"), 14.0f);
}

TEST_F(PlanTest, AGraphThatDoesNotFitIsRefusedWhereItIsUsed)
{
    const TemporaryFolder folder;
    write_filters(folder.path());
    const auto error = [&](const std::string& text, const std::string& filter) {
        RunRequest request;
        request.inputs["color"] = one(flat_image(7));
        request.inputs["more"] = one(flat_image(1));
        if (!filter.empty())
            request.params["filter"] = "graph:" + (folder.path() / filter).string();
        try {
            make_plan(parse_graph(text, "outer.yaml", folder.path().string()), request);
        } catch (const Error& e) {
            return std::string(e.what());
        }
        return std::string("no error");
    };
    EXPECT_THAT(error(filtered, "asks.yaml"),
                AllOf(HasSubstr("outer.yaml:6:3: node 'f' (graph:/"),
                      HasSubstr("asks.yaml): input 'flash' is missing")));
    EXPECT_THAT(error(filtered, "bad.yaml"),
                HasSubstr("bad.yaml:4:11: node 'a': op 'engine.gian' is not known; did you mean "
                          "'engine.gain'?"));
    EXPECT_THAT(error(filtered, "absent.yaml"), HasSubstr("absent.yaml' was not found"));
    const auto with = [](const std::string& param) {
        std::string text = filtered;
        return text.replace(text.find("{filter: 'graph:gain.yaml'}"), 27, param);
    };
    EXPECT_THAT(error(with("{filtre: 'graph:gain.yaml'}"), ""),
                HasSubstr("outer.yaml:6:11: node 'f': op '$filter' is not declared under params; "
                          "did you mean 'filtre'?"));
    EXPECT_THAT(error(with("{filter: {type: string}}"), ""),
                HasSubstr("outer.yaml:6:11: node 'f': op '$filter' wants a parameter with a "
                          "default"));
    EXPECT_THAT(error(with("{filter: 2}"), ""),
                HasSubstr("op '$filter' wants a parameter of type string, not of type int"));
    // A slip is told from what a chosen graph does not have.
    std::string slip = filtered;
    slip.replace(slip.find("gain: 3"), 7, "gian: 3");
    EXPECT_THAT(error(slip, "tenfold.yaml"), HasSubstr("'gian'"));
    EXPECT_THAT(error("rayloom: 1\ninputs: {color: any, more: any}\nnodes:\n"
                      "  f: {op: 'graph:self.yaml', color: color}\noutputs: {image: f}\n",
                      ""),
                HasSubstr("the graph uses itself"));
}

TEST_F(PlanTest, ListsThatDoNotFitTogetherAreNamed)
{
    const std::string text =
        "rayloom: 1\nname: g\ninputs: {a: {kind: list}, b: {kind: list}}\nnodes:\n"
        "  t: {op: engine.total, image: b}\n"
        "  s: {op: engine.shift, image: a, figures: t.figures}\n"
        "outputs: {image: s}\n";
    EXPECT_THAT(
        error_of(text, {{"a", list({1, 2})}, {"b", list({1, 2, 3})}}),
        HasSubstr("node 's' (engine.shift): input 'figures' is a list of 3 where 'image' has 2"));
    const RunReport r = run(text, {{"a", list({1, 2})}, {"b", list({0, 1})}});
    EXPECT_EQ(first_pixel(r.images.at("image")[0]), 1.0f);
    EXPECT_EQ(first_pixel(r.images.at("image")[1]), 2.0f + 9 * 7 * 3);
}

TEST_F(PlanTest, EveryMistakeOfThePlanIsReportedAtOnce)
{
    const std::string text =
        "rayloom: 1\nname: g\ninputs: {color: any}\nnodes:\n"
        "  h: {op: fuse.histogram, image: color, histogram: 'p[1]'}\n"
        "  p: {op: multiscale.pyramid, image: color, scales: 2, conserve: sum}\n"
        "  k: {op: fuse.histogram, image: 'p[1]', histogram: color}\n"
        "outputs: {image: h, levels: p, k: k}\n";
    const std::string errors = error_of(text, {{"color", one(flat_image(1))}});
    EXPECT_THAT(errors, HasSubstr("plan.yaml:5:3: node 'h' (fuse.histogram): "));
    EXPECT_THAT(errors, HasSubstr("plan.yaml:7:3: node 'k' (fuse.histogram): "));
}

} // namespace
} // namespace rayloom::test
