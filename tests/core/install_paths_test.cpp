// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/install_paths.h"

#include <gtest/gtest.h>

namespace rayloom
{
namespace
{

TEST(InstallPaths, BuildFolderAnswersWithTheGraphsOfTheSourceTree)
{
    const std::filesystem::path graphs = data_folder() / "graphs";
    ASSERT_TRUE(std::filesystem::is_directory(graphs)) << graphs;
    EXPECT_TRUE(
        std::filesystem::equivalent(graphs, std::filesystem::path(RAYLOOM_SOURCE_DIR) / "graphs"));
}

} // namespace
} // namespace rayloom
