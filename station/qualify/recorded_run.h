// A run read back from its record: from the log, the frames and the copies of its inputs. What the
// frames' pixels gave is taken from the record only where it is this program's
// (station/qualify/image_result_cache.h).
//
// A record is hostile until checked: every file by its SHA-256, every line of the log by its keys,
// types and ranges, each pose against the plan. What a killed program leaves behind is no error: a
// last line without its end and frames without their pose are dropped, and it is said.
#pragma once

#include "core/time/progress.h"
#include "station/record/qualify_result.h"

namespace etalon {

struct RecordedRun {
    // As measured, `software` this build's; ERROR with its reason when the program was killed.
    QualifyResult result;
    double end_s = 0.0;                // latest time in the log
    std::uintmax_t whole_bytes = 0;    // of the log, without an unfinished last line
    std::vector<std::string> dropped;  // what was left out, one sentence each

    bool is_measured() const { return result.poses.size() == result.plan.poses.size(); }
};

// What a crash leaves behind as the reason of an ERROR.
inline constexpr const char* unfinished_run = "the run did not finish";

// Detects the corners again. Throws ConfigError with file, line and key for what no run wrote;
// Interrupted on a stop request. Reads every frame twice, or once where corners were kept.
RecordedRun read_record(const std::filesystem::path& folder, Progress& progress,
                        const std::stop_token& stop);

// Analyses a whole record again and replaces its results (station/record/run_record.h): the same
// bytes on the same build. Of a run that did not visit all of its plan only the report is written
// again. Throws as analyse_run() but for NumericalError, which becomes the outcome as in a run.
QualifyResult analyse_record(RecordedRun recorded, Progress& progress, const std::stop_token& stop);

}  // namespace etalon
