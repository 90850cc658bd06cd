// The program's commands: what each is asked, and the function that carries it out. Only main.cpp
// knows the command line; the functions return the exit code or throw (core/errors.h).
//
// Each prints its stable words and --json on stdout and everything else on stderr.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace etalon {

struct MarkerArguments {
    std::string marker;         // "apriltag:36h11:5@50mm"
    std::filesystem::path out;  // .svg, .pdf or .png
    double dots_per_mm = 40.0;  // of a PNG
    bool json = false;
};
int run_marker(const MarkerArguments& arguments);

// One image, or with a pose file an image set: out is then a folder.
struct RenderArguments {
    std::filesystem::path camera, out;
    std::vector<std::string> markers;
    std::vector<std::string> poses;  // "rx,ry,rz,tx,ty,tz", one a marker
    std::filesystem::path
        pose_file;                 // a set: camera_from_scene by image, `poses` place the markers
    std::string background = "1";  // a radiance, or an image file
    std::string method = "auto";   // auto, E, C or reference
    double tolerance_gray = 0.1;
    double exposure = 1.0;                    // factor on the radiance before the sensor
    std::string velocity;                     // "wx,wy,wz,vx,vy,vz", rad/s and mm/s; empty: still
    double shutter_ms = 0.0;                  // how long it moves
    bool linear = false;                      // 32-bit TIFF of radiance
    std::optional<std::uint64_t> noise_seed;  // shot and read noise of the camera's sensor
    bool explain = false;                     // print the plan
    bool json = false;
};
int run_render(const RenderArguments& arguments);
int run_render_set(const RenderArguments& arguments);  // with a pose file

struct BenchArguments {
    std::vector<std::string> scenes;  // by name (bench/benchmark_scenes.h); none: all eight
    std::filesystem::path out;        // folder for bench.csv, table.md, bench.svg, bench.json
    std::optional<int> poses;         // of the cloud: 200, quick 5; 0: no cloud
    std::optional<int> throughput;    // frames: 10000, quick 40; 0: none
    int reference_samples = 0;        // in each of 16 scrambles; 0: the plan's own
    bool quick = false;               // few settings and samples: a trial of the command
    bool check = false;               // exit code 1 when a promised figure is missed
    bool json = false;
};
int run_bench(const BenchArguments& arguments);

// Exit code 1 when a case fails.
struct StabilityArguments {
    bool json = false;
};
int run_stability(const StabilityArguments& arguments);

// Either a target or, in short for a chessboard, board and square_mm.
struct CalibrateArguments {
    std::string target;  // "chessboard:9x6@25mm"
    std::string board;   // "9x6"
    double square_mm = 0.0;
    std::vector<std::filesystem::path> photos;
    std::string model = "auto";        // or the name of a calibration model
    std::string refine;                // empty or "photometric"
    std::filesystem::path out;         // camera.yml
    std::filesystem::path opencv_out;  // optional: the same as OpenCV YAML
    std::filesystem::path report;      // optional: folder
    bool json = false;
};
int run_calibrate(const CalibrateArguments& arguments);

// What is not given is not measured. Exit code 2 when photographs were given that cannot be used.
struct CharacteriseArguments {
    std::filesystem::path camera;
    std::string target;                                        // "chessboard:9x6@25mm"
    std::vector<std::filesystem::path> photos;                 // the target in several places
    std::vector<std::filesystem::path> repeats, flats, darks;  // one view; uniform field; no light
    std::filesystem::path exposures;                           // CSV file,exposure_us
    std::filesystem::path out;                                 // camera.yml
    std::filesystem::path report;                              // folder; empty: none
    bool json = false;
};
int run_characterise(const CharacteriseArguments& arguments);

struct DetectArguments {
    std::string marker;
    std::filesystem::path camera;
    std::vector<std::filesystem::path> photos;
    std::string detector = "auto";
    std::filesystem::path poses;  // starts for the photometric detector; empty: another detector's
    bool json = false;
};
int run_detect(const DetectArguments& arguments);
int run_photometric_detect(const DetectArguments& arguments);

struct CompareArguments {
    std::filesystem::path camera, out;
    std::string board;  // "9x6" with square_mm, or a marker
    double square_mm = 0.0;
    std::string marker;
    std::string detector = "auto";
    std::filesystem::path poses;     // optional pose file, one row per photo
    std::string score_margin;        // "X,Y" in squares
    std::filesystem::path baseline;  // optional folder of an earlier comparison
    std::vector<std::filesystem::path> photos;
    bool json = false;
};
int run_compare(const CompareArguments& arguments);

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

struct QualifyArguments {
    std::filesystem::path station, out;
    std::filesystem::path resume;  // in place of out: the record to go on with
    bool json = false;
};
int run_qualify(const QualifyArguments& arguments);

struct ReportArguments {
    std::filesystem::path record;
    bool json = false;
};
int run_report(const ReportArguments& arguments);

// Exit code 1 when a quantity drifts.
struct HistoryArguments {
    std::vector<std::filesystem::path> records;
    std::filesystem::path out;  // folder of the report; empty: none
    bool json = false;
};
int run_history(const HistoryArguments& arguments);

struct PlanArguments {
    std::filesystem::path station;
    bool json = false;
};
int run_plan(const PlanArguments& arguments);

struct OcArguments {
    std::filesystem::path station, out;  // out: folder for curves and JSON; empty: none
    int runs = 2000;                     // per point
    std::vector<std::string> errors;     // only these; none: all
    bool json = false;
};
int run_oc(const OcArguments& arguments);

// Either a record, or a station with positions.
struct RegisterArguments {
    std::filesystem::path record;              // folder of a qualification
    std::filesystem::path station, positions;  // positions: CSV of photographs and axis positions
    std::string detector;                      // empty: the station's own
    bool json = false;
};
int run_register(const RegisterArguments& arguments);

struct ExpectArguments {
    std::filesystem::path camera, out;  // out: folder; empty: no report
    std::string marker;
    std::string volume;  // "NEAR:FAR", depths in mm
    double max_tilt_deg = 45.0;
    std::string detector = "auto";
    int poses = 200, frames = 8;
    std::uint64_t seed = 1;
    double background = 1.0, white_level = 0.8;
    bool json = false;
};
int run_expect(const ExpectArguments& arguments);

// Needs no device. Exit code 130 when it was interrupted: the same command goes on.
struct StudyArguments {
    std::filesystem::path study, out;
    std::string ablate;  // "tone,noise": variants of the study (study/study_switches.h)
    std::string shard;   // "2/5"; empty: all of it
    bool json = false;
};
int run_study_command(const StudyArguments& arguments);

struct StudyMergeArguments {
    std::vector<std::filesystem::path> shards;
    std::filesystem::path out;
    bool json = false;
};
int run_study_merge(const StudyMergeArguments& arguments);

// `etalon stage ...`: one structure for all of them but `check`.
struct StageArguments {
    std::filesystem::path station;
    std::vector<std::string> targets;  // move and jog: "x=12.5", mm or degrees
    double speed_percent = 100.0;      // of the axes' speeds
    int polls = 1;                     // trace
    bool yes = false;                  // home: do not ask
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

// `etalon camera show|convert|check`.
struct CameraFileArguments {
    std::filesystem::path file, out;  // out: convert
    std::string select;               // which of several cameras; empty: the only one
    std::string to;                   // convert: etalon or a tool's name
    bool json = false;
};
int run_camera_show(const CameraFileArguments& arguments);
int run_camera_convert(const CameraFileArguments& arguments);
int run_camera_check(const CameraFileArguments& arguments);

}  // namespace etalon
