#include "sim/render/motion_blur.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "core/program/errors.h"
#include "sim/scene/marker_view.h"

namespace etalon {
namespace {

constexpr int max_parts = 10'000;

// Largest difference between any two radiances of the scene.
double contrast_of(const Scene& scene) {
    double least = scene.background, most = scene.background;
    for (const PlacedMarker& marker : scene.markers) {
        double low = 0.0, high = 0.0;
        cv::minMaxLoc(marker.grid.cells, &low, &high);
        least = std::min(least, low);
        most = std::max(most, high);
    }
    return most - least;
}

// px/s of the fastest of 9 x 9 points of every marker.
double fastest_image_speed(const Projector& projector, const Scene& scene,
                           const MotionDuringExposure& motion) {
    constexpr int steps = 8;
    const Eigen::Vector3d centre = scene.markers.front().camera_from_marker.translation;
    double fastest = 0.0;
    for (const PlacedMarker& marker : scene.markers)
        for (int n = 0; n < (steps + 1) * (steps + 1); ++n) {
            const double u = marker.grid.columns() * (n % (steps + 1)) / double(steps);
            const double v = marker.grid.rows() * (n / (steps + 1)) / double(steps);
            const Eigen::Vector3d p = marker.camera_from_marker * marker.grid.point_mm(u, v);
            const Eigen::Vector3d velocity =
                motion.velocity.head<3>().cross(p - centre) + motion.velocity.tail<3>();
            if (const auto seen = projector.project_with_jacobian(p))
                fastest = std::max(fastest, (seen->jacobian * velocity).norm());
        }
    return fastest;
}

double longest_path_px(const CameraModel& camera, const Scene& scene,
                       const MotionDuringExposure& motion) {
    if (!motion.velocity.allFinite() || !std::isfinite(motion.exposure_s) ||
        motion.exposure_s < 0.0)
        throw NumericalError(fmt::format("no motion has velocities {} over {} s",
                                         fmt::join(motion.velocity, ", "), motion.exposure_s));
    if (scene.markers.empty())
        return 0.0;
    constexpr double margin = 1.25;
    const Projector projector(camera);
    double fastest = 0.0;
    for (const double part : {-0.5, 0.0, 0.5}) {
        const Scene at = scene_at(scene, motion, part * motion.exposure_s);
        fastest = std::max(fastest, fastest_image_speed(projector, at, motion));
    }
    return margin * fastest * motion.exposure_s;
}

}  // namespace

int parts_of_exposure(double path_px, double contrast, double tolerance_gray) {
    const double parts = std::ceil(std::sqrt(255.0 * contrast * path_px / (4.0 * tolerance_gray)));
    if (!(parts <= max_parts))
        throw NumericalError(
            fmt::format("a motion of {:.6g} px needs more than {} still images to keep within {} "
                        "gray",
                        path_px, max_parts, tolerance_gray));
    return std::max(1, static_cast<int>(parts));
}

Scene scene_at(const Scene& scene, const MotionDuringExposure& motion, double time_s) {
    Scene moved = scene;
    if (scene.markers.empty())
        return moved;
    const Eigen::Vector3d centre = scene.markers.front().camera_from_marker.translation;
    const Eigen::Quaterniond turn = rotation_from_vector(motion.velocity.head<3>() * time_s);
    const Eigen::Vector3d shift = motion.velocity.tail<3>() * time_s;
    for (PlacedMarker& marker : moved.markers) {
        Rigid& pose = marker.camera_from_marker;
        pose.rotation = (turn * pose.rotation).normalized();
        pose.translation = centre + turn * (pose.translation - centre) + shift;
    }
    return moved;
}

MovingImage render_moving(const Renderer& renderer, const Scene& scene,
                          const MotionDuringExposure& motion, const RenderOptions& options) {
    check_scene(scene);
    RenderOptions still = options;
    still.tolerance_gray = 0.5 * options.tolerance_gray;
    MovingImage moving;
    moving.path_px = longest_path_px(renderer.camera(), scene, motion);
    moving.parts = parts_of_exposure(moving.path_px, contrast_of(scene), still.tolerance_gray);
    cv::Mat sum;
    for (int i = 0; i < moving.parts; ++i) {
        const double time_s = ((i + 0.5) / moving.parts - 0.5) * motion.exposure_s;
        moving.image = renderer.render(scene_at(scene, motion, time_s), still);
        if (sum.empty())
            sum = cv::Mat::zeros(moving.image.radiance.size(), CV_64FC1);
        cv::add(sum, moving.image.radiance, sum, cv::noArray(), CV_64F);
    }
    sum.convertTo(moving.image.radiance, CV_32FC1, 1.0 / moving.parts);
    return moving;
}

}  // namespace etalon
