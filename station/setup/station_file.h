// station.yaml (`etalon: station/1`): everything that a qualification run is told. Strictly read;
// relative paths are relative to the file.
//
//     etalon: station/1
//     id: demo                                  # names the station in records
//     camera: {uri: "genicam:127.0.0.1", calibration: camera.yml, exposure_us: 2000, gain_db: 0,
//              packet_size: 1400, frame_timeout_ms: 1000, retries: 5}
//     stage: {link: {host: 127.0.0.1, port: 1502, unit: 1, response_timeout_ms: 300},
//             profile: generic, axes: [...]}    # axes: stage/axes/axes.h
//     (a serial line: link: {device: /dev/ttyUSB0, baud: 38400, parity: none, data_bits: 8,
//      stop_bits: 1, unit: 1, response_timeout_ms: 300, quiet_ms: 250}, stage/link/stage_link.h)
//     (in stage, optional: forbidden boxes and slow zones, stage/motion/motion_guard.h)
//     marker: "apriltag:36h11:5@50mm"
//     marker_mount: {rotation_deg: [0, 0, 0], translation_mm: [0, 0, 0]}    # carriage_from_marker
//     camera_mount: {rotation_deg: [0, 0, 0], translation_mm: [0, 0, 480]}  # camera_from_base
//     marker_size_uncertainty_ppm: 100          # standard uncertainty
//     marker_flatness_um: 10                    # the same, of its edge out of its plane
//     temperature: {uncertainty_k: 0.5, marker_expansion_ppm_per_k: 9,
//                   stage_expansion_ppm_per_k: 11, reference_c: 20}
//     environment: {...}                        # station/setup/environment.h
//     references: {...}                         # TracedReference, below
//     background: 0.6                           # radiance around the marker; its white is 1
//     white_level: 0.8                          # the marker's white in the photographs
//     plan: {volume: {x: [-20, 20], rz: [-5, 5]}, poses: 60, hold_out: 0.4, frames: 3, seed: 7,
//            settle_ms: 50}                     # mm, and degrees for rotary axes
//     detector: auto
//     limits: limits.yaml
//
// Optional, with these values when left out: exposure_us and gain_db (the device's own, not
// touched), packet_size 1400, frame_timeout_ms 1000, retries 5, of the link all but the address
// (the values above), profile generic, marker_mount identity, camera_mount unknown,
// marker_size_uncertainty_ppm, marker_flatness_um, temperature and environment unknown, no
// references, reference_c 20 (ISO 1), background 1, white_level 1, detector auto. All else is
// required.
#pragma once

#include "calib/camera/camera_model.h"
#include "capture/frame/camera.h"
#include "compare/qualification/limits_file.h"
#include "compare/qualification/qualification.h"
#include "core/geometry/rigid.h"
#include "sim/marker/marker.h"
#include "stage/axes/axes.h"
#include "stage/motion/motion_guard.h"
#include "stage/motion/stage.h"
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

// `references` in station.yaml: the certificates of what a station measures with. A run can be
// certified only when each of them is there and was in force on its day (docs/certificate.md).
//
//     references:
//       stage_scale:                       # of every axis, about its zero
//         x: {value_ppm: 3, U_ppm: 20, certificate: "4711 2026-01", laboratory: "A, Braunschweig",
//             date: "2026-01-12", due: "2027-01-12"}
//       marker_size: {value_ppm: 12, U_ppm: 60, ...}      # relative, of the printed marker
//       marker_flatness: {value_um: 2, U_um: 6, ...}      # of its edge out of its plane
//       thermometer: {value_k: 0.02, U_k: 0.1, ...}
//
// The value is the deviation that the certificate found, which nothing corrects for; U is its
// expanded uncertainty at k = 2. A certificate that leaves more than the station declares,
// sqrt(value^2 + (U/2)^2), is refused: the budget would claim too little.
struct TracedReference {
    std::string name;  // "stage scale x", "marker print size", "marker flatness", "thermometer"
    double value = 0.0, expanded_uncertainty = 0.0;  // in `unit`
    std::string unit;                                // "ppm", "um", "K"
    std::string certificate, laboratory;             // its number, and who issued it
    std::string date, due;                           // "2026-01-12"; in force on both

    double standard_uncertainty() const;  // with the deviation that is not corrected for
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

// The stage's section alone, whatever the rest of the file is: stopping the axes must not depend on
// a calibration. Unknown keys are not looked for.
StationStage read_station_stage(const std::filesystem::path& path);

// The files that a station was read from, by content, and their copies in a record: a record must
// tell years later what was measured with what, wherever the originals have gone.
//
// Copies lie under inputs/ as the originals lay under their nearest common folder, so that relative
// paths from one to another still lead to the copy. A file other than the calibration that is named
// with its absolute path is copied too, but it is the original that reading back opens: it must
// still be the same.

// Copies the inputs into `record`/inputs and sets their `copy`. Throws ConfigError when one cannot
// be copied or is not any more what was read.
void copy_inputs(std::vector<InputFile>& inputs, const std::filesystem::path& record);

// The station from these copies, with the inputs as given. Throws ConfigError for a copy outside of
// inputs/, one that is missing or not the recorded bytes, and what read_station() throws.
StationFile read_recorded_station(const std::filesystem::path& record,
                                  const std::vector<InputFile>& inputs);

// Throws ConfigError with the first file that is not the same in both.
void require_same_inputs(const std::vector<InputFile>& recorded,
                         const std::vector<InputFile>& given);

}  // namespace etalon
