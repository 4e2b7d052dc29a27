// SPDX-License-Identifier: Apache-2.0
// The reader of renderer maps on any text.
#include "rayloom/image/renderer_map.h"
#include "tests/fuzz/target.h"

#include <string>

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size)
{
    const std::string text(reinterpret_cast<const char*>(data), size);
    rayloom::fuzz::answer([&] { rayloom::RendererMap::parse(text, "fuzzed"); });
    return 0;
}
