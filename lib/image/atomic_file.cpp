// SPDX-License-Identifier: Apache-2.0
#include "rayloom/image/atomic_file.h"

#include "rayloom/core/error.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <random>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

namespace rayloom
{

namespace
{
constexpr std::size_t buffer_bytes = std::size_t{1} << 20;

namespace fs = std::filesystem;

// The file a chain of links ends at, whether it exists or not.
fs::path resolve_links(const fs::path& path)
{
    fs::path at = path;
    std::error_code error;
    for (int i = 0; fs::is_symlink(fs::symlink_status(at, error)); ++i) {
        if (i == 40) throw OutputError(path.string() + ": is a link that leads back to itself");
        const fs::path to = fs::read_symlink(at, error);
        if (error) break;
        at = to.is_absolute() ? to : at.parent_path() / to;
    }
    return at;
}

fs::path folder_of(const fs::path& path)
{
    const fs::path folder = path.parent_path();
    return folder.empty() ? fs::path(".") : folder;
}

/// What has no content to keep: a terminal, a pipe, /dev/stdout.
bool is_device(const fs::path& path)
{
    std::error_code error;
    const fs::file_status status = fs::status(path, error);
    return fs::is_character_file(status) || fs::is_fifo(status) || fs::is_socket(status);
}

std::string hidden_name(const fs::path& target)
{
    // Names may have 255 bytes; the final name is for whoever finds a left-over.
    std::random_device random;
    char digits[24];
    std::snprintf(digits, sizeof digits, "%08x%08x", random(), random());
    return "." + target.filename().string().substr(0, 200) + "." + digits + ".part";
}
} // namespace

void check_writable(const std::string& path)
{
    const fs::path target = resolve_links(path);
    const fs::path folder = folder_of(target);
    struct stat status {
    };
    if (target.filename().empty()) throw OutputError(path + ": is a folder, not a file name");
    if (::stat(folder.c_str(), &status) != 0)
        throw OutputError(path + ": the folder " + folder.string() +
                          " cannot be written to: " + std::strerror(errno));
    if (!S_ISDIR(status.st_mode))
        throw OutputError(path + ": " + folder.string() + " is not a folder");
    if (::access(folder.c_str(), W_OK | X_OK) != 0)
        throw OutputError(path + ": the folder " + folder.string() +
                          " cannot be written to: " + std::strerror(errno));
    if (::stat(target.c_str(), &status) == 0 && !S_ISREG(status.st_mode))
        throw OutputError(path + ": " + (S_ISDIR(status.st_mode) ? "is a folder" : "is no file") +
                          ", and would have to be replaced");
}

void check_text_writable(const std::string& path)
{
    if (!is_device(path)) check_writable(path);
}

void write_text_file(const std::string& path, const std::string& text)
{
    if (is_device(path)) {
        std::ofstream out(path, std::ios::binary);
        if (!out.write(text.data(), static_cast<std::streamsize>(text.size())).flush())
            throw OutputError(path + ": cannot be written: " + std::strerror(errno));
        return;
    }
    AtomicFile file(path);
    file.write(text.data(), text.size());
    file.commit();
}

struct AtomicFile::State {
    std::string path; ///< as the user wrote it
    fs::path target;  ///< where links lead
    fs::path hidden;  ///< empty while the file has no name
    int fd = -1;
    std::vector<char> buffer;
    std::uint64_t flushed = 0; ///< place of the buffer's first byte
    std::string failure;

    [[noreturn]] void fail(const char* what, int error)
    {
        if (failure.empty()) failure = path + ": " + what + ": " + std::strerror(error);
        throw OutputError(failure);
    }

    void flush()
    {
        if (!failure.empty()) throw OutputError(failure);
        const char* from = buffer.data();
        std::size_t left = buffer.size();
        while (left > 0) {
            const ssize_t n = ::pwrite(fd, from, left, static_cast<off_t>(flushed));
            if (n < 0 && errno == EINTR) continue;
            if (n <= 0) fail("cannot be written", n < 0 ? errno : ENOSPC);
            from += n;
            left -= static_cast<std::size_t>(n);
            flushed += static_cast<std::uint64_t>(n);
        }
        buffer.clear();
    }
};

AtomicFile::AtomicFile(const std::string& path) : m_state(std::make_unique<State>())
{
    check_writable(path);
    State& s = *m_state;
    s.path = path;
    s.target = resolve_links(path);
    const fs::path folder = folder_of(s.target);
#ifdef O_TMPFILE
    s.fd = ::open(folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0666);
    // Naming it later goes through /proc.
    if (s.fd >= 0 && ::access("/proc/self/fd", X_OK) != 0) {
        ::close(s.fd);
        s.fd = -1;
    }
#endif
    if (s.fd < 0) {
        s.hidden = folder / hidden_name(s.target);
        s.fd = ::open(s.hidden.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666);
        if (s.fd < 0) {
            s.hidden.clear();
            s.fail("cannot be made", errno);
        }
    }
    struct stat earlier {
    };
    if (::stat(s.target.c_str(), &earlier) == 0) ::fchmod(s.fd, earlier.st_mode & 07777);
    s.buffer.reserve(buffer_bytes);
}

AtomicFile::~AtomicFile() { discard(); }

void AtomicFile::write(const void* data, std::size_t bytes)
{
    State& s = *m_state;
    if (!s.failure.empty()) throw OutputError(s.failure);
    const char* from = static_cast<const char*>(data);
    while (bytes > 0) {
        const std::size_t n = std::min(bytes, buffer_bytes - s.buffer.size());
        s.buffer.insert(s.buffer.end(), from, from + n);
        from += n;
        bytes -= n;
        if (s.buffer.size() == buffer_bytes) s.flush();
    }
}

void AtomicFile::seek(std::uint64_t position)
{
    if (position == tell()) return;
    m_state->flush();
    m_state->flushed = position;
}

std::uint64_t AtomicFile::tell() const { return m_state->flushed + m_state->buffer.size(); }

void AtomicFile::commit()
{
    State& s = *m_state;
    s.flush();
    if (::fsync(s.fd) != 0) s.fail("cannot be written to disk", errno);
    const fs::path folder = folder_of(s.target);
    if (s.hidden.empty()) {
        // A link cannot replace a file, so it gets a hidden name first and is renamed like the
        // rest.
        const fs::path hidden = folder / hidden_name(s.target);
        const std::string self = "/proc/self/fd/" + std::to_string(s.fd);
        if (::linkat(AT_FDCWD, self.c_str(), AT_FDCWD, hidden.c_str(), AT_SYMLINK_FOLLOW) != 0)
            s.fail("cannot be given its name", errno);
        s.hidden = hidden;
    }
    if (::rename(s.hidden.c_str(), s.target.c_str()) != 0) {
        const int error = errno;
        ::unlink(s.hidden.c_str());
        s.hidden.clear();
        s.fail("cannot be given its name", error);
    }
    s.hidden.clear();
    ::close(s.fd);
    s.fd = -1;
    // The new name is on disk too once the folder is; a file system that cannot do this still has
    // the file.
    const int folder_fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder_fd >= 0) {
        ::fsync(folder_fd);
        ::close(folder_fd);
    }
}

void AtomicFile::discard() noexcept
{
    State& s = *m_state;
    if (s.fd >= 0) ::close(s.fd);
    s.fd = -1;
    if (!s.hidden.empty()) ::unlink(s.hidden.c_str());
    s.hidden.clear();
    if (s.failure.empty()) s.failure = s.path + ": was not written to its end";
}

const std::string& AtomicFile::path() const { return m_state->path; }
const std::string& AtomicFile::failure() const { return m_state->failure; }

} // namespace rayloom
