// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/install_paths.h"

#include "rayloom/core/error.h"

#include <dlfcn.h>

#include <algorithm>
#include <cstdlib>
#include <string>

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

std::vector<std::filesystem::path> graph_folders()
{
    std::vector<std::filesystem::path> folders;
    if (const char* list = std::getenv("RAYLOOM_GRAPH_PATH")) {
        const std::string text = list;
        for (std::size_t start = 0; start <= text.size();) {
            const std::size_t end = std::min(text.find(':', start), text.size());
            const std::filesystem::path folder = text.substr(start, end - start);
            start = end + 1;
            if (folder.empty()) continue;
            // A map that is not found would silently leave its renderer's files to the generic one.
            std::error_code error;
            if (!std::filesystem::is_directory(folder, error))
                throw InputError("folder '" + folder.string() +
                                 "' of RAYLOOM_GRAPH_PATH: there is no such folder");
            folders.push_back(folder);
        }
    }
    folders.push_back(data_folder() / "graphs");
    return folders;
}

} // namespace rayloom
