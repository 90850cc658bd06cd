// How far a run is, from its log alone (station/record/run_events.h). Watching costs the run
// nothing, and a server that was started again sees what the one before saw.
#pragma once

#include "compare/expect/expected_view.h"
#include "station/setup/station_file.h"

namespace etalon {

enum class RunPhase { preparing, measuring, analysing, ended };
const char* name(RunPhase phase);

struct WatchedPose {
    std::vector<double> target;  // mm or rad
    bool hold_out = false;
    bool visited = false, seen = false;
    std::string photo;                     // "frames/0007_0.png", the first whole one
    std::vector<Eigen::Vector2d> corners;  // means of its frames; empty: not seen
};

// What a log has told so far.
struct RunState {
    RunPhase phase = RunPhase::preparing;
    std::string outcome, reason;  // with RunPhase::ended
    std::string camera_serial;
    std::vector<InputFile> inputs;   // what the run was made from; empty before the first line
    std::vector<WatchedPose> poses;  // of the plan
    int latest_pose = -1;            // none yet
    int visited = 0, seen = 0;       // poses
    // Of one frame, pooled over the poses; nothing before a pose with two frames of the marker.
    std::optional<double> corner_noise_px;
    long rejected_frames = 0;  // that arrived broken and were taken again
    std::vector<std::string> remarks;
};

class RunMonitor {
public:
    explicit RunMonitor(std::filesystem::path record) : record_(std::move(record)) {}

    // Reads what was appended; true if any. Throws ConfigError for a log that no run wrote.
    bool look();

    const std::filesystem::path& record() const { return record_; }
    const RunState& state() const { return state_; }
    // Of motion and photographs; nothing before the plan is known.
    std::optional<double> seconds_left() const;

private:
    void take(const JsonEntry& line);
    void take_plan(const JsonEntry& line);
    void take_frame(const JsonEntry& line);
    void take_pose(const JsonEntry& line, double time_s);
    void pool_corner_noise(const std::vector<Eigen::Vector2d>& means);

    std::filesystem::path record_;
    std::uintmax_t read_bytes_ = 0;
    int line_ = 0;
    RunState state_;
    double expected_s_ = 0.0, measuring_since_s_ = 0.0, latest_s_ = 0.0;
    int visited_in_session_ = 0;
    std::vector<std::vector<Eigen::Vector2d>> frame_corners_;  // of the pose in flight
    std::string first_photo_;
    double square_sum_px2_ = 0.0;
    long freedoms_ = 0;
};

// A pose's photograph beside its render, as JPEG of at most 640 px width.
struct PosePictures {
    int pose = -1;
    std::string photo, render;  // JPEG; empty: there is none
    // Distance of the corners from the calibration's, at the best pose; only where it was seen.
    std::optional<double> reprojection_rms_px;
};

// Of a picture of any bit depth, brightest as it is.
std::string small_jpeg(const cv::Mat& gray_or_bgr);
cv::Mat eight_bits(const CodeImage& image);

// Of one run. Safe from every thread. Keeps the last pair, which is rendered once for all readers.
class PosePictureMaker {
public:
    // Reads the station from the record's copies. Throws ConfigError when they cannot be read.
    PosePictureMaker(const std::filesystem::path& record, const std::vector<InputFile>& inputs);

    // Some 30 ms of CPU time per megapixel for a new pose. Leaves out an unreadable photograph.
    std::shared_ptr<const PosePictures> of(int index, const WatchedPose& pose);

private:
    PosePictures made(int index, const WatchedPose& pose) const;

    std::filesystem::path record_;
    StationFile station_;
    Projector projector_;
    ExpectedView view_;
    std::mutex mutex_;
    std::shared_ptr<const PosePictures> last_;
};

}  // namespace etalon
