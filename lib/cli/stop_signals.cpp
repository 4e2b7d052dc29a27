// SPDX-License-Identifier: Apache-2.0
#include "rayloom/cli/stop_signals.h"

#include <unistd.h>

namespace rayloom::cli
{

namespace
{
sigset_t watched()
{
    sigset_t set;
    sigemptyset(&set);
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&set, signal);
    return set;
}
} // namespace

StopSignals::StopSignals()
{
    const sigset_t set = watched();
    pthread_sigmask(SIG_BLOCK, &set, &m_before);
    m_waiter = std::thread([this, set] {
        bool asked = false;
        for (;;) {
            int signal = 0;
            if (sigwait(&set, &signal) != 0 || m_done) return;
            if (asked) _exit(130);
            asked = true;
            m_stop.request_stop();
        }
    });
}

StopSignals::~StopSignals()
{
    m_done = true;
    pthread_kill(m_waiter.native_handle(), SIGINT);
    m_waiter.join();
    pthread_sigmask(SIG_SETMASK, &m_before, nullptr);
}

} // namespace rayloom::cli
