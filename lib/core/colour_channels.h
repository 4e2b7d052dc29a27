// SPDX-License-Identifier: Apache-2.0
/// \file
/// For nodes that work on colour channels and hand on all others (alpha, depth, …) as they are.
#pragma once

#include "rayloom/core/node.h"

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace rayloom
{

/// Indices of an input's colour channels (ImageDesc::colour()). Throws NodeError when it has none.
std::vector<int> require_colours(const PlanContext& context, std::string_view port,
                                 std::size_t element = 0);

/// How many colour channels an input may have beside another one.
enum class ColourCount {
    same,        ///< as many
    same_or_one, ///< as many, or one that stands for all of them
};

/// Which channel of element `element` of `port` goes with each colour channel of `like`, element 0;
/// with ColourCount::same_or_one a single channel is repeated. Throws NodeError when the number is
/// another one, or when the two inputs cover different pixels.
std::vector<int> matching_colours(const PlanContext& context, std::string_view like,
                                  std::string_view port, ColourCount count = ColourCount::same,
                                  std::size_t element = 0);

/// The names of channels of an image.
std::vector<std::string> channel_names(const ImageDesc& image, std::span<const int> channels);

/// Channels of an output that are those of an input, bit for bit.
class PassedChannels
{
public:
    /// Declares for output `image` that all its channels but `written` are those of `port`, which
    /// has the same channels. Call from plan().
    void plan(PlanContext& context, std::string_view port, std::span<const int> written);
    /// Fills their rows over all of `out`, which has the channels of `in`; `in` covers it.
    void copy(const ConstImageView& in, const ImageView& out) const;

private:
    std::vector<int> m_channels;
};

} // namespace rayloom
