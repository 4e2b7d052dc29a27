// SPDX-License-Identifier: Apache-2.0
/// \file
/// Nodes of a graph that write files, and two writers of one file.
#include "tests/support/command.h"
#include "tests/support/folders.h"
#include "tests/support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

namespace rayloom::test
{
namespace
{

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::UnorderedElementsAre;

const char* const halved = R"(rayloom: 1
name: halved
inputs:
  image: {doc: linear radiance}
nodes:
  dim: {op: oiio.mul, image: image, value: 0.5}
  file: {op: io.write, image: dim, path: dim.exr}
outputs:
  same: image
  half: dim
)";

class WritingNodes : public ::testing::Test
{
protected:
    WritingNodes() { std::ofstream(m_folder.path() / "halved.yaml") << halved; }
    CommandResult run(const std::vector<std::string>& more) const
    {
        const fs::path image = source_folder() / "tests/data/cycles/cornell/stack/s01.exr";
        std::vector<std::string> arguments{"run", "halved.yaml", "-i", "image=" + image.string()};
        arguments.insert(arguments.end(), more.begin(), more.end());
        return rayloom(std::move(arguments), m_folder.path());
    }
    CommandResult compare(const std::string& a, const std::string& b) const
    {
        return rayloom({"compare", a, b, "--json"}, m_folder.path());
    }
    std::vector<std::string> names() const { return m_folder.names(); }
    std::string bytes(const std::string& name) const
    {
        std::ifstream file(m_folder.path() / name, std::ios::binary);
        return {std::istreambuf_iterator<char>(file), {}};
    }

private:
    TemporaryFolder m_folder;
};

TEST_F(WritingNodes, RunWithoutAnyOutputAskedFor)
{
    const CommandResult r = run({});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_THAT(names(), UnorderedElementsAre("halved.yaml", "dim.exr"));
    EXPECT_THAT(r.err, HasSubstr("dim.exr"));
}

TEST_F(WritingNodes, RunBesideTheOutputsAndWriteTheSame)
{
    const CommandResult r = run({"-o", "half=half.exr"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_THAT(names(), UnorderedElementsAre("halved.yaml", "dim.exr", "half.exr"));
    // The same pixels: the difference is black.
    const CommandResult c = compare("half.exr", "dim.exr");
    ASSERT_EQ(c.exit_code, 0) << c.err;
    EXPECT_THAT(c.out, HasSubstr("\"rmse\": 0"));
}

TEST_F(WritingNodes, KeepToTheRegionOfInterest)
{
    const CommandResult r = run({"-o", "half=half.exr", "--roi", "3,4,20,10"});
    ASSERT_EQ(r.exit_code, 0) << r.err;
    EXPECT_EQ(bytes("dim.exr").size(), bytes("half.exr").size());
    EXPECT_LT(bytes("dim.exr").size(), 10000u);
}

TEST_F(WritingNodes, DoNotOverwriteTheirFileFrameByFrame)
{
    const CommandResult r = run({"--frames", "1-2"});
    EXPECT_EQ(r.exit_code, 2);
    EXPECT_THAT(r.err, HasSubstr("node 'file' would write"));
    EXPECT_THAT(names(), ElementsAre("halved.yaml"));
}

TEST_F(WritingNodes, AFileHasOneWriter)
{
    for (const std::string& half : {std::string("a.exr"), std::string("./a.exr")}) {
        const CommandResult r = run({"-o", "same=a.exr", "-o", "half=" + half});
        EXPECT_EQ(r.exit_code, 2);
        EXPECT_THAT(r.err, HasSubstr("'same'"));
        EXPECT_THAT(r.err, HasSubstr("would both be written to"));
    }
    const CommandResult layers = run({"-o", "same=a.exr:A", "-o", "half=a.exr:B"});
    EXPECT_EQ(layers.exit_code, 2);
    const CommandResult node = run({"-o", "same=dim.exr"});
    EXPECT_EQ(node.exit_code, 2);
    EXPECT_THAT(node.err, HasSubstr("node 'file'"));
    EXPECT_THAT(names(), ElementsAre("halved.yaml"));
}

} // namespace
} // namespace rayloom::test
