// SPDX-License-Identifier: Apache-2.0
/// \file
/// The parts of the `rayloom` command. Each subcommand is one file; it parses, calls the library
/// and prints.
#pragma once

#include <CLI/CLI.hpp>

#include <functional>
#include <string>

namespace rayloom::cli
{

/// Set by a chosen subcommand; returns the exit code.
using Action = std::function<int()>;

void add_run(CLI::App& app, Action& action);
void add_plan(CLI::App& app, Action& action);
void add_graph_commands(CLI::App& app, Action& action); ///< check, picture
void add_node_commands(CLI::App& app, Action& action);  ///< nodes, help, docs, schema
void add_info(CLI::App& app, Action& action);
void add_compare(CLI::App& app, Action& action);

} // namespace rayloom::cli
