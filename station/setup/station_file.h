// station.yaml (`etalon: station/1`): everything that a qualification run is told. Keys, units and
// values when left out: docs/files.md. Strictly read; relative paths are relative to the file.
#pragma once

#include "capture/frame/camera.h"
#include "compare/qualification/qualification.h"
#include "stage/motion/motion_guard.h"
#include "station/setup/environment.h"

namespace etalon {

struct ExpectedScene;

// A file that the run was made from, by content.
struct InputFile {
    std::string role;  // "station", "calibration", "limits", ...
    std::filesystem::path path;
    std::string sha256;
    std::string copy;  // in a record: "inputs/camera.yml", seen from its folder
};

struct StationCamera {
    std::string uri;
    CameraModel model;         // the calibration under test
    CaptureSettings settings;  // width, height and bits are the calibration's
    CameraLink link;
    int retries = 5;  // of a bad frame
};

struct StationStage {
    StageLink link;
    std::string profile;  // built in, or a path
    std::vector<Axis> axes;
    MotionRules rules;  // of these axes
};

struct PlanRequest {
    struct Interval {
        double low = 0.0, high = 0.0;
    };
    std::vector<Interval> volume;  // one per axis, in the axes' order, mm or rad
    int poses = 0;                 // training and hold-out together
    double hold_out = 0.0;         // share of them, 0 < hold_out < 1
    int repeats = 0;               // hold-out poses that are visited a second time at the end
    int frames = 1;                // per pose
    std::uint64_t seed = 0;
    std::chrono::milliseconds settle{0};  // after the stage reports the move done
    SourcePlace place;                    // of `plan.volume`, for errors
};

// The certificate of something that a station measures with: `references` in station.yaml,
// docs/certificate.md. Nothing corrects for the deviation that it found; U is at k = 2.
struct TracedReference {
    std::string name;  // "stage scale x", "marker print size", "marker flatness", "thermometer"
    double value = 0.0, expanded_uncertainty = 0.0;  // in `unit`
    std::string unit;                                // "ppm", "um", "K"
    std::string certificate, laboratory;             // its number, and who issued it
    std::string date, due;                           // "2026-01-12"; in force on both

    double standard_uncertainty() const;  // sqrt(value^2 + (U/2)^2)
    bool in_force_on(const std::string& day) const { return date <= day && day <= due; }
};

// Of this name; null where there is none.
const TracedReference* reference_named(const std::vector<TracedReference>& references,
                                       const std::string& name);

struct StationFile {
    std::string id;
    StationCamera camera;
    StationStage stage;
    Marker marker;
    // carriage_from_marker as drawn: the prior for directions that no motion of this stage shows.
    Rigid carriage_from_marker_nominal;
    // camera_from_base as drawn; nothing: unknown. For what is foretold before anything moves
    // (which poses the camera sees, what the plan will tell); a run measures it.
    std::optional<Rigid> camera_from_base_nominal;
    // Relative standard uncertainty of the printed marker's size; nothing: unknown.
    std::optional<double> marker_size_uncertainty;
    // Standard uncertainty of how far its edge stands out of its plane; nothing: unknown.
    std::optional<double> marker_flatness_mm;
    std::optional<DeclaredTemperature> temperature;  // nothing: unknown
    std::optional<StationEnvironment> environment;   // nothing: not looked at
    std::vector<TracedReference> references;         // those that there are
    double background = 1.0;                         // radiance around the marker, whose white is 1
    double white_level = 1.0;  // of the marker's white in the photographs; 1 = full scale
    PlanRequest plan;
    std::string detector;
    Limits limits;
    std::vector<InputFile> inputs;  // station, calibration, limits, and what these name
};

// Reads the file and the calibration that it names, or this one in its place; checks that the
// detector can see the marker, that the calibration has what the run needs, and that the volume
// fits the axes' soft limits. Touches no device. Throws ConfigError with file, line and key.
StationFile read_station(const std::filesystem::path& path,
                         const std::filesystem::path& calibration = {});

// What the station's camera should see (compare/expect/expected_view.h).
ExpectedScene expected_scene(const StationFile& station);

// A remark on what the station declares with an uncertainty of 0, by name; empty without any.
std::string exact_knowledge(const StationFile& station);

// The stage's section alone: stopping the axes must not depend on the rest of the file.
StationStage read_station_stage(const std::filesystem::path& path);

// The files that a station was read from, and their copies in a record. Copies lie under inputs/ as
// the originals lay under their nearest common folder, so that relative paths lead to the copy. Of
// a file that is named with its absolute path, but the calibration, reading back opens the
// original: it must still be the same.

// Copies the inputs, sets their `copy`. Throws ConfigError, also for what was changed since.
void copy_inputs(std::vector<InputFile>& inputs, const std::filesystem::path& record);

// The station from these copies, with the inputs as given. Throws ConfigError for a copy outside of
// inputs/, one that is missing or not the recorded bytes, and what read_station() throws.
StationFile read_recorded_station(const std::filesystem::path& record,
                                  const std::vector<InputFile>& inputs);

// Throws ConfigError with the first file that is not the same in both.
void require_same_inputs(const std::vector<InputFile>& recorded,
                         const std::vector<InputFile>& given);

}  // namespace etalon
