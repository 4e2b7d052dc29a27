// SPDX-License-Identifier: Apache-2.0
#include "rayloom/cli/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace rayloom::cli
{

namespace
{

constexpr int bar_width = 30;
/// Lines elsewhere than on a terminal come this many percent apart, and only for runs worth it.
constexpr int line_step = 10;
constexpr double patience_seconds = 1.0;

bool on_terminal()
{
    const char* term = std::getenv("TERM");
    return ::isatty(STDERR_FILENO) != 0 && term && std::strcmp(term, "dumb") != 0;
}

} // namespace

Progress::Progress(std::string title, std::size_t index, std::size_t count)
    : m_title(std::move(title)), m_index(index), m_count(std::max<std::size_t>(1, count)),
      m_terminal(on_terminal()), m_start(std::chrono::steady_clock::now())
{
}

Progress::~Progress()
{
    if (m_shown && m_terminal) std::fputs("\r\x1b[K", stderr);
}

void Progress::show(double share)
{
    const double all = (static_cast<double>(m_index) + share) / static_cast<double>(m_count);
    const int percent = static_cast<int>(100.0 * all);
    if (percent == m_last_percent) return;
    if (m_terminal) {
        const int filled = static_cast<int>(bar_width * share);
        std::string bar(static_cast<std::size_t>(filled), '#');
        bar.resize(bar_width, '.');
        std::fprintf(stderr, "\r[%s] %3d%% %s\x1b[K", bar.c_str(), percent, m_title.c_str());
        std::fflush(stderr);
        m_shown = true;
        m_last_percent = percent;
        return;
    }
    const double elapsed =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - m_start).count();
    if (elapsed < patience_seconds || percent / line_step == m_last_percent / line_step) return;
    std::fprintf(stderr, "progress %d%%%s%s\n", percent, m_title.empty() ? "" : " ",
                 m_title.c_str());
    m_last_percent = percent;
}

void Progress::message(const std::string& text)
{
    std::fprintf(stderr, "%s%s\n", m_shown && m_terminal ? "\r\x1b[K" : "", text.c_str());
}

} // namespace rayloom::cli
