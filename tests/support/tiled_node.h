// SPDX-License-Identifier: Apache-2.0
/// \file
/// run_node() on shared images, random images, and a comparison that tells the first difference.
#pragma once

#include "tests/support/run_node.h"

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace rayloom::node_test
{

using test::TestImage;
using TestImagePtr = std::shared_ptr<const TestImage>;
using TestInputs = std::map<std::string, std::vector<TestImagePtr>, std::less<>>;

/// Random linear pixels: mostly 0 … 4, some negative, some very bright; alpha 0 … 1 with many exact
/// zeros and ones.
TestImagePtr random_image(const Region& data, const Region& display,
                          std::vector<std::string> channels, unsigned seed);

/// What came out of a node.
struct NodeRun {
    PlanResult plan;
    std::map<std::string, std::vector<TestImagePtr>, std::less<>> outputs;
    std::map<std::string, std::size_t, std::less<>> counts;
};

/// test::run_node() on inputs by port; a tile size of 0 × 0 means the whole image at once. Aliases
/// and constants are computed like everything else.
NodeRun run_node(std::string_view op, const ParamValues& params, const TestInputs& inputs,
                 int tile_width = 0, int tile_height = 0);

/// Places where the bits differ (two NaNs count as equal), as text for a failed test; empty when
/// windows, channels and pixels agree. With a tolerance: |a − b| ≤ tolerance · (1 + |b|).
std::string difference(const TestImage& a, const TestImage& b, float tolerance = 0.0f);

} // namespace rayloom::node_test
