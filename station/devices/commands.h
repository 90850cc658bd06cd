// `etalon devices`, `capture` and `stage ...`. What each is asked, and the function that carries it
// out: it returns the exit code or throws (core/program/errors.h), prints its stable words and
// --json on stdout and everything else on stderr.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

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
    std::string format;       // the device's name; empty: monochrome
    std::optional<int> bits;  // default 8, or all that the format has
    int width = 0, height = 0;
    double exposure_us = 0.0, gain_db = 0.0;
    std::optional<double> black_level;
    std::string trigger;
    std::vector<std::string> controls;  // "NAME=NUMBER"
    int retries = 5;
    int frame_timeout_ms = 1000, packet_size = 1400;
    std::string interface;
    bool drift = false;                // warm-up check: the following are for it alone
    std::string marker;                // the static target
    std::optional<double> minutes;     // at most; default 60, or as `frames` say
    std::optional<double> interval_s;  // between frames; default 1
    bool json = false;
};
int run_capture(const CaptureArguments& arguments);
int run_capture_drift(const CaptureArguments& arguments);  // with drift

// `etalon stage ...`: one structure for all of them but `check`.
struct StageArguments {
    std::filesystem::path station;
    std::vector<std::string> targets;  // move and jog: "x=12.5", mm or degrees
    double speed_percent = 100.0;      // of the axes' speeds
    int polls = 1;                     // trace
    bool yes = false;                  // home: do not ask
    bool homed = false;                // move and jog: the operator's word
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
int run_stage_plan(const StageArguments& arguments);

struct StageCheckArguments {
    std::string profile;  // built in, or a file.yaml
    bool json = false;
};
int run_stage_check(const StageCheckArguments& arguments);

void declare_devices(Command& program);
void declare_init(Command& program);
void declare_capture(Command& program);
void declare_stage(Command& program);

}  // namespace etalon
