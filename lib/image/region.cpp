// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/region.h"

#include <cstdio>

namespace rayloom
{

std::string Region::text() const
{
    char buffer[64];
    std::snprintf(buffer, sizeof buffer, "%dx%d%+d%+d", width(), height(), x0, y0);
    return buffer;
}

} // namespace rayloom
