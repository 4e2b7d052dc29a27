// SPDX-License-Identifier: Apache-2.0
/// \file
/// Images and graphs for tests of the wavelet nodes.
#pragma once

#include "tests/support/engine_nodes_for_tests.h"

#include <cmath>
#include <functional>
#include <string>

namespace rayloom::test
{

inline std::shared_ptr<MemoryImage>
image_of(const Region& window, std::vector<std::string> channels,
         const std::function<float(int channel, int x, int y)>& value)
{
    auto image = std::make_shared<MemoryImage>();
    image->desc.data = image->desc.display = window;
    image->desc.channels = std::move(channels);
    image->pixels = ImageBuffer(window, image->desc.channel_count());
    for (int y = window.y0; y < window.y1; ++y)
        for (int c = 0; c < image->desc.channel_count(); ++c)
            for (int x = window.x0; x < window.x1; ++x)
                image->pixels.view().at(c, x, y) = value(c, x, y);
    return image;
}

/// "rayloom: 1 … inputs: {image: any} … nodes: <nodes> outputs: {image: <from><more>}".
inline std::string graph_of(const std::string& nodes, const std::string& from,
                            const std::string& more = "")
{
    return "rayloom: 1\nname: test\ninputs:\n  image: any image\nnodes:\n" + nodes +
           "outputs:\n  image: " + from + "\n" + more;
}

inline double mean_of(const MemoryImage& image, int channel)
{
    const Region& r = image.desc.data;
    double sum = 0.0;
    for (int y = r.y0; y < r.y1; ++y)
        for (int x = r.x0; x < r.x1; ++x) sum += image.pixels.view().at(channel, x, y);
    return sum / static_cast<double>(r.pixels());
}

inline bool all_finite(const MemoryImage& image)
{
    for (int y = image.desc.data.y0; y < image.desc.data.y1; ++y)
        for (int c = 0; c < image.desc.channel_count(); ++c)
            for (const float v : image.pixels.view().row_span(c, y))
                if (!std::isfinite(v)) return false;
    return true;
}

} // namespace rayloom::test
