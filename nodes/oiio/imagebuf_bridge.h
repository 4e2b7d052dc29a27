// SPDX-License-Identifier: Apache-2.0
/// \file
/// Tiles as ImageBufs, for the entries of the table that call ImageBufAlgo.
#pragma once

#include "nodes/oiio/operation.h"

#include <OpenImageIO/imagebuf.h>

#include <functional>
#include <span>

namespace rayloom::oiio
{

/// Channels [0, channels) of a region.
OIIO::ROI roi_of(const Region& region, int channels);

/// An uninitialised float ImageBuf with the windows' true places: its data window is `part`, its
/// display window, channel names and alpha channel are the image's.
OIIO::ImageBuf empty_imagebuf(const ImageDesc& image, const Region& part);

/// A float ImageBuf whose data window is the view's region and whose display window, channel names
/// and alpha channel are the image's, so that OpenImageIO treats the image's borders as it would
/// on the whole image.
OIIO::ImageBuf to_imagebuf(const ConstImageView& view, const ImageDesc& image);
/// The same of some channels; `image` describes an image of these alone.
OIIO::ImageBuf to_imagebuf(const ConstImageView& view, std::span<const int> channels,
                           const ImageDesc& image);

/// Copies the pixels of `out.region()` into the view. Throws Error with OpenImageIO's text when
/// the ImageBuf has an error or another number of channels.
void from_imagebuf(const OIIO::ImageBuf& buffer, const ImageView& out);
/// The same into some channels; the others stay as they are.
void from_imagebuf(const OIIO::ImageBuf& buffer, const ImageView& out,
                   std::span<const int> channels);

/// A call of ImageBufAlgo: fills `roi` of `result` and tells whether it went well.
using OnImageBuf =
    std::function<bool(OIIO::ImageBuf& result, const OIIO::ImageBuf& image, const OIIO::ROI& roi)>;

/// What of the image at port "image" is read for a region of the output.
using Reads = std::function<Region(const Region&)>;

/// Calls `function` for each region, and declares what is read for it: nothing else of the image is
/// copied. `input` and `output` describe the whole images.
Compute on_imagebuf(PlanContext& context, ImageDesc input, ImageDesc output, Reads reads,
                    OnImageBuf function);

/// As on_imagebuf() for the image at port "image", which keeps its windows and channels, and of
/// which only `channels` are handed to `function`; the others are passed on.
Compute on_channels(PlanContext& context, std::vector<int> channels, OnImageBuf function);

/// What of an image is read by a filter that reads `region` and, outside the data window, the
/// nearest pixel of the display window (ImageBuf::WrapClamp).
Region with_clamped_border(const Region& region, const Region& display);

} // namespace rayloom::oiio
