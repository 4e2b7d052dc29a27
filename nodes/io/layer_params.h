// SPDX-License-Identifier: Apache-2.0
/// \file
/// What the reading nodes ask of a file, declared once.
#pragma once

#include "rayloom/core/registry.h"
#include "rayloom/image/renderer_map.h"

#include <string>

namespace rayloom
{

/// Base of the parameters of a node that reads files.
struct LayerParams {
    std::string layer;
    std::string part;
    std::string role;
    std::string channels = "any";

    /// The channels of a file they name. Throws InputError.
    ChannelSelection choose(const ImageFile& file) const
    {
        return choose_channels(file, {layer, part, role, channels});
    }
};

/// Declares them; P derives from LayerParams.
template <class P>
void declare_layer_params(Declaration<P>& d)
{
    const auto declare = [&](const char* name, std::string LayerParams::*field, const char* doc) {
        d.param(name, static_cast<std::string P::*>(field), doc);
    };
    declare("layer", &LayerParams::layer, "layer, part or channel; empty: the whole first part");
    declare("part", &LayerParams::part,
            "name or number of the part to look in, where layers of several share a name");
    declare("role", &LayerParams::role,
            "what the layer is to the renderer ('beauty', 'albedo', …), where no layer is "
            "named; the renderer maps say which layer that is");
    declare("channels", &LayerParams::channels,
            "'any', 'RGB' (the three colour channels, and alpha where there is one), or a "
            "comma list of names in the order wanted");
}

} // namespace rayloom
