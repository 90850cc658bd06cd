// How the programs of simulated devices end: by Ctrl-C or kill, which they wait for.
#pragma once

#include <csignal>

namespace etalon {

// To be called before any thread is started: threads inherit the mask, so no signal interrupts one
// of them. The result is for sigwait().
inline sigset_t block_ending_signals() {
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals, nullptr);
    return signals;
}

}  // namespace etalon
