// SPDX-License-Identifier: Apache-2.0
// What stands behind -i, -o and --frames, sizes and patterns.
#include "rayloom/core/text.h"
#include "rayloom/image/frames.h"
#include "tests/fuzz/target.h"

#include <string>

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size)
{
    if (size == 0) return 0;
    const std::string text(reinterpret_cast<const char*>(data) + 1, size - 1);
    rayloom::fuzz::answer([&] {
        switch (data[0] % 5) {
        case 0: {
            const auto frames = rayloom::parse_frame_range(text);
            if (rayloom::parse_frame_range(rayloom::format_frame_range(frames)) != frames)
                std::abort();
            break;
        }
        case 1: {
            const rayloom::FramePattern pattern(text);
            if (pattern.path(7).empty() && !text.empty()) std::abort();
            pattern.path(-12345);
            break;
        }
        case 2: {
            rayloom::InputSource source = rayloom::parse_input_source(text);
            // Globs and files of this machine are no part of the answer.
            if (!rayloom::is_glob(source.path) && source.frames && source.frames->size() < 1000)
                rayloom::resolve_files(source, 3);
            break;
        }
        case 3: rayloom::parse_output_target(text); break;
        default: rayloom::parse_bytes(text);
        }
    });
    return 0;
}
