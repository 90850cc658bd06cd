// Everything that a qualification run produced, as plain data: what run.json, poses.csv and
// report.html are written from. Times are seconds since the run began, on the station's clock.
#pragma once

#include "report/software_versions.h"
#include "station/setup/plan.h"

namespace etalon {

// Time across programs: how long the machine has been on, suspended or not. The monotonic clock
// stands still while it is suspended, and the system's clock may be set.
struct BootTime {
    std::string boot;      // since which start of the machine; empty: not known
    double seconds = 0.0;  // that it was on
};

BootTime boot_time();  // now

// Nothing where the machine was started again between the two, or that is not known.
std::optional<double> seconds_between(const BootTime& from, const BootTime& to);

enum class RunOutcome { pass, fail, inconclusive, error, aborted };
const char* name(RunOutcome outcome);  // "PASS", "FAIL", "INCONCLUSIVE", "ERROR", "ABORTED"

bool is_verdict(RunOutcome outcome);  // the first three

std::optional<RunOutcome> run_outcome_named(const std::string& name);

// 0, 1, 2, 4 and 130.
int exit_code(RunOutcome outcome);

// From one start of the program to its end. A run that was resumed has several.
struct RunSession {
    std::string started_utc;    // "2026-03-07T14:05:09Z", as the system's clock was set
    BootTime started;           // what the time from one session to the next is taken from
    double start_s = 0.0;       // on the run's time: the first one's is 0
    std::string version;        // of the program that measured
    std::string operator_name;  // who began it; empty: not told
    int poses = 0;              // that it visited
    CaptureStatistics counters;
};

// The camera's counters by their names in a record.
struct CounterField {
    const char* name;
    long CaptureStatistics::*count;
};
inline constexpr CounterField counter_fields[] = {
    {"frames_delivered", &CaptureStatistics::delivered},
    {"frames_rejected", &CaptureStatistics::rejected},
    {"frames_skipped", &CaptureStatistics::skipped},
    {"missing_packets", &CaptureStatistics::missing_packets},
    {"resent_packets", &CaptureStatistics::resent_packets},
    {"underruns", &CaptureStatistics::underruns},
    {"reconnects", &CaptureStatistics::reconnects}};

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
    std::vector<std::string> remarks;  // what limited the devices here, one line each
    std::vector<RunSession> sessions;  // at least one; `started_utc` is the first one's
    std::vector<AnalysedPose> poses;   // visited ones only
    RunEnvironment environment;
    // Nothing when the run ended before; the poses are judged when it is there.
    std::optional<Qualification> analysis;
    RunOutcome outcome = RunOutcome::error;
    std::string reason;  // of an ERROR or ABORTED run, one line; empty otherwise
    std::vector<SoftwareVersion> software;
    std::filesystem::path folder;         // of the record
    std::vector<Attachment> attachments;  // when all other files of the record are written

    // Of the whole run: the sessions' counters, of one that was killed those after its last pose.
    CaptureStatistics statistics() const;
};

// Mean RMS residual of the hold-out poses, gray (full scale 255); nothing when none was compared.
std::optional<double> mean_residual_gray(const QualifyResult& result);

// The pose's first whole photograph; null when there is none.
const FrameRecord* first_whole(const VisitedPose& pose);

// Throws ConfigError when the frame's file cannot be read or is not the bytes that were taken.
void require_recorded(const QualifyResult& result, const FrameRecord& frame);

// A whole photograph of the record, with the camera's bits. Throws ConfigError when it cannot be
// read, is not the bytes that were taken, or has another size than the calibration.
CodeImage recorded_photo(const QualifyResult& result, const FrameRecord& frame);

}  // namespace etalon
