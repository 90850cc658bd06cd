// A study of detectors: `etalon study study.yaml`. Which camera looks at which markers, from where,
// through what disturbances, and who is to find them. Layout of the file: docs/study.md.
#pragma once

#include <set>

#include "compare/detect/detector.h"
#include "core/program/errors.h"
#include "sim/scene/pose_volume.h"
#include "sim/sensor/disturbances.h"

namespace etalon {

// What a study can switch to tell where an error comes from: docs/study.md, Explaining an error.
enum class StudySwitch { tone, half_pixel, noise, blur, undistortion };

using StudySwitches = std::set<StudySwitch>;  // those that are switched
void toggle(StudySwitches& switches, StudySwitch one);

const std::vector<std::string>& study_switch_names();
std::string name_of(StudySwitch one);

// Throws ConfigError at `place` for another name.
StudySwitch parse_study_switch(const std::string& name, const SourcePlace& place);

// The camera that takes the images. Throws ConfigError at `place` for noise or blur not stated.
CameraModel imaging_camera(const CameraModel& camera, const StudySwitches& switches,
                           const SourcePlace& place);

// The camera that poses are estimated with.
CameraModel estimation_camera(const CameraModel& camera, const StudySwitches& switches);

// One of the study's detectors with the marker that it looks for.
struct StudiedDetector {
    std::string name;      // in tables; unique in the study
    std::string detector;  // "aruco", "apriltag", ..., "photometric", "external"
    Marker marker;
    // Of compare/make_detector.h, with its options; of the photometric one, for its start.
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

// Throws ConfigError with file, line and key for what is not as docs/study.md says, a detector that
// cannot see its marker, and a telecentric camera (a distance is not in its images).
StudyFile read_study(const std::filesystem::path& path);

}  // namespace etalon
