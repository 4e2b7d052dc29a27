// SPDX-License-Identifier: Apache-2.0
// graphs/pivot-lobes.yaml on real renders.
#include "rayloom/engine/run.h"
#include "rayloom/graph/reader.h"
#include "tests/support/render_data.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

namespace rayloom::test
{
namespace
{

const std::filesystem::path source = RAYLOOM_SOURCE_DIR;

/// Mean of (difference² / (reference² + 0.01)) over the colours of both windows' overlap.
double relative_error(ConstImageView image, ConstImageView reference)
{
    const Region both = image.region().intersect(reference.region());
    double sum = 0.0;
    for (int c = 0; c < 3; ++c)
        for (int y = both.y0; y < both.y1; ++y)
            for (int x = both.x0; x < both.x1; ++x) {
                const double r = reference.at(c, x, y), d = image.at(c, x, y) - r;
                sum += d * d / (r * r + 0.01);
            }
    return sum / static_cast<double>(3 * both.pixels());
}

TEST(PivotGraph, InteriorLosesAtLeastFiveSixthsOfItsError)
{
    const auto folder = source / "tests/data/cycles/interior";
    RunRequest request;
    request.inputs["render"].files = {{(folder / "noisy_16.exr").string(), ""}};
    const RunReport report =
        run_graph(read_graph((source / "graphs/pivot-lobes.yaml").string()), request, {});
    const TestImage noisy = read_render(folder / "noisy_16.exr", "ViewLayer.Combined"),
                    reference = read_render(folder / "ref.exr", "ViewLayer.Combined");
    const MemoryImage& result = report.images.at("image")[0];
    const double before = relative_error(noisy.view(), reference.view());
    const double after = relative_error(result.pixels.view(), reference.view());
    EXPECT_GT(before, 0.05);
    EXPECT_LT(after, before / 6.0);
}

TEST(PivotGraph, OtherLayersStayBitForBit)
{
    const auto file = source / "tests/data/cycles/interior/noisy_16.exr";
    RunRequest request;
    request.inputs["render"].files = {{file.string(), ""}};
    request.params["max_radius"] = std::int64_t{3};
    const RunReport report =
        run_graph(read_graph((source / "graphs/pivot-lobes.yaml").string()), request, {});
    const MemoryImage& layered = report.images.at("render")[0];
    const TestImage input = read_render(file);
    ASSERT_EQ(layered.desc.channel_count(), input.desc.channel_count());
    int changed = 0;
    for (int c = 0; c < input.desc.channel_count(); ++c) {
        const std::string& name = layered.desc.channels[static_cast<std::size_t>(c)];
        const bool light = name.find("Dir.") != std::string::npos ||
                           name.find("Ind.") != std::string::npos ||
                           (name.find("Combined") != std::string::npos && !name.ends_with(".A"));
        int differing = 0;
        for (int y = input.desc.data.y0; y < input.desc.data.y1; ++y)
            for (int x = input.desc.data.x0; x < input.desc.data.x1; ++x)
                differing += layered.pixels.view().at(c, x, y) != input.view().at(c, x, y);
        EXPECT_TRUE(light || differing == 0) << name;
        changed += differing > 0;
    }
    EXPECT_GE(changed, 9);
}

} // namespace
} // namespace rayloom::test
