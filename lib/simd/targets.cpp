// SPDX-License-Identifier: Apache-2.0
#include "rayloom/simd/targets.h"

#include "rayloom/core/error.h"
#include "rayloom/core/text.h"

#include <hwy/highway.h>
#include <hwy/targets.h>

namespace rayloom
{

namespace
{

/// Targets compiled in that this machine runs, one bit each.
std::int64_t runnable() { return hwy::SupportedTargets() & HWY_TARGETS; }

std::vector<std::string> names_of(std::int64_t targets)
{
    std::vector<std::string> names;
    // Highway numbers its targets best first.
    for (int bit = 0; bit < 62; ++bit)
        if (const std::int64_t target = std::int64_t{1} << bit; targets & target)
            names.emplace_back(hwy::TargetName(target));
    return names;
}

} // namespace

std::vector<std::string> simd_targets() { return names_of(runnable()); }

std::string simd_target() { return names_of(runnable()).front(); }

void use_simd_target(const std::string& name)
{
    hwy::SetSupportedTargetsForTest(0);
    const std::int64_t all = runnable();
    if (name != "auto") {
        std::int64_t chosen = 0;
        for (int bit = 0; bit < 62; ++bit)
            if (const std::int64_t target = std::int64_t{1} << bit;
                all & target && name == hwy::TargetName(target))
                chosen = target;
        if (chosen == 0)
            throw UsageError("this machine has no SIMD target '" + name + "'" +
                             suggestion(name, names_of(all)));
        hwy::SetSupportedTargetsForTest(chosen);
    }
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

} // namespace rayloom
