// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/version.h"

#include <OpenImageIO/imageio.h>

namespace rayloom
{

std::string version() { return RAYLOOM_VERSION; }

std::string openimageio_version()
{
    const int v = OIIO::openimageio_version();
    return std::to_string(v / 10000) + "." + std::to_string(v / 100 % 100) + "." +
           std::to_string(v % 100);
}

} // namespace rayloom
