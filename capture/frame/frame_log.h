// A record's log, events.jsonl, written by station/record/run_events.h: its lines and frames.
#pragma once

#include <Eigen/Core>
#include <functional>

#include "core/config/json_entry.h"
#include "core/image/image.h"

namespace etalon {

// The log, in a record's folder. Whoever writes to the record holds a FolderLock on it.
inline constexpr const char* log_file = "events.jsonl";

struct LogLength {
    std::uintmax_t whole_bytes = 0;  // of the lines that have their end
    // Behind them: a line without its end (killed program, power cut: begins with zeros).
    std::uintmax_t broken_bytes = 0;
};

// Hands on every line that has its end, in their order. Throws ConfigError with file and line for
// one that is no JSON; what `take` throws passes through.
LogLength read_log(const std::filesystem::path& folder,
                   const std::function<void(const JsonEntry& line)>& take);

// One frame asked of the camera. Only complete ones have a file. Times: seconds of the record.
struct FrameRecord {
    std::string file;    // "frames/0007_1.png", in the record folder; empty unless complete
    std::string sha256;  // of that file, once it is written
    FrameStatus status = FrameStatus::timed_out;
    std::string status_detail;
    std::uint64_t device_id = 0;
    double exposure_start_s = 0.0;
    double exposure_start_uncertainty_s = 0.0;
    TimeSource time_source = TimeSource::request;
    std::uint64_t device_time_ns = 0;      // the device's own stamp; 0: none
    CaptureSettings settings;              // in force during the exposure
    std::vector<Eigen::Vector2d> corners;  // in the order of Marker::points_mm; empty: not seen
    std::string detection;                 // why there are no corners; empty when there are
};

// A frame as it goes into the log; times count from `start`.
FrameRecord frame_record(const Frame& frame, Instant start);

// Of a line whose event is "frame", but for what was detected in it. Throws ConfigError for a key
// that is missing, unknown, or of another type or range.
FrameRecord read_frame_record(const JsonEntry& line);
CaptureSettings read_settings(const JsonEntry& entry);

}  // namespace etalon
