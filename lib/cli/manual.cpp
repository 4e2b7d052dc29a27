// SPDX-License-Identifier: Apache-2.0
#include "rayloom/cli/manual.h"

#include "rayloom/core/version.h"

#include <array>
#include <string_view>
#include <utility>

namespace rayloom::cli
{

namespace
{

using Named = std::pair<std::string_view, std::string_view>;

constexpr std::array<Named, 8> exit_codes{{
    {"0", "done; warnings, if any, were printed"},
    {"1", "a limit of compare --fail is broken"},
    {"2", "the command line or the graph is wrong"},
    {"3", "an input file, a graph file or a plug-in is missing or damaged"},
    {"4", "an output cannot be written"},
    {"5", "memory, or the budget, does not suffice"},
    {"70", "an error of rayloom itself"},
    {"130", "stopped by a signal"},
}};

constexpr std::array<Named, 2> environment{{
    {"RAYLOOM_PLUGINS", "folders, separated by ':', whose shared libraries bring more nodes"},
    {"RAYLOOM_GRAPH_PATH",
     "folders, separated by ':', in which graphs and renderer maps are found by name"},
}};

std::vector<const CLI::App*> commands(const CLI::App& app)
{
    return app.get_subcommands([](const CLI::App*) { return true; });
}

/// Text for roff: dashes are dashes, and no line begins with a control character.
std::string roff(std::string_view text)
{
    std::string out;
    for (const char c : text) {
        const bool begins_line = out.empty() || out.back() == '\n';
        if (begins_line && (c == '.' || c == '\'')) out += "\\&";
        if (c == '-' || c == '\\') out += '\\';
        out += c == '\\' ? 'e' : c;
    }
    return out;
}

void item(std::string& page, const std::string& term, std::string_view text)
{
    page += ".TP\n.B " + roff(term) + "\n" + roff(text) + "\n";
}

/// "-i, --input NAME=PATH"
std::string option_term(const CLI::Option& option)
{
    std::string term;
    for (const std::string& name : option.get_snames()) term += "-" + name + ", ";
    for (const std::string& name : option.get_lnames()) term += "--" + name + ", ";
    if (!term.empty()) term.resize(term.size() - 2);
    if (option.get_positional()) return option.get_type_name();
    const std::string value = option.get_items_expected_max() > 0 ? option.get_type_name() : "";
    return value.empty() ? term : term + " " + value;
}

std::string words_of(const std::vector<std::string>& words)
{
    std::string out;
    for (const std::string& word : words) out += (out.empty() ? "" : " ") + word;
    return out;
}

/// What a completion cannot know beforehand it asks the command for.
constexpr std::string_view completion_head =
    R"bash(# bash completion of rayloom; made by: rayloom docs --completion FILE
_rayloom_names() { rayloom "$1" 2>/dev/null | sed 's/ .*//'; }

# Names of the inputs, outputs or params of the graph on the command line.
_rayloom_of_graph() {
    local word graph=
    for word in "${COMP_WORDS[@]:2}"; do
        case $word in -*) ;; *) graph=$word && break ;; esac
    done
    rayloom check --json -- "$graph" 2>/dev/null |
        grep "\"$1\": \\[" | grep -o '{"name": "[^"]*"' | sed 's/.*"\(.*\)"/\1=/'
}

_rayloom() {
    local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]} command=${COMP_WORDS[1]}
    local options=
    COMPREPLY=()
    compopt -o default 2>/dev/null # files where nothing else fits
    # Bash takes a word apart at '='; what follows is the name of a file.
    [ "$word" = = ] && return
    [ "$before" = = ] && return
)bash";

constexpr std::string_view completion_tail = R"bash(    case $before in
    -i | --input) words=$(_rayloom_of_graph inputs) ;;
    -o | --output)
        [ "$command" = picture ] && return
        words=$(_rayloom_of_graph outputs)
        ;;
    -p | --param) words=$(_rayloom_of_graph params) ;;
    *)
        case $command:$word in
        *:-*) words=$options ;;
        help:*) words="$(_rayloom_names nodes) $(_rayloom_names graphs) $commands" ;;
        run:* | plan:* | check:* | picture:*)
            [ "$COMP_CWORD" -eq 2 ] || [ "$command" = check ] || return
            words=$(_rayloom_names graphs)
            ;;
        *) return ;;
        esac
        ;;
    esac
    COMPREPLY=($(compgen -W "$words" -- "$word"))
    case ${COMPREPLY[0]} in *=) compopt -o nospace 2>/dev/null ;; esac
}
complete -F _rayloom rayloom
)bash";

} // namespace

std::vector<std::string> command_names(const CLI::App& app)
{
    std::vector<std::string> names;
    for (const CLI::App* command : commands(app)) names.push_back(command->get_name());
    return names;
}

std::vector<std::string> option_names(const CLI::App& command)
{
    std::vector<std::string> names;
    for (const CLI::Option* option : command.get_options())
        for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    return names;
}

std::string help_footer()
{
    std::string text = "Exit codes:\n";
    for (const auto& [code, meaning] : exit_codes)
        text += "  " + std::string(code) + std::string(5 - code.size(), ' ') +
                std::string(meaning) + "\n";
    text += "Environment:\n";
    for (const auto& [name, meaning] : environment)
        text += "  " + std::string(name) + "\n      " + std::string(meaning) + "\n";
    text.pop_back();
    return text;
}

std::string manual_page(const CLI::App& app)
{
    std::string page = ".TH RAYLOOM 1 \"\" \"rayloom " + version() + "\"\n.SH NAME\nrayloom \\- " +
                       roff(app.get_description()) +
                       "\n.SH SYNOPSIS\n.B rayloom\n.RB [ \\-\\-simd\n.IR TARGET ]\n.I COMMAND\n"
                       ".RI [ ARGUMENT... ]\n";
    page += ".SH OPTIONS\n";
    for (const CLI::Option* option : app.get_options())
        item(page, option_term(*option), option->get_description());
    page += ".SH COMMANDS\n";
    for (const CLI::App* command : commands(app)) {
        page += ".SS " + command->get_name() + "\n" + roff(command->get_description()) + ".\n";
        for (const CLI::Option* option : command->get_options())
            if (option->get_lnames() != std::vector<std::string>{"help"})
                item(page, option_term(*option), option->get_description());
    }
    page += ".SH EXIT STATUS\n";
    for (const auto& [code, meaning] : exit_codes) item(page, std::string(code), meaning);
    page += ".SH ENVIRONMENT\n";
    for (const auto& [name, meaning] : environment) item(page, std::string(name), meaning);
    page += ".SH EXAMPLES\nSixteen renders of one frame, each with its own seed, denoised:\n.PP\n"
            ".nf\n.RS\nrayloom run ray\\-histogram\\-fusion\\-stack \\e\n"
            "    \\-i stack='stack/s%02d.exr@1\\-16:Combined' \\-o image=denoised.exr\n.RE\n.fi\n"
            ".SH SEE ALSO\n.BR oiiotool (1)\n";
    return page;
}

std::string bash_completion(const CLI::App& app)
{
    std::string script(completion_head);
    script += "    local words= commands='" + words_of(command_names(app)) + "'\n" +
              "    if [ \"$COMP_CWORD\" -eq 1 ]; then\n"
              "        COMPREPLY=($(compgen -W \"$commands " +
              words_of(option_names(app)) + "\" -- \"$word\"))\n        return\n    fi\n" +
              "    case $command in\n";
    for (const CLI::App* command : commands(app))
        script += "    " + command->get_name() + ") options='" + words_of(option_names(*command)) +
                  "' ;;\n";
    return script + "    esac\n" + std::string(completion_tail);
}

} // namespace rayloom::cli
