// Everything that a qualification run produced, as plain data: what run.json, poses.csv and
// report.html are written from. Times are seconds since the run began, on the station's clock.
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "capture/frame/camera.h"
#include "compare/photometric/pixel_difference.h"
#include "compare/verdict/qualification.h"
#include "report/software_versions.h"
#include "stage/axes/kinematics.h"
#include "station/setup/plan.h"
#include "station/setup/station_file.h"

namespace etalon {

// One frame that was asked of the camera. Only complete frames have a file and can have corners.
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

// One pose of the plan that was visited, in the order of the run.
struct PoseRecord {
    int index = 0;  // 0-based, names the frames
    PlannedPose planned;
    // One after settling and one after each frame; of each axis, mm or rad.
    std::vector<std::vector<double>> readings;
    // Per axis, mm or rad: mean of the n readings, their
    // standard deviation s, and the standard uncertainty of the mean: s, but no less than the
    // axis' declared noise, over sqrt(n).
    std::vector<double> read_back, read_back_deviation, read_back_uncertainty;
    StagePose stage;  // of the mean
    // Side from which each axis came: +1 upwards, -1 downwards, 0 did not move.
    std::vector<int> approach;
    double move_start_s = 0.0, settled_s = 0.0, done_s = 0.0;
    std::vector<FrameRecord> frames;
    std::vector<Eigen::Vector2d> corners;  // mean over the frames that saw it; empty: none did
    int detections = 0;                    // number of such frames
    CaptureStatistics counters;            // of the camera's session, when the pose was done

    // After a successful analysis, of hold-out poses: the render at the registered pose, with the
    // camera's bit depth and transfer and without noise ("renders/0007.png").
    std::string render_file;

    // Photograph (its first complete frame) minus that render, after a photometric model is fitted;
    // of hold-out poses after the analysis. Scored on the cells that were not fitted.
    struct Residual {
        PhotometricModel model;
        ResidualStatistics scored;
    };
    std::optional<Residual> residual;
};

enum class RunOutcome { pass, fail, inconclusive, error, aborted };
const char* name(RunOutcome outcome);  // "PASS", "FAIL", "INCONCLUSIVE", "ERROR", "ABORTED"

// 0, 1, 2, 4 and 130.
int exit_code(RunOutcome outcome);

// From one start of the program to its end. A run that was resumed has several.
struct RunSession {
    std::string started_utc;  // "2026-03-07T14:05:09Z"
    double start_s = 0.0;     // on the run's time: the first one's is 0
    std::string version;      // of the program that measured
    int poses = 0;            // that it visited
    CaptureStatistics counters;
};

// Sum over the sessions. Of one that was killed, the counters are those after its last pose.
CaptureStatistics total_counters(const std::vector<RunSession>& sessions);

// A file of the record, by content; the path is in the record's folder.
struct Attachment {
    std::string path, sha256;
};

struct QualifyResult {
    StationFile station;
    Plan plan;
    std::string started_utc;  // "2026-03-07T14:05:09Z"
    double duration_s = 0.0;
    CameraIdentity camera;             // as the device says
    CaptureSettings settings;          // in force
    CaptureStatistics statistics;      // of the whole run
    std::vector<std::string> remarks;  // what limited the devices here, one line each
    std::vector<RunSession> sessions;  // at least one; `started_utc` is the first one's
    std::vector<PoseRecord> poses;     // visited ones only
    // Nothing when the run ended before; analysis->poses[i] belongs to poses[i].
    std::optional<Qualification> analysis;
    RunOutcome outcome = RunOutcome::error;
    std::string reason;  // of an ERROR or ABORTED run, one line; empty otherwise
    std::vector<SoftwareVersion> software;
    std::filesystem::path folder;         // of the record
    std::vector<Attachment> attachments;  // when all other files of the record are written
};

// Mean over the hold-out poses of the RMS of photograph minus render, in gray = code value / full
// scale * 255; nothing when none was compared.
std::optional<double> mean_residual_gray(const QualifyResult& result);

// The pose's first whole photograph, read from the record, with the camera's bits: a file is 8 or
// 16 bit, whatever the camera has. Throws ConfigError when there is none or it cannot be read.
CodeImage recorded_photo(const QualifyResult& result, const PoseRecord& pose);

}  // namespace etalon
