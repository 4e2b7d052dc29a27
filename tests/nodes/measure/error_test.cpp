// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/registry.h"
#include "rayloom/stats/error_measures.h"

#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <random>

namespace rayloom
{
namespace
{

struct CountingServices final : RunServices {
    bool cancelled() const noexcept override { return false; }
    bool may_skip() const noexcept override { return true; }
    void count_skip(std::string_view, std::size_t) override {}
    void count(std::string_view what, std::size_t n) override { counts[std::string(what)] += n; }
    std::map<std::string, std::size_t> counts;
};

const Region window{-3, 2, 44, 36};

ImageBuffer random_image(int channels, unsigned seed)
{
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> value(0.0f, 1.3f);
    ImageBuffer image(window, channels);
    for (int y = window.y0; y < window.y1; ++y)
        for (int c = 0; c < channels; ++c)
            for (float& v : image.view().row_span(c, y)) v = value(random);
    return image;
}

ImageDesc desc(std::vector<std::string> channels)
{
    ImageDesc d;
    d.data = d.display = window;
    d.channels = std::move(channels);
    return d;
}

PlanContext plan_context(const ImageDesc& image, const ImageDesc& reference)
{
    PlannedInput a, b;
    a.connected = b.connected = true;
    a.images = {image};
    b.images = {reference};
    return PlanContext({{"image", a}, {"reference", b}});
}

std::unique_ptr<Node> make_node(const ParamValues& params)
{
    const NodeInfo* info = Registry::instance().find("measure.error");
    return info == nullptr ? nullptr : info->create(params);
}

/// Plays the engine: every row by itself with the halo the plan asked for, then a sum in order.
Table run_reduction(Node& node, const PlanContext& context, const ImageBuffer& image,
                    const ImageBuffer& reference, RunServices& services)
{
    const Reduction& reduction = *context.result().reduction;
    std::vector<double> totals(reduction.values);
    for (int y = reduction.domain.y0; y < reduction.domain.y1; ++y) {
        const Region row{reduction.domain.x0, y, reduction.domain.x1, y + 1};
        const auto part = [&](const char* port, const ImageBuffer& from) {
            return ConstImageView(from.view())
                .crop(context.result()
                          .reduce_needs.find(port)
                          ->second({0, 0, row})
                          .intersect(window));
        };
        const std::array<ConstImageView, 1> a{part("image", image)},
            b{part("reference", reference)};
        const std::array<TileContext::Input, 2> inputs{
            {{"image", a, {}, nullptr}, {"reference", b, {}, nullptr}}};
        std::vector<double> sums(reduction.values);
        node.reduce(TileContext(row, 0, inputs, {}, services), sums);
        node.combine(totals, sums);
    }
    return node.finish(totals, {}).at("errors");
}

TEST(MeasureError, TableHoldsTheMeasuresOfTheWholeImages)
{
    ImageBuffer image = random_image(4, 1), reference = random_image(4, 2);
    image.view().at(1, 5, 7) = std::numeric_limits<float>::quiet_NaN();
    image.view().at(3, 9, 9) = std::numeric_limits<float>::infinity(); // alpha: not looked at
    const auto node = make_node({});
    ASSERT_NE(node, nullptr);
    PlanContext context = plan_context(desc({"R", "G", "B", "A"}), desc({"R", "G", "B", "A"}));
    node->plan(context);
    CountingServices services;
    const Table errors = run_reduction(*node, context, image, reference, services);

    ErrorOptions options;
    options.hdr_flip = false;
    Table expected = measure_errors(ConstImageView(image.view()).channel_range(0, 3),
                                    ConstImageView(reference.view()).channel_range(0, 3), options)
                         .table();
    for (const std::string& name : errors.columns)
        EXPECT_NEAR(errors.number(name), expected.number(name),
                    1e-13 * std::abs(expected.number(name)))
            << name;
    EXPECT_EQ(errors.columns.size() + 1, expected.columns.size()) << "all but the trimmed relMSE";
    EXPECT_EQ(errors.number("non_finite_pixels"), 1.0);
    EXPECT_EQ(services.counts["pixels left out (not finite)"], 1u);
}

TEST(MeasureError, ReadsColourWhereverItsChannelsAre)
{
    const ImageBuffer rgb = random_image(3, 3), reference = random_image(3, 4);
    // The same image as B, G, R and as channels in no even order.
    const auto reordered = [&](std::array<int, 4> order) {
        ImageBuffer out(window, 4);
        for (int i = 0; i < 4; ++i)
            copy_pixels(
                ConstImageView(rgb.view()).channel_range(order[static_cast<std::size_t>(i)], 1),
                out.view().channel_range(i, 1));
        return out;
    };
    const auto measure = [&](const ImageBuffer& image, std::vector<std::string> channels) {
        const auto node = make_node({{"flip", false}});
        PlanContext context = plan_context(desc(std::move(channels)), desc({"R", "G", "B"}));
        node->plan(context);
        CountingServices services;
        return run_reduction(*node, context, image, reference, services);
    };
    const Table plain = measure(rgb, {"R", "G", "B"});
    EXPECT_FALSE(plain.has("flip"));
    EXPECT_EQ(measure(reordered({2, 1, 0, 0}), {"B", "G", "R", "A"}), plain);
    EXPECT_EQ(measure(reordered({1, 0, 0, 2}), {"G", "R", "A", "B"}), plain);
}

TEST(MeasureError, MapIsTheSameInTilesAsWhole)
{
    const ImageBuffer image = random_image(3, 5), reference = random_image(3, 6);
    for (const auto& [name, kind] :
         {std::pair<std::string, ErrorMap>{"absolute", ErrorMap::absolute},
          {"relative", ErrorMap::relative},
          {"flip", ErrorMap::flip}}) {
        const ImageBuffer whole = error_map(image.view(), reference.view(), kind);
        const auto node = make_node({{"map", name}});
        PlanContext context = plan_context(desc({"R", "G", "B"}), desc({"R", "G", "B"}));
        node->plan(context);
        EXPECT_EQ(context.result().outputs.at("map")[0].channels, std::vector<std::string>{"Y"});
        EXPECT_EQ(context.result().pointwise, name != "flip");
        CountingServices services;
        ImageBuffer held_a(window, 3), held_b(window, 3);
        for (int y = window.y0; y < window.y1; y += 13)
            for (int x = window.x0; x < window.x1; x += 17) {
                const Region tile = Region{x, y, x + 17, y + 13}.intersect(window);
                // What was not asked for is not there.
                const auto part = [&](const char* port, const ImageBuffer& from, ImageBuffer& to) {
                    const auto need = context.result().needs.find(port);
                    const Region held =
                        (need == context.result().needs.end() ? tile : need->second({0, 0, tile}))
                            .intersect(window);
                    to.fill(std::numeric_limits<float>::quiet_NaN());
                    copy_pixels(ConstImageView(from.view()).crop(held), to.view().crop(held));
                    return ConstImageView(to.view()).crop(held);
                };
                const std::array<ConstImageView, 1> a{part("image", image, held_a)},
                    b{part("reference", reference, held_b)};
                const std::array<TileContext::Input, 2> inputs{
                    {{"image", a, {}, nullptr}, {"reference", b, {}, nullptr}}};
                ImageBuffer out(tile, 1);
                const std::array<TileContext::Output, 1> outputs{{{"map", out.view()}}};
                node->compute(TileContext(tile, 0, inputs, outputs, services));
                for (int v = tile.y0; v < tile.y1; ++v)
                    for (int u = tile.x0; u < tile.x1; ++u)
                        ASSERT_EQ(out.view().at(0, u, v), whole.view().at(0, u, v)) << name;
            }
    }
}

TEST(MeasureError, PlanSaysWhatDoesNotFit)
{
    ImageDesc other = desc({"R", "G", "B"});
    other.data.x1 += 1;
    PlanContext windows = plan_context(desc({"R", "G", "B"}), other);
    EXPECT_THROW(make_node({})->plan(windows), NodeError);
    PlanContext channels = plan_context(desc({"R", "G", "B"}), desc({"Z"}));
    EXPECT_THROW(make_node({})->plan(channels), NodeError);
    PlanContext four = plan_context(desc({"X", "Y", "Z", "W"}), desc({"X", "Y", "Z", "W"}));
    EXPECT_THROW(make_node({})->plan(four), NodeError);
}

TEST(MeasureError, NothingFiniteIsAnError)
{
    ImageBuffer image = random_image(3, 7);
    image.fill(std::numeric_limits<float>::quiet_NaN());
    const auto node = make_node({});
    PlanContext context = plan_context(desc({"R", "G", "B"}), desc({"R", "G", "B"}));
    node->plan(context);
    CountingServices services;
    EXPECT_THROW(run_reduction(*node, context, image, random_image(3, 8), services), InputError);
}

} // namespace
} // namespace rayloom
