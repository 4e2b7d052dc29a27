// SPDX-License-Identifier: Apache-2.0
/// \file
/// An image of many layers for the tests of what takes layers apart and puts them together.
#pragma once

#include "tests/support/tiled_node.h"

#include <gtest/gtest.h>

namespace rayloom::node_test
{

using Texts = std::vector<std::string>;

inline TestImagePtr render()
{
    return random_image({-5, -3, 40, 22}, {0, 0, 36, 20},
                        {"ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B",
                         "ViewLayer.Combined.A", "ViewLayer.DiffDir.R", "ViewLayer.DiffDir.G",
                         "ViewLayer.DiffDir.B", "ViewLayer.Depth.Z", "Hair.DiffInd.R",
                         "Hair.DiffInd.G", "Hair.DiffInd.B", "R", "G", "B"},
                        31);
}

inline TestImagePtr layer(const TestImagePtr& image, const std::string& name)
{
    return run_node("transform.layer", {{"layer", name}}, {{"image", {image}}})
        .outputs.at("image")[0];
}

inline void expect_error(const char* op, const ParamValues& params, const TestInputs& inputs,
                         const char* text)
{
    try {
        run_node(op, params, inputs);
        ADD_FAILURE() << op << " should have failed with: " << text;
    } catch (const NodeError& error) {
        EXPECT_NE(std::string(error.what()).find(text), std::string::npos) << error.what();
    }
}

} // namespace rayloom::node_test
