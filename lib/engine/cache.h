// SPDX-License-Identifier: Apache-2.0
/// \file
/// Results kept on disk between runs, found by the hash of what made them. Files are complete or
/// absent (written under another name, then renamed), carry a checksum, and may be shared by
/// processes; one that is damaged counts as absent and is removed.
#pragma once

#include "rayloom/core/node.h"
#include "rayloom/engine/plan.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace rayloom
{

/// Receives the tiles of one image in any order, from any thread.
class CacheWriter
{
public:
    CacheWriter(std::string path, const Region& window, int channels);
    ~CacheWriter();
    CacheWriter(const CacheWriter&) = delete;
    CacheWriter& operator=(const CacheWriter&) = delete;

    /// Stores the pixels of the view. A cache that cannot be written is given up quietly: it only
    /// costs time.
    void write(ConstImageView tile);
    /// Makes the entry visible if every pixel was written.
    void commit();

private:
    struct State;
    std::unique_ptr<State> m_state;
};

/// One output of an item, as the cache knows it.
struct CachedOutput {
    std::string key, port;
    int channels = 0;
};

class Cache
{
public:
    /// Makes the folder when it is not there. Throws OutputError when it cannot.
    explicit Cache(std::string folder);

    std::unique_ptr<CacheWriter> writer(const std::string& key, const Region& window,
                                        int channels) const;
    /// A node that hands out stored images as outputs of one item; null unless all are there.
    std::shared_ptr<const Node> find(const std::vector<CachedOutput>& outputs,
                                     const Region& window) const;
    void store_totals(const std::string& key, const std::vector<double>& totals) const;
    std::optional<std::vector<double>> find_totals(const std::string& key) const;

private:
    std::string path(const std::string& key, const char* suffix) const;
    std::string m_folder;
};

/// How much a cache may hold unless the user says otherwise.
constexpr std::size_t usual_cache_bytes = 20'000'000'000;

/// Removes the entries that were unused for longest until the others take no more than `bytes`, and
/// what stopped runs left half written. Processes that share the folder notice nothing but that an
/// entry is absent; one they have begun to read stays until they are done. Never throws: what
/// cannot be removed stays.
void trim_cache(const std::string& folder, std::size_t bytes);

/// Replaces items whose results are in the cache. Called by make_plan().
void apply_cache(Plan& plan, const std::string& folder);

} // namespace rayloom
