// SPDX-License-Identifier: Apache-2.0
/// \file
/// What is made of the command's own description of its options: footer of the help, manual page,
/// shell completion.
#pragma once

#include <CLI/CLI.hpp>

#include <string>
#include <vector>

namespace rayloom::cli
{

/// Names of all commands.
std::vector<std::string> command_names(const CLI::App& app);
/// Long options of a command with their dashes.
std::vector<std::string> option_names(const CLI::App& command);

/// Exit codes and environment, below every help text.
std::string help_footer();
/// rayloom(1) in roff.
std::string manual_page(const CLI::App& app);
/// A script for bash, to be sourced.
std::string bash_completion(const CLI::App& app);

} // namespace rayloom::cli
