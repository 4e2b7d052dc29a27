// SPDX-License-Identifier: Apache-2.0
/// \file
/// Ctrl-C and friends as a stop request.
#pragma once

#include <csignal>
#include <pthread.h>

#include <atomic>
#include <stop_token>
#include <thread>

namespace rayloom::cli
{

/// While it lives, SIGINT, SIGTERM and SIGHUP ask the run to stop instead of ending the process. A
/// thread waits for them, because little may be done in a signal handler. Make it before other
/// threads, which inherit the signal mask. A second signal ends the process at once.
class StopSignals
{
public:
    StopSignals();
    ~StopSignals();
    StopSignals(const StopSignals&) = delete;
    StopSignals& operator=(const StopSignals&) = delete;

    std::stop_token token() const { return m_stop.get_token(); }

private:
    std::stop_source m_stop;
    std::atomic<bool> m_done{false};
    sigset_t m_before{};
    std::thread m_waiter;
};

} // namespace rayloom::cli
