// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/registry.h"

#include "rayloom/core/error.h"

#include <dlfcn.h>

#include <algorithm>
#include <filesystem>

namespace rayloom
{

namespace
{
template <class T>
const T* find_named(const std::vector<T>& items, std::string_view name)
{
    const auto it =
        std::find_if(items.begin(), items.end(), [&](const T& t) { return t.name == name; });
    return it == items.end() ? nullptr : &*it;
}
} // namespace

const ParamInfo* NodeInfo::param(std::string_view param_name) const
{
    return find_named(params, param_name);
}
const PortInfo* NodeInfo::input(std::string_view port) const { return find_named(inputs, port); }
const PortInfo* NodeInfo::output(std::string_view port) const { return find_named(outputs, port); }

Registry& Registry::instance()
{
    static Registry registry;
    return registry;
}

void Registry::add(NodeInfo info)
{
    info.origin = m_origin;
    const std::string name = info.name;
    const auto [it, added] = m_nodes.emplace(name, std::move(info));
    if (added) return;
    const std::string clash =
        "node '" + name + "' is declared twice (" + it->second.origin + " and " + m_origin + ")";
    if (!m_loading) throw Error(clash);
    m_refusal = clash;
}

void Registry::add(NodeInfo (*describe)())
try {
    add(describe());
} catch (const std::exception& e) {
    if (!m_loading) throw;
    m_refusal = std::string("a node cannot be described: ") + e.what();
} catch (...) {
    if (!m_loading) throw;
    m_refusal = "a node cannot be described: it throws what is no exception";
}

const NodeInfo* Registry::find(std::string_view name) const
{
    const auto it = m_nodes.find(name);
    return it == m_nodes.end() ? nullptr : &it->second;
}

std::vector<const NodeInfo*> Registry::all() const
{
    std::vector<const NodeInfo*> out;
    for (const auto& [name, info] : m_nodes) out.push_back(&info);
    return out;
}

std::vector<std::string> Registry::names() const
{
    std::vector<std::string> out;
    for (const auto& [name, info] : m_nodes) out.push_back(name);
    return out;
}

void Registry::load_plugins(const std::string& folders)
{
    namespace fs = std::filesystem;
    std::size_t start = 0;
    while (start < folders.size()) {
        const std::size_t colon = std::min(folders.find(':', start), folders.size());
        const fs::path folder = folders.substr(start, colon - start);
        start = colon + 1;
        if (folder.empty()) continue;
        std::error_code status;
        std::vector<fs::path> files;
        for (const auto& entry : fs::directory_iterator(folder, status))
            if (entry.path().extension() == ".so") files.push_back(entry.path());
        if (status)
            throw InputError("plug-in folder '" + folder.string() + "': " + status.message());
        if (files.empty())
            throw InputError("plug-in folder '" + folder.string() +
                             "' holds no plug-in (*.so; folders below it are not looked into)");
        std::sort(files.begin(), files.end());
        for (const fs::path& file : files) {
            m_origin = file.string();
            m_loading = true;
            m_refusal.clear();
            // Runs the plug-in's static initialisers, which call add().
            void* handle = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
            m_loading = false;
            m_origin = "built in";
            if (!handle) throw InputError("plug-in '" + file.string() + "': " + dlerror());
            if (!m_refusal.empty())
                throw InputError("plug-in '" + file.string() + "': " + m_refusal);
        }
    }
}

} // namespace rayloom
