// SPDX-License-Identifier: Apache-2.0
// The pages under docs/ say what the command does: their examples run, their options exist, and the
// node pages are those the nodes themselves make.
#include "tests/support/command.h"
#include "tests/support/folders.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <set>
#include <sstream>

namespace rayloom::test
{
namespace
{

namespace fs = std::filesystem;

const fs::path source = test::source_folder();

std::string text_of(const fs::path& file)
{
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

/// What stands in fenced blocks, in order: the language and the text.
std::vector<std::pair<std::string, std::string>> blocks_of(const std::string& page)
{
    std::vector<std::pair<std::string, std::string>> blocks;
    std::istringstream lines(page);
    bool inside = false;
    for (std::string line; std::getline(lines, line);) {
        if (line.starts_with("```")) {
            inside = !inside;
            if (inside) blocks.emplace_back(line.substr(3), "");
        } else if (inside) {
            blocks.back().second += line + "\n";
        }
    }
    return blocks;
}

std::set<std::string> options_in(const std::string& text)
{
    static const std::regex option("--[a-z][a-z-]+");
    return {std::sregex_token_iterator(text.begin(), text.end(), option), {}};
}

TEST(CommandPage, ItsExamplesRun)
{
    const TemporaryFolder folder;
    const fs::path scene = source / "tests/data/cycles/interior";
    fs::create_directory_symlink(scene / "stack", folder.path() / "stack");
    fs::copy(scene / "noisy_16.exr", folder.path() / "noisy.exr");
    fs::copy(scene / "ref.exr", folder.path() / "ref.exr");
    for (const char* shot : {"shot.0001.exr", "shot.0002.exr"})
        fs::copy(scene / "stack/s01.exr", folder.path() / shot);
    int examples = 0;
    for (const auto& [language, text] : blocks_of(text_of(source / "docs/command.md"))) {
        std::smatch name;
        static const std::regex first_line("^# ([a-z-]+\\.yaml)\n");
        if (language == "yaml" && std::regex_search(text, name, first_line))
            std::ofstream(folder.path() / name[1].str()) << text;
        if (language != "sh") continue;
        ++examples;
        const CommandResult r = run_command(
            {"sh", "-e", "-c", "PATH='" + test::build_folder().string() + "/bin':$PATH\n" + text},
            folder.path());
        EXPECT_EQ(r.exit_code, 0) << text << r.err;
    }
    EXPECT_GE(examples, 10);
}

TEST(CommandPage, NamesEveryOptionAndNoOther)
{
    const std::string page = text_of(source / "docs/command.md");
    const TemporaryFolder folder;
    std::set<std::string> known{"--help", "--version"};
    std::string help = rayloom({"--help"}, folder.path()).out;
    for (const char* command : {"run", "plan", "check", "picture", "nodes", "graphs", "help",
                                "docs", "schema", "info", "compare"}) {
        EXPECT_THAT(page, ::testing::HasSubstr("rayloom " + std::string(command))) << command;
        EXPECT_THAT(help, ::testing::HasSubstr("  " + std::string(command) + " ")) << command;
        known.merge(options_in(rayloom({command, "--help"}, folder.path()).out));
    }
    known.merge(options_in(help));
    EXPECT_EQ(options_in(page), known);
}

/// All files of a folder by name.
std::map<std::string, std::string> files_of(const fs::path& folder)
{
    std::map<std::string, std::string> files;
    if (fs::exists(folder))
        for (const auto& entry : fs::directory_iterator(folder))
            files[entry.path().filename().string()] = text_of(entry.path());
    return files;
}

TEST(NodePages, AreThoseTheNodesMake)
{
    const TemporaryFolder folder;
    const CommandResult r = rayloom({"docs", "--out", "pages"}, folder.path());
    ASSERT_EQ(r.exit_code, 0) << r.err;
    const auto made = files_of(folder.path() / "pages"), kept = files_of(source / "docs/nodes");
    std::string differing;
    for (const auto& [name, text] : made)
        if (const auto it = kept.find(name); it == kept.end() || it->second != text)
            differing += " " + name;
    for (const auto& [name, text] : kept)
        if (!made.contains(name)) differing += " " + name + " (of no node)";
    EXPECT_EQ(differing, "") << "docs/nodes is not what the nodes declare; mend it with ./dev docs";
}

TEST(DocPages, LinksLeadSomewhere)
{
    static const std::regex link("\\]\\(([^)#:]+)(#[^)]*)?\\)");
    std::vector<fs::path> pages{source / "README.md", source / "CHANGELOG.md"};
    for (const auto& entry : fs::recursive_directory_iterator(source / "docs"))
        if (entry.path().extension() == ".md") pages.push_back(entry.path());
    for (const fs::path& page : pages) {
        const std::string text = text_of(page);
        for (std::sregex_iterator it(text.begin(), text.end(), link), end; it != end; ++it)
            EXPECT_TRUE(fs::exists(page.parent_path() / (*it)[1].str()))
                << page << ": " << (*it)[1].str();
    }
}

TEST(DocPages, TheIndexNamesEveryPage)
{
    const std::string index = text_of(source / "docs/README.md");
    for (const auto& entry : fs::recursive_directory_iterator(source / "docs")) {
        const std::string page = fs::relative(entry.path(), source / "docs").string();
        if (entry.path().extension() != ".md" || page == "README.md") continue;
        if (page.starts_with("nodes/") && page != "nodes/README.md") continue;
        EXPECT_THAT(index, ::testing::HasSubstr("(" + page + ")"));
    }
}

} // namespace
} // namespace rayloom::test
