// SPDX-License-Identifier: Apache-2.0
/// \file
/// Scenes for the tests of fit.plane and fuse.planes.
#pragma once

#include "tests/oracle/planes.h"
#include "tests/support/run_node.h"

#include <optional>

namespace rayloom::test
{

struct PlaneScene {
    TestImage image, variance;
    std::optional<TestImage> normal, boundary, parts, pivot;

    /// The ports that are there; `planes` is the coefficient image for fuse.planes.
    std::vector<NodeInput> inputs(const TestImage* planes = nullptr) const;
    oracle::PlaneInput for_oracle() const;
};

/// Light without noise, `value(channel, x, y)`, and of variance `variance`.
PlaneScene even_scene(const Region& data, int colours,
                      const std::function<float(int, int, int)>& value, float variance);
/// Two objects under slowly changing light with noise; normals, boundary and parts of two pairs.
PlaneScene noisy_scene(const Region& data, int colours, float noise, unsigned seed);

/// fit.plane and fuse.planes, one after the other.
TestImage filter_planes(const PlaneScene& scene, const ParamValues& fit, const ParamValues& fuse,
                        const RunOptions& options = {});

} // namespace rayloom::test
