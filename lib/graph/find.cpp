// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/install_paths.h"
#include "rayloom/core/text.h"
#include "rayloom/graph/graph_reader.h"
#include "rayloom/graph/reader.h"

#include <algorithm>
#include <filesystem>

namespace rayloom
{

namespace
{

namespace fs = std::filesystem;

/// Names of the graphs in the folders, without the ending.
std::vector<std::string> graphs_in(const std::vector<fs::path>& folders)
{
    std::vector<std::string> names;
    for (const fs::path& folder : folders) {
        std::error_code error;
        for (fs::directory_iterator it(folder, error), end; !error && it != end;
             it.increment(error))
            if (it->path().extension() == ".yaml") names.push_back(it->path().stem().string());
    }
    std::sort(names.begin(), names.end());
    names.erase(std::unique(names.begin(), names.end()), names.end());
    return names;
}

} // namespace

std::vector<std::string> graph_names() { return graphs_in(graph_folders()); }

std::optional<std::string> locate_graph(const std::string& name_or_path, const std::string& folder)
{
    std::error_code error;
    const std::string beside = reading::path_from(folder, name_or_path);
    if (fs::exists(beside, error) && !fs::is_directory(beside, error)) return beside;
    if (name_or_path.empty() || fs::path(name_or_path).is_absolute()) return std::nullopt;
    for (const fs::path& place : graph_folders())
        for (const char* ending : {"", ".yaml"}) {
            const fs::path path = place / (name_or_path + ending);
            if (fs::is_regular_file(path, error)) return path.string();
        }
    return std::nullopt;
}

std::string find_graph(const std::string& name_or_path)
{
    std::error_code error;
    if (name_or_path.empty()) throw InputError("the name of a graph is empty");
    const fs::path given(name_or_path);
    const bool is_path =
        given.has_parent_path() || given.extension() == ".yaml" || given.extension() == ".yml";
    if (fs::is_directory(given, error) && is_path)
        throw InputError("'" + name_or_path + "' is a folder, not a graph file");
    if (const auto found = locate_graph(name_or_path)) return *found;
    std::string message = "graph '" + name_or_path + "' was not found";
    if (const std::string near = closest_name(given.stem().string(), graph_names()); !near.empty())
        message += "; did you mean '" + near + "'?";
    message += "; searched: as a file";
    for (const fs::path& folder : graph_folders()) message += ", " + folder.string();
    throw InputError(message);
}

} // namespace rayloom
