// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/cache.h"
#include "tests/support/engine_nodes_for_tests.h"
#include "tests/support/temporary_folder.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <sys/stat.h>

namespace rayloom::test
{
namespace
{

namespace fs = std::filesystem;
using std::chrono::hours;

void make_old(const fs::path& file, hours age)
{
    fs::last_write_time(file, fs::file_time_type::clock::now() - age);
}

void make_entry(const TemporaryFolder& folder, const std::string& name, std::size_t bytes,
                hours age)
{
    std::ofstream(folder.path() / name) << std::string(bytes, 'x');
    make_old(folder.path() / name, age);
}

using Names = std::vector<std::string>;

TEST(Cache, TheEntriesUnusedForLongestGo)
{
    const TemporaryFolder folder;
    make_entry(folder, "a.image", 400, hours(1));
    make_entry(folder, "b.image", 400, hours(3));
    make_entry(folder, "c.totals", 100, hours(2));
    make_entry(folder, "d.image", 400, hours(4));
    const auto left = [&](std::size_t bytes) {
        trim_cache(folder.path(), bytes);
        return folder.names();
    };
    EXPECT_EQ(left(1300), (Names{"a.image", "b.image", "c.totals", "d.image"}));
    EXPECT_EQ(left(1299), (Names{"a.image", "b.image", "c.totals"}));
    EXPECT_EQ(left(500), (Names{"a.image", "c.totals"}));
    EXPECT_EQ(left(100), Names{});
}

TEST(Cache, RemovesWhatWasLeftHalfWrittenAndNothingItDidNotWrite)
{
    const TemporaryFolder folder;
    make_entry(folder, "a.image.tmp123.0", 400, hours(48));
    make_entry(folder, "a.image.tmp124.0", 400, hours(1));
    make_entry(folder, "notes.txt", 400, hours(48));
    fs::create_directory(folder.path() / "shots.image");
    trim_cache(folder.path(), 1);
    EXPECT_EQ(folder.names(), (Names{"a.image.tmp124.0", "notes.txt", "shots.image"}));
    trim_cache(folder.file("gone"), 1);
}

TEST(Cache, AResultThatIsUsedAgainStays)
{
    const TemporaryFolder folder;
    const auto image = noise_image({0, 0, 40, 30}, 3);
    RunOptions options;
    options.cache_folder = folder.path();
    const auto run = [&](const std::string& factor) {
        run_text("rayloom: 1\nname: cached\ninputs: {color: noisy}\nnodes:\n"
                 "  a: {op: oiio.blur, image: color, width: " +
                     factor + "}\noutputs: {image: a}\n",
                 {{"color", image}}, options);
        return folder.names();
    };
    const Names first = run("3");
    ASSERT_EQ(first.size(), 1u);
    run("5");
    for (const std::string& name : folder.names())
        make_old(folder.file(name), hours(name == first.front() ? 3 : 2));
    run("3");
    trim_cache(folder.path(), fs::file_size(folder.file(first.front())));
    EXPECT_EQ(folder.names(), first);
    // A pipe of that name is not waited for, and the result is written again.
    const std::string entry = folder.file(first.front());
    fs::remove(entry);
    ASSERT_EQ(::mkfifo(entry.c_str(), 0600), 0);
    EXPECT_EQ(run("3"), first);
    EXPECT_TRUE(fs::is_regular_file(entry));
}

} // namespace
} // namespace rayloom::test
