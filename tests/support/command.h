// SPDX-License-Identifier: Apache-2.0
/// \file
/// Running programs from tests.
#pragma once

#include "tests/support/temporary_folder.h"

#include <filesystem>
#include <string>
#include <vector>

namespace rayloom::test
{

struct CommandResult {
    int exit_code = -1; ///< 128 + signal when a signal ended it
    std::string out, err;
};

/// Runs a program with arguments (no shell in between) in `folder`, waits, and gives what it
/// printed. `environment` holds NAME=value pairs that are added.
CommandResult run_command(const std::vector<std::string>& arguments,
                          const std::filesystem::path& folder,
                          const std::vector<std::string>& environment = {});

/// The built `rayloom` with these arguments.
CommandResult rayloom(std::vector<std::string> arguments, const std::filesystem::path& folder,
                      const std::vector<std::string>& environment = {});

/// How many times as long things may take in this build: sanitizers slow them down.
double slowness();

/// The built `rayloom`, started and not waited for.
class StartedCommand
{
public:
    StartedCommand(std::vector<std::string> arguments, const std::filesystem::path& folder);
    /// Closes what it listens at; ends nothing.
    ~StartedCommand();
    StartedCommand(const StartedCommand&) = delete;
    StartedCommand& operator=(const StartedCommand&) = delete;
    /// Reads what the command says on standard error until it says `word`; false when it ends
    /// before.
    bool says(const std::string& word) const;
    int process() const { return m_process; }

private:
    int m_process = -1, m_listening = -1;
};

} // namespace rayloom::test
