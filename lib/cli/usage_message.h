// SPDX-License-Identifier: Apache-2.0
/// \file
/// What is said about a command line that cannot be understood.
#pragma once

#include <CLI/CLI.hpp>

#include <string>
#include <vector>

namespace rayloom::cli
{

/// What is wrong and what was probably meant, for people. `words` is the command line without the
/// program's name.
std::string usage_message(const CLI::App& app, const CLI::Error& error,
                          const std::vector<std::string>& words);

} // namespace rayloom::cli
