// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/install_paths.h"

#include "rayloom/core/error.h"

#include <dlfcn.h>

namespace rayloom
{

std::filesystem::path data_folder()
{
    Dl_info info{};
    if (dladdr(reinterpret_cast<void*>(&data_folder), &info) == 0 || info.dli_fname == nullptr)
        throw Error("cannot tell which file the rayloom library was loaded from");
    // Resolves symbolic links: a link to the library elsewhere must not mislead.
    const std::filesystem::path library = std::filesystem::canonical(info.dli_fname);
    return (library.parent_path() / RAYLOOM_LIB_TO_DATA).lexically_normal();
}

} // namespace rayloom
