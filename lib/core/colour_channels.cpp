// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/colour_channels.h"

#include <algorithm>

namespace rayloom
{
namespace
{

std::string label(const PlanContext& context, std::string_view port, std::size_t element)
{
    std::string text = "'" + std::string(port);
    if (context.count(port) > 1) text += "[" + std::to_string(element) + "]";
    return text + "'";
}

} // namespace

std::vector<int> require_colours(const PlanContext& context, std::string_view port,
                                 std::size_t element)
{
    std::vector<int> channels = context.input(port, element).colour();
    if (channels.empty())
        throw NodeError("input " + label(context, port, element) + " has no colour channel");
    return channels;
}

std::vector<int> matching_colours(const PlanContext& context, std::string_view like,
                                  std::string_view port, ColourCount count, std::size_t element)
{
    const std::size_t wanted = context.input(like).colour().size();
    std::vector<int> channels = context.input(port, element).colour();
    const bool one_for_all = count == ColourCount::same_or_one && channels.size() == 1;
    if (channels.size() != wanted && !one_for_all)
        throw NodeError("input " + label(context, port, element) + " has " +
                        std::to_string(channels.size()) + " colour channels, " +
                        label(context, like, 0) + " has " + std::to_string(wanted) +
                        "; they must agree" +
                        (count == ColourCount::same_or_one ? ", or the former have one" : ""));
    context.require_same_window(like, port, 0, element);
    if (one_for_all) channels.resize(wanted, channels[0]);
    return channels;
}

std::vector<std::string> channel_names(const ImageDesc& image, std::span<const int> channels)
{
    std::vector<std::string> names;
    for (const int c : channels) names.push_back(image.channels[static_cast<std::size_t>(c)]);
    return names;
}

void PassedChannels::plan(PlanContext& context, std::string_view port, std::span<const int> written)
{
    m_channels.clear();
    for (int c = 0; c < context.input(port).channel_count(); ++c)
        if (std::find(written.begin(), written.end(), c) == written.end()) {
            m_channels.push_back(c);
            context.pass_channel("image", c, port, c);
        }
}

void PassedChannels::copy(const ConstImageView& in, const ImageView& out) const
{
    const Region& r = out.region();
    for (const int c : m_channels)
        for (int y = r.y0; y < r.y1; ++y) std::copy_n(in.ptr(c, r.x0, y), r.width(), out.row(c, y));
}

} // namespace rayloom
