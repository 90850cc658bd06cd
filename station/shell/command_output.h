// What commands print alike: the line that names a report, and progress on stderr.
#pragma once

#include <filesystem>
#include <mutex>

#include "core/time/progress.h"

namespace etalon {

// "report FOLDER/report.html" on stdout; nothing without a folder.
void print_report(const std::filesystem::path& folder);

// Progress on stderr, drawn anew where that is a terminal.
class StderrProgress : public Progress {
public:
    StderrProgress();

    // step() from every thread.
    void count();

private:
    std::mutex mutex_;
};

}  // namespace etalon
