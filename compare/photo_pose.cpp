#include "compare/photo_pose.h"

#include <fmt/format.h>

#include <fstream>

#include "calib/files/camera_file.h"
#include "compare/detect/board/calibration_target.h"
#include "sim/scene/pose_file.h"

namespace etalon {
CameraModel read_camera_for(const std::filesystem::path& camera_file,
                            const std::vector<std::filesystem::path>& photos) {
    std::optional<cv::Size> size;  // which a calibration of another tool may lack
    if (!photos.empty() && !is_etalon_file(camera_file))
        size = read_image(photos.front()).pixels.size();
    return read_any_camera(camera_file, size);
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
    return taken_by(camera, read_image(photo), photo.string(), camera_file.string());
}

CodeImage taken_by(const CameraModel& camera, CodeImage image, const std::string& photo,
                   const std::string& calibration) {
    const cv::Size size = image.pixels.size();
    if (size != cv::Size(camera.width, camera.height))
        throw ConfigError(
            {photo},
            fmt::format("is {} x {} px, but the calibration {} is for {} x {} px", size.width,
                        size.height, calibration, camera.width, camera.height));
    // Images with more bits than a byte arrive in 16-bit files, whatever the sensor has.
    if (!camera.sensor || image.bits != 16 || camera.sensor->bits <= 8)
        return image;
    image.bits = camera.sensor->bits;
    double highest = 0.0;
    cv::minMaxLoc(image.pixels, nullptr, &highest);
    if (highest > image.full_scale())
        throw ConfigError(
            {photo}, fmt::format("holds the code value {:.0f}, too large for the camera's {} bits",
                                 highest, image.bits));
    return image;
}

bool is_jpeg(const std::filesystem::path& photo) {
    std::ifstream file(photo, std::ios::binary);
    return file.get() == 0xff && file.get() == 0xd8;
}

std::vector<PhotoPose> find_markers(const std::filesystem::path& photo, const CodeImage& image,
                                    Detector& detector) {
    const Detection seen = detector.detect(image);
    if (seen.several.empty())
        return {{photo, seen.reason, seen.corners, {}, seen.shown_as}};
    std::vector<PhotoPose> all;
    for (const DetectedCorners& corners : seen.several)
        all.push_back({photo, {}, corners, {}});
    return all;
}

PhotoPose with_pose(PhotoPose seen, const Projector& projector, const Marker& marker) {
    if (!seen.corners)
        return seen;
    CalibrationView view{seen_points_mm(marker, *seen.corners), seen.corners->pixels};
    seen.estimate = estimate_pose(projector, view.points_mm, view.pixels);
    if (seen.estimate && has_circles({marker})) {
        view = with_circle_centres({marker}, view, projector.camera(),
                                   seen.estimate->camera_from_marker);
        seen.corners->pixels = view.pixels;
        seen.estimate = estimate_pose(projector, view.points_mm, view.pixels);
    }
    if (!seen.estimate)
        seen.failure = "its corners determine no pose in front of the camera";
    return seen;
}

PhotoPose find_marker(const std::filesystem::path& photo, const CodeImage& image,
                      Detector& detector, const Projector& projector, const Marker& marker) {
    const Detection seen = detector.detect(image);
    return with_pose({photo, seen.reason, seen.corners, {}, seen.shown_as}, projector, marker);
}

PhotoPose find_as_drawn(const std::filesystem::path& photo, const CodeImage& image,
                        Detector& detector, const Projector& projector, const Marker& marker) {
    PhotoPose result = find_marker(photo, image, detector, projector, marker);
    if (result.shown_as.empty())
        return result;
    result.estimate.reset();
    result.failure = drawn_otherwise(result.shown_as);
    return result;
}

}  // namespace etalon
