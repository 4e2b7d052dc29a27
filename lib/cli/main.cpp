// SPDX-License-Identifier: Apache-2.0
#include "rayloom/cli/command.h"
#include "rayloom/cli/manual.h"
#include "rayloom/cli/usage_message.h"
#include "rayloom/core/error.h"
#include "rayloom/core/registry.h"
#include "rayloom/core/text.h"
#include "rayloom/core/version.h"
#include "rayloom/simd/targets.h"

#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <new>
#include <string_view>
#include <system_error>

namespace
{

std::string version_text()
{
    return "rayloom " + rayloom::version() + "\nOpenImageIO " + rayloom::openimageio_version() +
           "\nSIMD target " + rayloom::simd_target() + " (this machine has " +
           rayloom::join_names(rayloom::simd_targets()) + ")";
}

/// The whole command line, so that a farm's log is enough to repeat the run.
std::string command_line(int argc, char** argv)
{
    std::string out;
    for (int i = 0; i < argc; ++i) {
        std::string word = argv[i];
        if (word.find_first_of(" '\"$*?[#&;|<>()\\") != std::string::npos) {
            std::string quoted = "'";
            for (const char c : word)
                quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
            word = quoted + "'";
        }
        out += (i > 0 ? " " : "") + word;
    }
    return out;
}

/// A full disk behind a redirection is an error like any other.
void flush_output()
{
    if (!std::cout.flush() || std::fflush(stdout) != 0)
        throw rayloom::OutputError("standard output cannot be written");
}

} // namespace

int main(int argc, char** argv)
{
    CLI::App app{"Image-processing nodes and graphs for Monte Carlo renders"};
    app.name("rayloom");
    app.require_subcommand(1);
    app.set_version_flag("--version", version_text);
    app.footer(rayloom::cli::help_footer());
    std::string simd;
    app.add_option("--simd", simd, "SIMD target of the kernels, or auto")->type_name("TARGET");

    rayloom::cli::Action action;
    rayloom::cli::add_run(app, action);
    rayloom::cli::add_plan(app, action);
    rayloom::cli::add_graph_commands(app, action);
    rayloom::cli::add_node_commands(app, action);
    rayloom::cli::add_info(app, action);
    rayloom::cli::add_compare(app, action);

    app.failure_message([&](const CLI::App*, const CLI::Error& e) {
        return rayloom::cli::usage_message(app, e, {argv + 1, argv + argc});
    });
    try {
        try {
            app.parse(argc, argv);
        } catch (const CLI::ParseError& e) { // help, too
            const int code = app.exit(e);
            flush_output();
            return code == 0 ? 0 : 2;
        }
        if (const char* folders = std::getenv("RAYLOOM_PLUGINS"))
            rayloom::Registry::instance().load_plugins(folders);
        if (!simd.empty()) rayloom::use_simd_target(simd);
        const int code = action();
        flush_output();
        return code;
    } catch (const rayloom::Error& e) {
        std::cerr << "rayloom: " << e.what() << "\n";
        if (e.exit_code() != 130)
            std::cerr << "rayloom: the command was: " << command_line(argc, argv) << "\n";
        return e.exit_code();
    } catch (const std::bad_alloc&) {
        std::cerr << "rayloom: memory ran out\n";
        return 5;
    } catch (const std::exception& e) {
        // oneTBB has no type of its own for it.
        const auto* system = dynamic_cast<const std::system_error*>(&e);
        if ((system && system->code() == std::errc::resource_unavailable_try_again) ||
            std::string_view(e.what()).starts_with("pthread_create has failed")) {
            std::cerr << "rayloom: memory ran out: no thread could be started\n";
            return 5;
        }
        std::cerr << "rayloom: internal error: " << e.what()
                  << "\nrayloom: the command was: " << command_line(argc, argv) << "\n";
        return 70;
    }
}
