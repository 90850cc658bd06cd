// Photographs of a marker: read as the calibration expects them, the marker found, its pose
// estimated. Shared by `etalon detect` and `etalon compare`.
#pragma once

#include <filesystem>

#include "compare/detect/detector.h"

namespace etalon {

// The marker in one photograph, or why it is not there.
struct PhotoPose {
    std::filesystem::path photo;
    std::string failure;                     // empty when there is a pose
    std::optional<DetectedCorners> corners;  // may be there without a pose
    std::optional<PoseEstimate> estimate;
    std::string shown_as = {};  // as in Detection
};

// A foreign calibration without an image size takes that of the first photograph. Throws
// ConfigError when the calibration or the photograph cannot be read.
CameraModel read_camera_for(const std::filesystem::path& camera_file,
                            const std::vector<std::filesystem::path>& photos);

// One for each photograph; else throws ConfigError.
std::vector<Rigid> read_poses_for(const std::filesystem::path& poses,
                                  const std::vector<std::filesystem::path>& photos);

// A photograph whose size must be the calibration's (ConfigError names both). A 16-bit file holds
// the sensor's bits in the low bits where the camera has a sensor section with fewer than 16.
CodeImage read_photo(const std::filesystem::path& photo, const CameraModel& camera,
                     const std::filesystem::path& camera_file);

// The same of an image that is at hand: `photo` and `calibration` are what errors call the two.
CodeImage taken_by(const CameraModel& camera, CodeImage image, const std::string& photo,
                   const std::string& calibration);

// By the file's first two bytes, not by its name.
bool is_jpeg(const std::filesystem::path& photo);

// Without poses: an entry for each that looks like the marker, or one that says why there is none.
std::vector<PhotoPose> find_markers(const std::filesystem::path& photo, const CodeImage& image,
                                    Detector& detector);

// With the pose from its corners, which of circles are put where their centres are seen.
PhotoPose with_pose(PhotoPose seen, const Projector& projector, const Marker& marker);

// Detection and pose of one photograph; a marker that is not found, or not once, is no error.
PhotoPose find_marker(const std::filesystem::path& photo, const CodeImage& image,
                      Detector& detector, const Projector& projector, const Marker& marker);

// For who renders the marker: one that is drawn otherwise than it is named has no pose.
PhotoPose find_as_drawn(const std::filesystem::path& photo, const CodeImage& image,
                        Detector& detector, const Projector& projector, const Marker& marker);

}  // namespace etalon
