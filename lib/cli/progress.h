// SPDX-License-Identifier: Apache-2.0
/// \file
/// Progress on stderr: a bar on a terminal, whole lines elsewhere.
#pragma once

#include <chrono>
#include <string>

namespace rayloom::cli
{

class Progress
{
public:
    /// `title` names the frame; `index` of `count` frames counts into the bar of the whole job.
    Progress(std::string title, std::size_t index, std::size_t count);
    /// Clears the bar.
    ~Progress();
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;

    void show(double share);
    /// A line that stays.
    void message(const std::string& text);

private:
    std::string m_title;
    std::size_t m_index, m_count;
    bool m_terminal;
    bool m_shown = false;
    int m_last_percent = -1;
    std::chrono::steady_clock::time_point m_start;
};

} // namespace rayloom::cli
