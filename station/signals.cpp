#include "station/signals.h"

#include <csignal>

namespace etalon {

StopOnSignals::StopOnSignals(std::stop_source source) {
    sigemptyset(&signals_);
    sigaddset(&signals_, SIGINT);
    sigaddset(&signals_, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
    thread_ = std::thread([this, source] { wait(source); });
}

StopOnSignals::~StopOnSignals() {
    ending_ = true;
    // Sent to that thread alone: its sigwait() returns, no handler runs, nothing is interrupted.
    pthread_kill(thread_.native_handle(), SIGTERM);
    thread_.join();
}

void StopOnSignals::wait(std::stop_source source) {
    while (!ending_) {
        int signal = 0;
        sigwait(&signals_, &signal);
        if (!ending_)
            source.request_stop();
    }
}

}  // namespace etalon
