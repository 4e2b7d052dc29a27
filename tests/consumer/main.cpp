// SPDX-License-Identifier: Apache-2.0
// Uses rayloom from outside: loads plug-ins from the folders given and prints every node's name.
#include <rayloom/core/install_paths.h>
#include <rayloom/core/registry.h>

#include <cstdio>

int main(int argc, char** argv)
try {
    rayloom::ImageBuffer image({-8, -8, 8, 8}, 3);
    image.fill(0.5f);
    if (image.view().at(2, 7, 7) != 0.5f) return 1;
    if (argc > 1) rayloom::Registry::instance().load_plugins(argv[1]);
    for (const rayloom::NodeInfo* node : rayloom::Registry::instance().all())
        std::printf("%s (%s)\n", node->name.c_str(), node->origin.c_str());
    std::printf("data: %s\n", rayloom::data_folder().c_str());
} catch (const rayloom::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return error.exit_code();
}
