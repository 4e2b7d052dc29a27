// SPDX-License-Identifier: Apache-2.0
/// \file
/// Deep images made up for tests, and what tests do with them.
#pragma once

#include "rayloom/core/registry.h"
#include "rayloom/engine/request.h"
#include "tests/oracle/deep.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace rayloom::test
{

/// Channels R, G, B, A, Z; 0 to 6 samples a pixel, most of them partly covering, in no order.
MemoryDeep made_up_deep(const Region& window, unsigned seed = 1);

/// `samples(x, y)` samples a pixel, of value(channel, x, y, sample).
MemoryDeep make_deep(const Region& window, std::vector<std::string> channels,
                     const std::function<int(int, int)>& samples,
                     const std::function<float(int, int, int, int)>& value);

/// The same samples with other values: value(channel, x, y, what it was).
MemoryDeep with_values(const MemoryDeep& deep,
                       const std::function<float(int, int, int, float)>& value);

/// The pixels of `deep` inside `window`.
MemoryDeep cropped(const MemoryDeep& deep, const Region& window);

/// Same window, channels, numbers of samples and bits; two NaN are the same.
::testing::AssertionResult same_samples(const MemoryDeep& a, const MemoryDeep& b);

/// Whether every value is finite.
::testing::AssertionResult all_finite(const MemoryDeep& deep);

/// Values of one channel of a pixel.
std::vector<float> samples_at(const MemoryDeep& deep, int channel, int x, int y);

/// A pixel as the oracle takes it: one channel with the alpha and depth of made_up_deep().
std::vector<oracle::DeepSample> samples_of(const MemoryDeep& deep, int channel, int x, int y);

/// Writes a deep EXR with OpenImageIO; types by channel, ids from `ids(x, y, sample)`.
void write_deep_exr(const std::string& path, const MemoryDeep& deep,
                    const std::vector<std::string>& types, bool tiled = false,
                    const std::function<std::uint32_t(int, int, int)>& ids = {});

/// All samples of a deep EXR, read with OpenImageIO, as text: windows, types, samples bit for bit.
/// Metadata are left out.
std::string deep_exr_text(const std::string& path);

} // namespace rayloom::test
