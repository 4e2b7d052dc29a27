// SPDX-License-Identifier: Apache-2.0
/// \file
/// A file that appears under its name complete or not at all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

namespace rayloom
{

/// Throws OutputError unless a file of this name could be made: its folder exists and may be
/// written to, and the name is no folder or device. Touches nothing.
void check_writable(const std::string& path);

/// Throws OutputError unless write_text_file() could write there. Touches nothing.
void check_text_writable(const std::string& path);

/// Writes a whole text: into a file as AtomicFile does, into a device or a pipe as it is. Throws
/// OutputError.
void write_text_file(const std::string& path, const std::string& text);

/// Written in the folder of its final name, then renamed onto it. Until commit() an earlier file of
/// that name stays as it was. Where the file system can, what is being written has no name at all,
/// so that not even a killed process leaves anything; elsewhere it is a hidden file that is removed
/// unless committed. A symbolic link is followed, so that the link stays.
class AtomicFile
{
public:
    /// Throws OutputError.
    explicit AtomicFile(const std::string& path);
    /// Discards what was not committed.
    ~AtomicFile();
    AtomicFile(const AtomicFile&) = delete;
    AtomicFile& operator=(const AtomicFile&) = delete;

    /// Appends at the current place. Throws OutputError ("no space left on device", …); so does
    /// every later call.
    void write(const void* data, std::size_t bytes);
    void seek(std::uint64_t position);
    std::uint64_t tell() const;

    /// Flushes to disk and gives the file its name. Throws OutputError; the earlier file is then
    /// still there.
    void commit();
    void discard() noexcept;

    const std::string& path() const;
    /// What went wrong so far; empty when nothing did.
    const std::string& failure() const;

private:
    struct State;
    std::unique_ptr<State> m_state;
};

} // namespace rayloom
