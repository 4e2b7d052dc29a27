// SPDX-License-Identifier: Apache-2.0
// The graph reader on any text.
#include "rayloom/graph/reader.h"
#include "tests/fuzz/target.h"

#include <string>

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size)
{
    const std::string text(reinterpret_cast<const char*>(data), size);
    rayloom::fuzz::answer([&] { rayloom::parse_graph(text, "fuzzed", "/nowhere"); });
    return 0;
}
