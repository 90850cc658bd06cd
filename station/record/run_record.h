// The record of a run: a folder that tells, years later, what was measured, with what, and how.
//
//     inputs/        copies of the files that the station was read from
//     events.jsonl   the log: one JSON object per line, appended and flushed as things happen
//                    (station/record/run_events.h)
//     frames/        raw frames, 8 or 16 bit PNG: NNNN_F.png, pose NNNN from 0, frame F from 0
//
// and what follows from these (station/qualify/recorded_run.h):
//
//     run.json         what was asked and what came out; `etalon: run/1`
//     poses.csv        one row per visited pose
//     convergence.csv  one row per round of the registration
//     junit.xml        one test case per judged quantity, for CI
//     renders/         hold-out poses as the calibration says they should look: NNNN.png
//     report.html      (station/qualify/run_analysis.h)
//
// A crash at any moment, of the program or of the machine, loses at most the pose in flight: its
// frames are on the disk before the log tells of it, and the log is before the next pose begins.
// run.json has the outcome ERROR from the start and is replaced at the end. `etalon report` writes
// again what a power cut tore.
#pragma once

#include <deque>
#include <future>

#include "core/file/file_writing.h"
#include "station/record/qualify_result.h"

namespace etalon {

// Writes images on other threads; write() waits for a place. One user thread. Its end flushes.
class ImageWriter {
public:
    // The image's pixels must not change afterwards. Throws what writing an earlier one threw.
    void write(const std::filesystem::path& path, const CodeImage& image);

    // Returns when all are written. Throws what writing threw.
    void flush();

private:
    static constexpr std::size_t most = 8;
    std::deque<std::future<void>> jobs_;
};

// Throws ConfigError unless a record could go there: nothing is there, or an empty folder.
void require_new_folder(const std::filesystem::path& folder);

// Now, "2026-03-07T14:05:09Z".
std::string utc_now();

// In seconds since 1970; nothing for what is no such time.
std::optional<double> utc_seconds(const std::string& utc);

// Makes the missing parts of a folder, with its parents. Throws ConfigError.
void make_record_folders(const std::filesystem::path& folder,
                         std::initializer_list<const char*> parts);

class RunRecord {
public:
    // Makes the folder with its parents and these parts. Throws ConfigError as above.
    explicit RunRecord(const std::filesystem::path& folder,
                       std::initializer_list<const char*> parts = {"frames", "renders"});

    // Resumes a record: cuts its log after `whole_bytes`. Throws ConfigError.
    RunRecord(const std::filesystem::path& folder, std::uintmax_t whole_bytes);

    const std::filesystem::path& folder() const { return folder_; }
    ImageWriter& images() { return images_; }

    // A line of station/record/run_events.h. Flushed before it returns.
    void log(const std::string& line);
    // The pose with its frames, when these are on the disk; sets the hashes of their files. On the
    // disk before it returns, with all that was logged before.
    void log_pose(VisitedPose& pose, const CaptureStatistics& counts);

    // Replace run.json and poses.csv by what is known now.
    void write(const QualifyResult& result);

private:
    std::filesystem::path folder_;
    AppendFile events_;
    ImageWriter images_;
};

// Which program this is, to the bit: its own file, the libraries that it was loaded with and what
// the processor can do, as code is chosen by it. The same fingerprint computes the same from the
// same input. 64 hexadecimal digits. Some 15 ms the first time, then none. Throws ConfigError where
// the program's own file cannot be read. Safe from every thread.
const std::string& program_fingerprint();

}  // namespace etalon
