// The record of a run: a folder that tells, years later, what was measured, with what, and how.
//
//     run.json       what was asked and what came out; `etalon: run/1`
//     poses.csv      one row per visited pose
//     events.jsonl   the log: one JSON object per line, appended and flushed as things happen
//     frames/        raw frames, 8 or 16 bit PNG: NNNN_F.png, pose NNNN from 0, frame F from 0
//     renders/       hold-out poses as the calibration says they should look: NNNN.png
//     report.html    (station/qualify_report.h)
//
// A crash at any moment loses at most the pose in flight: run.json is there from the start with the
// outcome ERROR and is replaced at the end; a pose is logged when its frames are written. (Against
// a crash of the machine itself nothing is promised: files are not synced to the disk.)
#pragma once

#include <filesystem>
#include <fstream>
#include <string>

#include "station/image_writer.h"
#include "station/qualify_result.h"

namespace etalon {

// Throws ConfigError unless a record could go there: nothing is there, or an empty folder.
void require_new_folder(const std::filesystem::path& folder);

// Now, "2026-03-07T14:05:09Z".
std::string utc_now();

// A frame as it goes into the log; times count from `start`.
FrameRecord frame_record(const Frame& frame, Instant start);

class RunRecord {
public:
    // Makes the folder with its parents and these parts. Throws ConfigError as above, or when one
    // cannot be made.
    explicit RunRecord(const std::filesystem::path& folder,
                       std::initializer_list<const char*> parts = {"frames", "renders"});

    const std::filesystem::path& folder() const { return folder_; }
    ImageWriter& images() { return images_; }

    // One line of the log; seconds since the run began. Flushed before it returns.
    void log_state(double time_s, const std::string& state, const std::string& detail);
    void log_frame(int pose, const FrameRecord& frame);
    // Waits for the pose's frames to be written first.
    void log_pose(const PoseRecord& pose);

    // Replace run.json and poses.csv by what is known now.
    void write(const QualifyResult& result);

private:
    void append(const std::string& line);

    std::filesystem::path folder_;
    std::ofstream events_;
    ImageWriter images_;
};

}  // namespace etalon
