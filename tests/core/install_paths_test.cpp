// SPDX-License-Identifier: Apache-2.0
#include "rayloom/core/install_paths.h"
#include "tests/support/folders.h"

#include <gtest/gtest.h>

namespace rayloom
{
namespace
{

TEST(InstallPaths, BuildFolderAnswersWithTheGraphsOfTheSourceTree)
{
    const std::filesystem::path graphs = data_folder() / "graphs";
    ASSERT_TRUE(std::filesystem::is_directory(graphs)) << graphs;
    EXPECT_TRUE(std::filesystem::equivalent(graphs, test::source_folder() / "graphs"));
}

} // namespace
} // namespace rayloom
