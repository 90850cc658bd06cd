// Long calls from Python, on a thread of their own without the GIL. Ctrl-C requests a stop: axes
// are stopped and files closed before the KeyboardInterrupt goes on.
#pragma once

#include <pybind11/pybind11.h>

#include <functional>
#include <memory>
#include <utility>

#include "core/time/progress.h"

namespace etalon {

// Does `work` and returns when it has ended, whatever happened; call with the GIL. Throws what it
// threw, and KeyboardInterrupt (or what a signal handler of Python raised) if that came meanwhile.
// Signals are Python's affair: they are seen where the caller is its main thread.
void run_interruptibly(const std::function<void(std::stop_token)>& work);

// The same of work that returns something.
template <class Work>
auto interruptible(Work&& work) {
    std::optional<decltype(work(std::stop_token()))> result;
    run_interruptibly([&](std::stop_token stop) { result.emplace(work(std::move(stop))); });
    return std::move(*result);
}

// For work of less than 0.1 s, or that cannot be stopped: without the GIL, on this thread.
template <class Work>
auto without_gil(Work&& work) {
    const pybind11::gil_scoped_release released;
    return std::forward<Work>(work)();
}

// How far a run is, where its caller wants to see it.

// To stderr, or to nobody.
class RunProgress {
public:
    explicit RunProgress(bool is_shown)
        : nobody_(is_shown ? nullptr : std::fopen("/dev/null", "w")),
          progress_(nobody_ ? nobody_.get() : stderr, false, clock_) {}

    Clock& clock() { return clock_; }
    Progress& progress() { return progress_; }

private:
    struct Close {
        void operator()(std::FILE* file) const { std::fclose(file); }
    };
    SteadyClock clock_;
    std::unique_ptr<std::FILE, Close> nobody_;
    Progress progress_;
};

}  // namespace etalon
