// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/image_desc.h"

#include "rayloom/image/view.h"

#include <algorithm>

namespace rayloom
{

int ImageDesc::channel(std::string_view name) const
{
    const auto it = std::find(channels.begin(), channels.end(), name);
    return it == channels.end() ? -1 : static_cast<int>(it - channels.begin());
}

int ImageDesc::alpha() const
{
    for (const char* name : {"A", "a", "alpha"})
        if (const int i = channel(name); i >= 0) return i;
    return -1;
}

std::vector<int> ImageDesc::colour() const
{
    std::vector<int> indices;
    for (const auto& [upper, lower] : {std::pair{"R", "r"}, {"G", "g"}, {"B", "b"}}) {
        const int i = channel(upper) >= 0 ? channel(upper) : channel(lower);
        if (i >= 0) indices.push_back(i);
    }
    if (indices.size() == 3) return indices;
    indices.clear();
    for (int i = 0; i < channel_count(); ++i)
        if (i != alpha()) indices.push_back(i);
    return indices;
}

ImageDesc ImageDesc::with_channels(std::vector<std::string> names) const
{
    ImageDesc out = *this;
    out.channels = std::move(names);
    return out;
}

std::size_t ImageDesc::bytes() const { return ImageBuffer::bytes_for(data, channel_count()); }

} // namespace rayloom
