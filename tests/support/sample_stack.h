// SPDX-License-Identifier: Apache-2.0
/// \file
/// Samples of pixels for tests: as a stack of images and as deep pixels.
#pragma once

#include "tests/support/run_node.h"

namespace rayloom::test
{

/// R, G, B (and A): samples over 14 decades, some zero, some negative.
std::vector<TestImage> random_stack(const Region& data, int count, bool alpha);

/// The images as an input of run_node() takes them.
std::vector<const TestImage*> pointers(const std::vector<TestImage>& images);

/// The samples of a stack as deep pixels.
TestDeep deep_of(const std::vector<TestImage>& stack);

} // namespace rayloom::test
