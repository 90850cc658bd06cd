#include "compare/detect/photo_pose.h"

#include <fmt/format.h>

#include <fstream>

#include "calib/files/camera_file.h"
#include "core/errors.h"
#include "core/strict_reader.h"
#include "sim/scene/pose_file.h"

namespace etalon {
namespace {

// Images with more bits than a byte arrive in 16-bit files, whatever the sensor has.
void take_the_sensors_bits(CodeImage& image, const Sensor& sensor,
                           const std::filesystem::path& photo) {
    if (image.bits != 16 || sensor.bits <= 8)
        return;
    double highest = 0.0;
    cv::minMaxLoc(image.pixels, nullptr, &highest);
    if (highest > (1 << sensor.bits) - 1)
        throw ConfigError({photo.string()},
                          fmt::format("holds the code value {:.0f}, too large for the camera's {} "
                                      "bits",
                                      highest, sensor.bits));
    image.bits = sensor.bits;
}

}  // namespace

CameraModel read_camera_for(const std::filesystem::path& camera_file,
                            const std::vector<std::filesystem::path>& photos) {
    if (photos.empty() || is_etalon_file(camera_file))
        return read_camera(camera_file);
    return read_camera(camera_file, read_image(photos.front()).pixels.size());
}

std::vector<Rigid> read_poses_for(const std::filesystem::path& poses,
                                  const std::vector<std::filesystem::path>& photos) {
    std::vector<Rigid> result = read_poses(poses);
    if (result.size() != photos.size())
        throw ConfigError({poses.string()}, fmt::format("holds {} poses for {} photographs",
                                                        result.size(), photos.size()));
    return result;
}

CodeImage read_photo(const std::filesystem::path& photo, const CameraModel& camera,
                     const std::filesystem::path& camera_file) {
    CodeImage image = read_image(photo);
    const cv::Size size = image.pixels.size();
    if (size != cv::Size(camera.width, camera.height))
        throw ConfigError(
            {photo.string()},
            fmt::format("is {} x {} px, but the calibration {} is for {} x {} px", size.width,
                        size.height, camera_file.string(), camera.width, camera.height));
    if (camera.sensor)
        take_the_sensors_bits(image, *camera.sensor, photo);
    return image;
}

bool is_jpeg(const std::filesystem::path& photo) {
    std::ifstream file(photo, std::ios::binary);
    return file.get() == 0xff && file.get() == 0xd8;
}

PhotoPose find_marker(const std::filesystem::path& photo, const CodeImage& image,
                      Detector& detector, const Projector& projector, const Marker& marker) {
    const Detection seen = detector.detect(image);
    PhotoPose result{photo, seen.reason, seen.corners, {}};
    if (!result.corners)
        return result;
    result.estimate =
        estimate_pose(projector, seen_points_mm(marker, *result.corners), result.corners->pixels);
    if (!result.estimate)
        result.failure = "its corners determine no pose in front of the camera";
    return result;
}

}  // namespace etalon
