// SPDX-License-Identifier: Apache-2.0
/// \file
/// Images of tests as the oracle of ray histogram fusion takes them.
#pragma once

#include "tests/oracle/histogram_fusion.h"
#include "tests/support/run_node.h"

namespace rayloom::test
{

/// Exponentially distributed values with mean 2.
TestImage random_image(const Region& data, std::vector<std::string> channels, unsigned seed);

oracle::Raster<double> to_raster(const TestImage& image);

/// Fails the test where a pixel is further than `tolerance` from what is expected.
void expect_near(const TestImage& image, const oracle::Raster<double>& expected, double tolerance);

} // namespace rayloom::test
