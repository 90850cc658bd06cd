#include "station/shell/command_output.h"

#include <fmt/format.h>
#include <unistd.h>

#include "core/program/errors.h"

namespace etalon {
namespace {

const SteadyClock steady_clock;

}  // namespace

void print_report(const std::filesystem::path& folder) {
    if (!folder.empty())
        fmt::print("report {}\n", (folder / "report.html").string());
}

StderrProgress::StderrProgress() : Progress(stderr, isatty(STDERR_FILENO) != 0, steady_clock) {}

void StderrProgress::count() {
    const std::lock_guard lock(mutex_);
    step();
}

}  // namespace etalon
