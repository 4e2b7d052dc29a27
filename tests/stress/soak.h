// SPDX-License-Identifier: Apache-2.0
/// \file
/// The tests of tests/stress come in two lengths.
#pragma once

#include <cstdlib>

namespace rayloom::test
{

/// Whether the long version is asked for: RAYLOOM_SOAK is set, as `./dev soak` does.
inline bool soaking() { return std::getenv("RAYLOOM_SOAK") != nullptr; }

} // namespace rayloom::test
