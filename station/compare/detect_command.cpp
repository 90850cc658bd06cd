// `etalon detect`: where the marker is in each photograph, with both planar solutions.
#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "compare/detect/photo_pose.h"
#include "compare/make_detector.h"
#include "core/errors.h"
#include "core/pose_numbers.h"
#include "report/json_text.h"
#include "station/compare/commands.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

ordered_json photo_json(const PhotoPose& pose) {
    ordered_json json = {{"photo", pose.photo.string()}};
    if (pose.corners) {
        json["id"] = pose.corners->id;
        for (const Eigen::Vector2d& corner : pose.corners->pixels)
            json["corners_px"].push_back({corner.x(), corner.y()});
        if (!pose.corners->is_whole())
            json["points"] = pose.corners->points;
    }
    if (!pose.estimate) {
        json["failure"] = pose.failure;
        return json;
    }
    json["camera_from_marker"] = pose_numbers(pose.estimate->camera_from_marker);
    json["reprojection_rms_px"] = pose.estimate->reprojection_rms_px;
    if (pose.estimate->alternative) {
        json["alternative"] = pose_numbers(*pose.estimate->alternative);
        json["alternative_rms_px"] = pose.estimate->alternative_rms_px;
    }
    json["covariance_per_px2"] = row_numbers(pose.estimate->covariance_per_px2);
    return json;
}

void print_json(const DetectArguments& arguments, const Detector& detector,
                const std::vector<PhotoPose>& poses) {
    ordered_json json = {{"etalon", "detections/1"},
                         {"camera", arguments.camera.string()},
                         {"marker", arguments.marker},
                         {"detector", detector.name()}};
    for (const PhotoPose& pose : poses)
        json["photos"].push_back(photo_json(pose));
    std::puts(text_of(json).c_str());
}

// A line per photograph, and below it the other planar solution, so that columns line up.
void print_table(const std::vector<PhotoPose>& poses) {
    std::size_t width = 5;
    for (const PhotoPose& pose : poses)
        width = std::max(width, pose.photo.filename().string().size());
    fmt::print("{:<{}} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}  RMS px  corners\n", "photo", width,
               "rx rad", "ry", "rz", "tx mm", "ty", "tz");
    for (const PhotoPose& pose : poses) {
        const std::string name = pose.photo.filename().string();
        if (!pose.estimate) {
            fmt::print("{:<{}} {}\n", name, width, pose.failure);
            continue;
        }
        const PoseEstimate& estimate = *pose.estimate;
        fmt::print("{:<{}} {}  {:6.3f}  {}\n", name, width,
                   pose_columns(estimate.camera_from_marker), estimate.reprojection_rms_px,
                   pose.corners->pixels.size());
        if (estimate.alternative)
            fmt::print("{:<{}} {}  {:6.3f}\n", "  or", width, pose_columns(*estimate.alternative),
                       estimate.alternative_rms_px);
    }
}

}  // namespace

int run_detect(const DetectArguments& arguments) {
    if (arguments.photos.empty())
        throw ConfigError({"PHOTOS"}, "no photograph given");
    if (arguments.detector == "photometric")
        return run_photometric_detect(arguments);
    if (!arguments.poses.empty())
        throw ConfigError({"--poses"}, "only --detector photometric starts from poses");
    const Marker marker = parse_marker(arguments.marker, "--marker");
    const auto detector = make_detector(arguments.detector, marker, "--detector");
    const CameraModel camera = read_camera_for(arguments.camera, arguments.photos);
    const Projector projector(camera);
    std::vector<PhotoPose> poses;
    for (const auto& photo : arguments.photos)
        poses.push_back(find_marker(photo, read_photo(photo, camera, arguments.camera), *detector,
                                    projector, marker));
    const auto found = std::count_if(poses.begin(), poses.end(), [](const PhotoPose& pose) {
        return pose.estimate.has_value();
    });
    if (arguments.json)
        print_json(arguments, *detector, poses);
    else
        print_table(poses);
    if (found == 0)
        throw NumericalError(fmt::format("{} has no pose in any of {} photographs ({}: {})",
                                         marker.spec, poses.size(), poses.front().photo.string(),
                                         poses.front().failure));
    fmt::print(stderr, "found in {} of {} photographs\n", found, poses.size());
    return 0;
}

void declare_detect(Command& program) {
    auto [command, asked] =
        program.add(run_detect, "detect", "find a marker in photographs, and its pose",
                    pose_help + "\n" + marker_help);
    command.required("PHOTOS", asked->photos, "photographs to look at");
    command.required("--marker", asked->marker, "what to look for, see below", "M");
    command.option("--camera", asked->camera, "calibration, for the pose", "FILE");
    command.option(
        "--detector", asked->detector,
        "apriltag, aruco, topotag, chessboard, charuco, stag,\nauto: the marker's own; or "
        "photometric: the pose\nfrom all pixels, for any marker or board",
        "NAME");
    command.option("--poses", asked->poses,
                   "where the marker is about (photometric only):\na pose for each photo, the "
                   "image right to 5 px",
                   "FILE");
}

}  // namespace etalon
