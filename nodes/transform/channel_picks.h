// SPDX-License-Identifier: Apache-2.0
/// \file
/// Channels and layers by name, as graph files write them.
#pragma once

#include "rayloom/core/node.h"

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace rayloom
{

/// Where one channel of a result comes from.
struct ChannelPick {
    std::string name;      ///< in the result
    int source = -1;       ///< index in the image, −1: a constant
    float constant = 0.0f; ///< when source is −1
};

/// Reads a list of `R` (that channel), `Y=R` (channel R, now called Y) and `A=1` (a constant).
/// `names` are what the channels can be called here, `indices` where they are in the image. A name
/// that exists wins over a number. Throws NodeError for what it cannot read, for an unknown name
/// and for a name given twice.
std::vector<ChannelPick> parse_channel_picks(std::span<const std::string> texts,
                                             std::span<const std::string> names,
                                             std::span<const int> indices);

/// Plans output element `element` of port `image` or `layers` as picks of the image at port
/// "image": declares what is passed on untouched. `desc` is the picked image.
void declare_picks(PlanContext& context, std::string_view output, std::size_t element,
                   std::span<const ChannelPick> picks);

/// The names of the picks.
std::vector<std::string> pick_names(std::span<const ChannelPick> picks);

/// Fills the whole of `out`; `in` covers it.
void copy_picks(const ConstImageView& in, std::span<const ChannelPick> picks, const ImageView& out);

/// The channels of an image that share a layer: all that stands before the last dot of their name
/// ("ViewLayer.DiffDir.R" is R of ViewLayer.DiffDir). The layer of plain "R" is "".
struct LayerChannels {
    std::string layer;
    std::vector<int> indices;
    std::vector<std::string> names; ///< after the last dot
};

/// In the order in which the layers first appear.
std::vector<LayerChannels> layers_of(const ImageDesc& image);

/// The layer called `wanted`, or, when none is, the only one whose name ends in ".wanted" (so that
/// `DiffDir` finds ViewLayer.DiffDir). Null when there is none. Throws NodeError that names all
/// candidates when there are several.
const LayerChannels* find_layer(std::span<const LayerChannels> layers, std::string_view wanted);

/// As find_layer(), but throws NodeError that lists the layers when there is none.
const LayerChannels& require_layer(std::span<const LayerChannels> layers, std::string_view wanted);

} // namespace rayloom
