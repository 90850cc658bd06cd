// What commands do alike with what they make: the folder of --out, the line that names its report,
// and progress on stderr.
#pragma once

#include <filesystem>
#include <mutex>

#include "core/time/progress.h"

namespace etalon {

// Makes the folder where it is missing. Throws ConfigError at --out when it cannot be made.
void make_out_folder(const std::filesystem::path& folder);

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
