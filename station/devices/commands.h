// `etalon devices`, `capture` and `stage ...`: station/shell/command.h.
#pragma once

#include "stage/profile/profile.h"
#include "station/setup/plan.h"

namespace etalon {

class Command;

struct DevicesArguments {
    bool json = false;
};
int run_devices(const DevicesArguments& arguments);

struct CaptureArguments {
    std::string camera;         // URI
    int frames = 0;             // 0: until Ctrl-C, with live
    std::filesystem::path out;  // folder of the record; empty with live: nothing is recorded
    bool live = false;
    CaptureSettings settings;  // without what follows
    std::optional<int> bits;   // default 8, or all that the format has
    double exposure_us = 0.0;
    std::vector<std::string> controls;  // "NAME=NUMBER"
    int retries = 5;
    CameraLink link;  // without what follows
    int frame_timeout_ms = 1000;
    bool drift = false;                // warm-up check: the following are for it alone
    std::string marker;                // the static target
    std::optional<double> minutes;     // at most; default 60, or as `frames` say
    std::optional<double> interval_s;  // between frames; default 1
    bool json = false;
};
int run_capture(const CaptureArguments& arguments);
int run_capture_drift(const CaptureArguments& arguments);  // with drift

// `etalon stage ...`: one structure for all of them.
struct StageArguments {
    std::filesystem::path station;
    std::string profile;               // check: built in, or a file.yaml
    std::vector<std::string> targets;  // move and jog: "x=12.5", mm or degrees
    double speed_percent = 100.0;      // of the axes' speeds
    int polls = 1;                     // trace
    bool yes = false;                  // home: do not ask
    bool homed = false;                // move and jog: the operator confirms it
    std::string operator_name;         // who moves it, for those who find it moved
    bool trace = false;                // print every exchange on stderr
    bool json = false;
};
int run_stage_status(const StageArguments& arguments);
int run_stage_home(const StageArguments& arguments);
int run_stage_move(const StageArguments& arguments);
int run_stage_jog(const StageArguments& arguments);
int run_stage_stop(const StageArguments& arguments);
int run_stage_trace(const StageArguments& arguments);

void declare_devices(Command& program);
void declare_init(Command& program);
void declare_capture(Command& program);
void declare_stage(Command& program);

// ---- the cameras that answer, as text in lines of at most 79 columns (or a single longer word)

struct ListedCamera {
    CameraIdentity identity;
    CameraAbilities abilities;
    std::string fault;  // why it has none: it is in use, or we may not open it
};

struct ListedBackend {
    CameraBackend backend;
    std::vector<ListedCamera> cameras;
};

std::string devices_table(const std::vector<ListedBackend>& backends,
                          const std::vector<std::string>& stage_profiles);

// ---- what `etalon stage` shows, in lines of at most 79 columns. Lengths in mm, angles in degrees.

// "x  12.3456 mm  enabled, homed, in position", a line per axis.
std::string stage_status_text(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                              const StageProfile& profile);

// "etalon: stage/1": every axis' position with its unit, and its state.
std::string stage_status_json(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                              const StageProfile& profile);

// The motions of a plan, pose by pose, with their times and what makes them slow; and their sum.
std::string stage_plan_text(std::span<const Axis> axes, const Plan& plan);
std::string stage_plan_json(std::span<const Axis> axes, const Plan& plan);

// What a profile describes, how well that is known, and what it cannot do.
std::string stage_profile_text(const StageProfile& profile);
std::string stage_profile_json(const StageProfile& profile);

// "x=12.5" for some of the axes, in mm or degrees: the position of every axis, those that are not
// named staying at `from`; with `relative` the numbers are added to it. Throws ConfigError.
std::vector<double> typed_target(std::span<const Axis> axes, const std::vector<std::string>& words,
                                 std::span<const double> from, bool relative);

// ---- the files that a new station begins with, with comments on what only its owner knows

struct StationTemplate {
    std::string camera = "genicam:127.0.0.1";  // URI
    std::string calibration = "camera.yml";    // as it shall stand in the file
    std::string stage = "127.0.0.1:502";       // HOST:PORT, or a serial line: "/dev/ttyUSB0"
    std::string profile = "generic";           // of the controller
    std::string marker = "apriltag:36h11:5@80mm";
    std::vector<std::string> axes = {"x", "y", "z", "rz"};  // the first is nearest to the base
};

// station.yaml. Throws ConfigError, naming the option, for a stage that is neither, for an axis
// that is none of x, y, z, rx, ry, rz or is doubled, and for text that YAML would take apart.
std::string drafted_station(const StationTemplate& draft);

// limits.yaml: the quantities that every station must judge.
std::string drafted_limits();

}  // namespace etalon
