#include "station/shell/signals.h"

namespace etalon {

namespace {

bool is_ignored(int signal) {
    struct sigaction action {};
    return sigaction(signal, nullptr, &action) == 0 && action.sa_handler == SIG_IGN;
}

}  // namespace

StopOnSignals::StopOnSignals(std::stop_source source) {
    sigemptyset(&signals_);
    for (const int signal : {SIGINT, SIGTERM, SIGQUIT})
        sigaddset(&signals_, signal);
    if (!is_ignored(SIGHUP))
        sigaddset(&signals_, SIGHUP);
    sigset_t blocked = signals_;
    sigaddset(&blocked, SIGPIPE);
    pthread_sigmask(SIG_BLOCK, &blocked, nullptr);
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
