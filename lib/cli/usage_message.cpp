// SPDX-License-Identifier: Apache-2.0
#include "rayloom/cli/usage_message.h"

#include "rayloom/cli/manual.h"
#include "rayloom/core/text.h"

namespace rayloom::cli
{

namespace
{

/// The word that stands where a command should; empty when there is none.
std::string command_word(const std::vector<std::string>& words)
{
    for (std::size_t i = 0; i < words.size(); ++i) {
        if (words[i] == "--simd")
            ++i; // its value
        else if (!words[i].starts_with('-'))
            return words[i];
    }
    return "";
}

} // namespace

std::string usage_message(const CLI::App& app, const CLI::Error& error,
                          const std::vector<std::string>& words)
{
    const std::string more = "\nrayloom --help lists the commands\n";
    const std::vector<CLI::App*> chosen = app.get_subcommands();
    if (chosen.empty()) {
        const std::string word = command_word(words);
        if (word.empty() && words.empty())
            return "rayloom: which command? There is: " + join_names(command_names(app)) + more;
        if (!word.empty())
            return "rayloom: there is no command '" + word + "'" +
                   suggestion(word, command_names(app)) + more;
        return std::string("rayloom: ") + error.what() + more;
    }
    const CLI::App& command = *chosen.back();
    std::string message = error.what();
    for (const std::string& word : command.remaining()) {
        if (!word.starts_with("--")) continue;
        const std::string name = word.substr(0, word.find('='));
        message = "there is no option '" + name + "'";
        if (const std::string near = closest_name(name, option_names(command)); !near.empty())
            message += "; did you mean '" + near + "'?";
        break;
    }
    return "rayloom " + command.get_name() + ": " + message + "\nrayloom " + command.get_name() +
           " --help lists what it takes\n";
}

} // namespace rayloom::cli
