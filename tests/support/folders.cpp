// SPDX-License-Identifier: Apache-2.0
#include "tests/support/folders.h"

namespace rayloom::test
{

const std::filesystem::path& source_folder()
{
    static const std::filesystem::path folder = RAYLOOM_SOURCE_DIR;
    return folder;
}

const std::filesystem::path& build_folder()
{
    static const std::filesystem::path folder = RAYLOOM_BINARY_DIR;
    return folder;
}

} // namespace rayloom::test
