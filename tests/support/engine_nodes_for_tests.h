// SPDX-License-Identifier: Apache-2.0
/// \file
/// Nodes with real pixels for tests of the engine, and small helpers around runs.
#pragma once

#include "rayloom/engine/run.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>

namespace rayloom::test
{

/// Registers (once) nodes of stage `engine.`:
///   gain(image, factor) pointwise; identity at factor 1
///   box(image, radius) mean over a window clipped at the border
///   halve(image, scales) → list of images of half size each, level 0 passed through
///   total(image) → table {sum}, and image minus its mean
///   shift(image, table figures) adds the figure `sum`
///   flipped(image) upside down
///   sum(images: list) per pixel
///   blur_all(image) mean of the whole image, Access::whole
///   fails(image) throws InputError in row 40
void register_engine_nodes();

/// A deterministic image with no structure a filter could hide behind.
std::shared_ptr<MemoryImage> noise_image(const Region& window, int channels, unsigned seed = 1);

/// Runs a graph text on images in memory and returns the images of its first output.
MemoryImage run_text(const std::string& graph,
                     std::map<std::string, std::shared_ptr<const MemoryImage>> inputs,
                     const RunOptions& options = {}, std::optional<Region> roi = {},
                     RunReport* report = nullptr);

/// Whether both have the same window, channels and bits.
::testing::AssertionResult same_bits(const MemoryImage& a, const MemoryImage& b);

} // namespace rayloom::test
