// SPDX-License-Identifier: Apache-2.0
#include "rayloom/cli/command.h"
#include "rayloom/image/renderer_map.h"

#include <iostream>
#include <memory>

namespace rayloom::cli
{

void add_info(CLI::App& app, Action& action)
{
    CLI::App* command =
        app.add_subcommand("info", "List the layers of a file and what rayloom takes them for");
    struct Arguments {
        std::vector<std::string> files;
        bool json = false;
    };
    auto arguments = std::make_shared<Arguments>();
    command->add_option("files", arguments->files, "Image files")->required()->type_name("FILE");
    command->add_flag("--json", arguments->json, "Print JSON");
    command->callback([arguments, &action] {
        action = [arguments] {
            for (const std::string& file : arguments->files) {
                const FileDescription description = describe_layers(file);
                std::cout << (arguments->json ? description.json() + "\n" : description.text());
            }
            return 0;
        };
    });
}

} // namespace rayloom::cli
