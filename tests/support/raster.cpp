// SPDX-License-Identifier: Apache-2.0
#include "tests/support/raster.h"

#include <gtest/gtest.h>

#include <random>

namespace rayloom::test
{

using oracle::Raster;

TestImage random_image(const Region& data, std::vector<std::string> channels, unsigned seed)
{
    std::mt19937 random(seed);
    std::exponential_distribution<float> value(0.5f);
    return make_image(data, std::move(channels), [&](int, int, int) { return value(random); });
}

Raster<double> to_raster(const TestImage& image)
{
    const Region& r = image.desc.data;
    Raster<double> raster(r.width(), r.height(), image.desc.channel_count());
    for (int c = 0; c < raster.channels; ++c)
        for (int y = 0; y < raster.height; ++y)
            for (int x = 0; x < raster.width; ++x)
                raster.at(c, x, y) = image.view().at(c, r.x0 + x, r.y0 + y);
    return raster;
}

void expect_near(const TestImage& image, const Raster<double>& expected, double tolerance)
{
    const Region& r = image.desc.data;
    ASSERT_EQ(r.width(), expected.width);
    ASSERT_EQ(r.height(), expected.height);
    for (int c = 0; c < expected.channels; ++c)
        for (int y = 0; y < expected.height; ++y)
            for (int x = 0; x < expected.width; ++x)
                ASSERT_NEAR(image.view().at(c, r.x0 + x, r.y0 + y), expected.at(c, x, y), tolerance)
                    << c << " " << x << " " << y;
}

} // namespace rayloom::test
