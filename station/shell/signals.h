// Ctrl-C, Ctrl-\, kill and a terminal that is closed, turned into a stop request. One thread takes
// the signals: files and devices are left in order by the normal unwinding, axes standing still.
#pragma once

#include <atomic>
#include <csignal>
#include <stop_token>
#include <thread>

namespace etalon {

// While it lives, SIGINT, SIGTERM, SIGQUIT and SIGHUP request a stop of `source` instead of ending
// the process; a second Ctrl-C cannot skip stopping the axes. SIGHUP is left alone where the parent
// ignores it (nohup). SIGPIPE is blocked, too: a reader of stdout that goes away is a write error.
// Construct it before any other thread is started: threads inherit the blocked signals, which stay
// blocked afterwards. One per process.
class StopOnSignals {
public:
    explicit StopOnSignals(std::stop_source source);
    ~StopOnSignals();
    StopOnSignals(const StopOnSignals&) = delete;
    StopOnSignals& operator=(const StopOnSignals&) = delete;

private:
    void wait(std::stop_source source);

    sigset_t signals_{};  // those that request a stop
    std::atomic<bool> ending_ = false;
    std::thread thread_;
};

}  // namespace etalon
