#include "python/interruptible.h"

#include <exception>
#include <future>
#include <thread>

namespace etalon {
namespace {

// How long a Ctrl-C waits to be seen.
constexpr std::chrono::milliseconds poll{50};

// Null while no signal handler of Python's has raised anything.
std::exception_ptr raised_meanwhile() {
    const pybind11::gil_scoped_acquire held;
    if (PyErr_CheckSignals() == 0)
        return nullptr;
    return std::make_exception_ptr(pybind11::error_already_set());
}

}  // namespace

void run_interruptibly(const std::function<void(std::stop_token)>& work) {
    std::exception_ptr raised;
    std::future<void> done;
    {
        const pybind11::gil_scoped_release released;
        std::stop_source stop;
        std::packaged_task<void()> task([&] { work(stop.get_token()); });
        done = task.get_future();
        const std::jthread worker(std::move(task));
        while (done.wait_for(poll) != std::future_status::ready)
            if (!raised && (raised = raised_meanwhile()))
                stop.request_stop();
    }
    if (raised)
        std::rethrow_exception(raised);
    done.get();
}

}  // namespace etalon
