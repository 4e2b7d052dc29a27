// SPDX-License-Identifier: Apache-2.0
/// \file
/// A place for the files of a test.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace rayloom::test
{

/// A folder that is empty at first and gone at the end.
class TemporaryFolder
{
public:
    TemporaryFolder();
    ~TemporaryFolder();
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;

    const std::filesystem::path& path() const { return m_path; }
    /// The path of a file in it.
    std::string file(const std::string& name) const { return (m_path / name).string(); }
    /// Names of everything in it, sorted.
    std::vector<std::string> names() const;

private:
    std::filesystem::path m_path;
};

} // namespace rayloom::test
