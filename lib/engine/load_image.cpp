// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/load_image.h"

#include "rayloom/core/error.h"
#include "rayloom/image/renderer_map.h"

namespace rayloom
{

MemoryImage load_image(const std::string& path, const std::string& layer,
                       const std::string& channels)
{
    const auto file = ImageFile::open(path);
    const ImageReader reader(
        file, choose_channels(*file, {layer, "", layer.empty() ? "beauty" : "", channels}));
    if (reader.part().deep)
        throw InputError(path + ": the image is deep; flat pixels are wanted here");
    MemoryImage image{reader.desc(),
                      ImageBuffer(reader.desc().data, reader.desc().channel_count())};
    reader.read(image.pixels.view());
    return image;
}

} // namespace rayloom
