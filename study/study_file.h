// A study of detectors: `etalon study study.yaml`. Which camera looks at which markers, from where,
// through what disturbances, and who is to find them. Layout of the file: docs/study.md.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "calib/camera/camera_model.h"
#include "compare/detect/detector.h"
#include "sim/marker/marker.h"
#include "sim/scene/pose_volume.h"
#include "sim/sensor/disturbances.h"
#include "study/study_switches.h"

namespace etalon {

// One of the study's detectors with the marker that it looks for.
struct StudiedDetector {
    std::string name;      // in tables; unique in the study
    std::string detector;  // "aruco", "apriltag", ..., "photometric", "external"
    Marker marker;
    // Of a detector from compare/make_detector.h, with its options; of the photometric one, what
    // finds its start.
    std::function<std::unique_ptr<Detector>()> make_finder;
    // Of an external one.
    std::vector<std::string> command;
    std::chrono::milliseconds time_out{};
};

// Where the markers are: drawn from a volume, or listed in a file.
struct StudyPoses {
    int count = 0;  // drawn, or in the file
    PoseVolume volume;
    SequenceKind sequence = SequenceKind::halton;
    std::uint64_t seed = 1;
    std::filesystem::path file;  // empty: drawn
    std::vector<Rigid> listed;   // camera_from_marker, of the file
};

// A disturbance with a value for each pose, drawn along with it.
struct StudiedDisturbance {
    const DisturbanceAxis* axis = nullptr;
    Interval values{};
};

struct StudyFile {
    std::string id;
    std::filesystem::path camera_file;
    CameraModel camera;
    double background = 1.0, white_level = 1.0;  // radiances, 1 = full scale
    StudyPoses poses;
    std::vector<StudiedDetector> detectors;
    std::vector<StudiedDisturbance> disturbances;
    // Distances at which the camera is focused, mm, drawn along with the poses; empty: its own.
    std::vector<double> focus_mm;
    StudySwitches switched;  // in the study itself, before any ablation
};

// Throws ConfigError with file, line and key for whatever is not as docs/study.md says, for a
// detector that cannot see its marker, and for a telecentric camera (a distance is not in its
// images).
StudyFile read_study(const std::filesystem::path& path);

// The names that `detector:` may have: "aruco", "apriltag", "charuco", ...
const std::vector<std::string>& studied_detector_names();

}  // namespace etalon
