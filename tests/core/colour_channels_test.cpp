// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"
#include "tests/support/raster.h"

#include <gtest/gtest.h>

namespace rayloom
{
namespace
{

ImageDesc described(std::vector<std::string> channels, Region data = {0, 0, 8, 4})
{
    ImageDesc desc;
    desc.data = desc.display = data;
    desc.channels = std::move(channels);
    return desc;
}

PlanContext planned(std::vector<ImageDesc> image, std::vector<ImageDesc> other)
{
    std::map<std::string, PlannedInput, std::less<>> inputs;
    inputs["image"] = {true, PortKind::image, std::move(image), {}};
    inputs["other"] = {true, PortKind::list, std::move(other), {}};
    return PlanContext(std::move(inputs));
}

std::string refusal(const PlanContext& context, ColourCount count, std::size_t element = 0)
{
    try {
        matching_colours(context, "image", "other", count, element);
    } catch (const NodeError& error) {
        return error.what();
    }
    return "";
}

TEST(ColourChannels, GoWithThoseOfTheOtherInputByColourNotByPlace)
{
    const PlanContext context =
        planned({described({"A", "R", "G", "B"})}, {described({"B", "G", "R", "Z"})});
    EXPECT_EQ(require_colours(context, "image"), (std::vector<int>{1, 2, 3}));
    EXPECT_EQ(matching_colours(context, "image", "other"), (std::vector<int>{2, 1, 0}));
}

TEST(ColourChannels, OneStandsForAllOnlyWhereItMay)
{
    const PlanContext context =
        planned({described({"R", "G", "B"})}, {described({"Y", "A"}), described({"Y", "Z"})});
    EXPECT_EQ(matching_colours(context, "image", "other", ColourCount::same_or_one),
              (std::vector<int>{0, 0, 0}));
    EXPECT_EQ(refusal(context, ColourCount::same),
              "input 'other[0]' has 1 colour channels, 'image' "
              "has 3; they must agree");
    EXPECT_EQ(
        refusal(context, ColourCount::same_or_one, 1),
        "input 'other[1]' has 2 colour channels, 'image' has 3; they must agree, or the former "
        "have one");
}

TEST(ColourChannels, RefuseInputsThatCoverOtherPixels)
{
    const PlanContext context =
        planned({described({"R", "G", "B"})}, {described({"R", "G", "B"}, {1, 0, 9, 4})});
    EXPECT_NE(refusal(context, ColourCount::same).find("must cover the same pixels"),
              std::string::npos);
}

TEST(ColourChannels, AreNeeded)
{
    const PlanContext context = planned({described({"A"})}, {});
    EXPECT_THROW(require_colours(context, "image"), NodeError);
}

TEST(PassedChannels, AreAllThatIsNotWritten)
{
    const Region window{-2, 1, 6, 5};
    PlanContext context = planned({described({"A", "R", "G", "B", "Z"}, window)}, {});
    context.output("image", context.input("image"));
    PassedChannels passed;
    passed.plan(context, "image", std::vector<int>{1, 2, 3});
    ASSERT_EQ(context.result().channel_aliases.size(), 2u);
    EXPECT_EQ(context.result().channel_aliases[0].output_channel, 0);
    EXPECT_EQ(context.result().channel_aliases[1].input_channel, 4);

    const test::TestImage image = test::random_image(window, {"A", "R", "G", "B", "Z"}, 1);
    const Region part{0, 2, 5, 4};
    test::TestImage out =
        test::make_image(part, {"A", "R", "G", "B", "Z"}, [](int, int, int) { return -1.0f; });
    passed.copy(image.view(), out.view());
    for (int y = part.y0; y < part.y1; ++y)
        for (int x = part.x0; x < part.x1; ++x)
            for (int c = 0; c < 5; ++c)
                EXPECT_EQ(out.view().at(c, x, y),
                          c == 0 || c == 4 ? image.view().at(c, x, y) : -1.0f);
}

} // namespace
} // namespace rayloom
