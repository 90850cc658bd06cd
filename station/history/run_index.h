// The runs below a folder in an SQLite file beside them: what history takes of each, so that
// thousands are listed without reading their run.json. It is made from the records alone, brought
// up to date by their sizes and times of change, and can be deleted at any time.
#pragma once

#include <memory>

#include "station/history/run_history.h"

struct sqlite3;

namespace etalon {

inline constexpr const char* run_index_file = ".etalon-index.sqlite";

struct IndexUpdate {
    int runs = 0, read = 0, gone = 0;  // in the index now; re-read; left out as they are gone
    std::vector<std::string> refused;  // why a run.json was not taken, one line each
};

// Empty: all.
struct RunFilter {
    std::string camera, station, outcome;
    bool unfinished = false;  // only those that can be resumed: ERROR and ABORTED
    int at_most = 100000;     // the latest ones
};

class RunIndex {
public:
    // Opens the file in `folder`, or makes it again if damaged or old. Throws ConfigError.
    explicit RunIndex(std::filesystem::path folder);
    ~RunIndex();
    RunIndex(const RunIndex&) = delete;
    RunIndex& operator=(const RunIndex&) = delete;

    // Reads the records that have changed. About 20 us for one that has not.
    IndexUpdate update();

    // In the order of their start. Throws ConfigError when the file cannot be read any more.
    std::vector<HistoricRun> runs(const RunFilter& filter = {}) const;

private:
    void open();
    void take(const std::filesystem::path& record, const std::string& stamp);

    std::filesystem::path folder_;
    sqlite3* database_ = nullptr;
};

}  // namespace etalon
