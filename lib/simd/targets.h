// SPDX-License-Identifier: Apache-2.0
/// \file
/// Which instruction set the kernels use. Chosen at run time; results are the same on each.
#pragma once

#include <string>
#include <vector>

namespace rayloom
{

/// Names of the targets this machine can run, best first ("AVX3", "AVX2", "SSE4", "SSSE3", …).
std::vector<std::string> simd_targets();

/// The target kernels use now.
std::string simd_target();

/// Makes kernels use a target by name, or "auto" for the best. Call before running anything: it
/// changes the whole process. Throws UsageError that lists what this machine has.
void use_simd_target(const std::string& name);

} // namespace rayloom
