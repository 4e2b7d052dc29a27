// SPDX-License-Identifier: Apache-2.0
#include "tests/support/folders.h"
#include "tests/support/render_data.h"

#include <gtest/gtest.h>

#include <cmath>

namespace rayloom
{
namespace
{

using test::make_image;
using test::run_node;
using test::TestImage;

const std::vector<std::string> rgb{"R", "G", "B"};

TEST(Flash, PassesOfARenderMakeItsPartialLight)
{
    const auto scene = test::source_folder() / "tests/data/cycles/interior";
    const auto file = scene / "noisy_16.exr";
    const std::vector<std::pair<const char*, const char*>> passes{
        {"diffuse_direct", "DiffDir"},
        {"diffuse_color", "DiffCol"},
        {"glossy_direct", "GlossDir"},
        {"glossy_indirect", "GlossInd"},
        {"glossy_color", "GlossCol"},
        {"transmission_direct", "TransDir"},
        {"transmission_indirect", "TransInd"},
        {"transmission_color", "TransCol"},
        {"emission", "Emit"},
        {"environment", "Env"}};
    std::vector<TestImage> images;
    for (const auto& [port, pass] : passes)
        images.push_back(test::read_render(file, std::string("ViewLayer.") + pass));
    std::vector<test::NodeInput> inputs;
    for (std::size_t i = 0; i < passes.size(); ++i)
        inputs.push_back({passes[i].first, {&images[i]}});
    const test::NodeRun run = run_node("transform.flash", {}, inputs);
    // The first part of the file is the same sum, made by another program and rounded to half.
    const TestImage ready = test::read_render(scene / "flash_16.exr");
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < 96; ++y)
            for (int x = 0; x < 96; ++x) {
                const float truth = ready.view().at(c, x, y);
                ASSERT_NEAR(run.image().view().at(c, x, y), truth,
                            2e-3f * std::fabs(truth) + 1e-5f);
            }
}

TEST(Flash, LobesWithoutAColourAreTakenAsTheyAre)
{
    const Region window{0, 0, 4, 3};
    const TestImage a =
        make_image(window, rgb, [](int c, int x, int y) { return static_cast<float>(c + x + y); });
    const TestImage b =
        make_image(window, rgb, [](int, int x, int) { return 0.5f * static_cast<float>(x); });
    const test::NodeRun run =
        run_node("transform.flash", {{"intensity_factor", 2.0}},
                 {{"glossy_direct", {&a}}, {"glossy_indirect", {&b}}, {"flash_unit", {&b}}});
    EXPECT_EQ(run.image().view().at(2, 3, 1), 6.0f + 1.5f + 3.0f);
}

TEST(Flash, EitherPartialOrPasses)
{
    const TestImage a = make_image({0, 0, 4, 3}, rgb, [](int, int, int) { return 1.0f; });
    EXPECT_THROW(run_node("transform.flash", {}, {}), NodeError);
    EXPECT_THROW(run_node("transform.flash", {}, {{"partial", {&a}}, {"emission", {&a}}}),
                 NodeError);
    const TestImage other = make_image({0, 0, 5, 3}, rgb, [](int, int, int) { return 1.0f; });
    EXPECT_THROW(run_node("transform.flash", {}, {{"partial", {&a}}, {"flash_unit", {&other}}}),
                 NodeError);
}

} // namespace
} // namespace rayloom
