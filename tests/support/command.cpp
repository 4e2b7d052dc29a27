// SPDX-License-Identifier: Apache-2.0
#include "tests/support/command.h"

#include "tests/support/folders.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace rayloom::test
{

namespace fs = std::filesystem;

namespace
{
std::string text_of(const fs::path& file)
{
    std::ifstream in(file, std::ios::binary);
    std::ostringstream text;
    text << in.rdbuf();
    return text.str();
}
} // namespace

CommandResult run_command(const std::vector<std::string>& arguments, const fs::path& folder,
                          const std::vector<std::string>& environment)
{
    const TemporaryFolder capture;
    const std::string out = (capture.path() / "out").string(),
                      err = (capture.path() / "err").string();
    std::vector<char*> argv;
    for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
    argv.push_back(nullptr);
    const pid_t child = ::fork();
    if (child < 0) throw std::runtime_error("fork failed");
    if (child == 0) {
        for (const std::string& pair : environment) ::putenv(const_cast<char*>(pair.c_str()));
        const int in_fd = ::open("/dev/null", O_RDONLY);
        const int out_fd = ::open(out.c_str(), O_WRONLY | O_CREAT, 0600);
        const int err_fd = ::open(err.c_str(), O_WRONLY | O_CREAT, 0600);
        if (::chdir(folder.c_str()) != 0 || in_fd < 0 || out_fd < 0 || err_fd < 0) ::_exit(126);
        ::dup2(in_fd, 0);
        ::dup2(out_fd, 1);
        ::dup2(err_fd, 2);
        ::execvp(argv[0], argv.data());
        ::_exit(127);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    CommandResult result;
    result.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    result.out = text_of(out);
    result.err = text_of(err);
    return result;
}

StartedCommand::StartedCommand(std::vector<std::string> arguments, const fs::path& folder)
{
    arguments.insert(arguments.begin(), test::build_folder().string() + "/bin/rayloom");
    std::vector<char*> argv;
    for (std::string& a : arguments) argv.push_back(a.data());
    argv.push_back(nullptr);
    int ends[2] = {-1, -1};
    if (::pipe(ends) != 0) throw std::runtime_error("pipe failed");
    m_process = ::fork();
    if (m_process < 0) throw std::runtime_error("fork failed");
    if (m_process == 0) {
        if (::chdir(folder.c_str()) != 0 || ::dup2(ends[1], 2) < 0) ::_exit(126);
        ::close(ends[0]);
        ::close(ends[1]);
        ::execv(argv[0], argv.data());
        ::_exit(127);
    }
    ::close(ends[1]);
    m_listening = ends[0];
}

StartedCommand::~StartedCommand() { ::close(m_listening); }

bool StartedCommand::says(const std::string& word) const
{
    std::string said;
    for (char c = 0; said.find(word) == std::string::npos; said += c)
        if (::read(m_listening, &c, 1) != 1) return false;
    return true;
}

double slowness() { return RAYLOOM_TEST_SLOWNESS; }

CommandResult rayloom(std::vector<std::string> arguments, const fs::path& folder,
                      const std::vector<std::string>& environment)
{
    arguments.insert(arguments.begin(), test::build_folder().string() + "/bin/rayloom");
    return run_command(arguments, folder, environment);
}

} // namespace rayloom::test
