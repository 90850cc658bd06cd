#include "compare/render_derivatives.h"

#include "calib/camera_fit.h"
#include "core/errors.h"

namespace etalon {
namespace {

// The camera whose every image is displaced by this much.
CameraModel displaced(CameraModel camera, double x_px, double y_px) {
    camera.intrinsics.cx += x_px;
    camera.intrinsics.cy += y_px;
    return camera;
}

// Where the ray meets the marker's plane, in the camera's frame; nothing behind the camera.
std::optional<Eigen::Vector3d> point_on_marker(const Rigid& camera_from_marker,
                                               const Eigen::Vector2d& undistorted) {
    const Eigen::Vector3d normal = camera_from_marker.rotation * Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d ray = undistorted.homogeneous();
    const double depth = normal.dot(camera_from_marker.translation) / normal.dot(ray);
    if (!(depth > 0) || !std::isfinite(depth))
        return std::nullopt;
    return depth * ray;
}

Eigen::Matrix<double, 3, 6> moved_by_pose(const Eigen::Vector3d& arm) {
    Eigen::Matrix<double, 3, 6> moved;
    moved << 0, arm.z(), -arm.y(), 1, 0, 0,  //
        -arm.z(), 0, arm.x(), 0, 1, 0,       //
        arm.y(), -arm.x(), 0, 0, 0, 1;
    return moved;
}

}  // namespace

GradientRenderer::GradientRenderer(const CameraModel& camera)
    : centre_(camera),
      by_x_{Renderer(displaced(camera, -shift_px_, 0)), Renderer(displaced(camera, shift_px_, 0))},
      by_y_{Renderer(displaced(camera, 0, -shift_px_)), Renderer(displaced(camera, 0, shift_px_))} {
}

RenderedGradient GradientRenderer::render(const Scene& scene, const RenderOptions& options) const {
    // An image moved to the left shows at each pixel what was to the right of it.
    const auto slope = [&](const std::array<Renderer, 2>& moved) -> cv::Mat {
        return (moved[0].render(scene, options).radiance -
                moved[1].render(scene, options).radiance) /
               (2.0 * shift_px_);
    };
    return {centre_.render(scene, options).radiance, slope(by_x_), slope(by_y_)};
}

ImageMotion::ImageMotion(const Projector& projector, const Rigid& camera_from_marker,
                         const CalibrationModel& parameters, const cv::Rect& region)
    : region_(region),
      columns_(static_cast<int>(parameters.parameters.size()) + 6),
      nodes_per_row_((region.width - 1) / spacing_px_ + 2) {
    require_perspective(projector.camera(), "deriving a rendering");
    const int rows = (region.height - 1) / spacing_px_ + 2;
    nodes_.resize(static_cast<std::size_t>(nodes_per_row_ * rows));
    for (int y = 0; y < rows; ++y)
        for (int x = 0; x < nodes_per_row_; ++x)
            evaluate(projector, camera_from_marker, parameters, x, y);
}

void ImageMotion::evaluate(const Projector& projector, const Rigid& camera_from_marker,
                           const CalibrationModel& parameters, int node_x, int node_y) {
    const Eigen::Vector2d pixel(region_.x + node_x * spacing_px_, region_.y + node_y * spacing_px_);
    const auto undistorted = projector.unproject(pixel);
    if (!undistorted)
        return;
    const auto point = point_on_marker(camera_from_marker, *undistorted);
    if (!point)
        return;
    const auto projected = projector.project_with_jacobian(*point);
    if (!projected)
        return;
    Eigen::Matrix2Xd motion(2, columns_);
    if (columns_ > 6)
        motion.leftCols(columns_ - 6) =
            parameter_jacobian(projector.camera(), *undistorted, parameters);
    motion.rightCols<6>() =
        projected->jacobian * moved_by_pose(*point - camera_from_marker.translation);
    if (motion.allFinite())
        nodes_[static_cast<std::size_t>(node_y * nodes_per_row_ + node_x)] = std::move(motion);
}

bool ImageMotion::at(int x, int y, Eigen::Ref<Eigen::Matrix2Xd> motion) const {
    const int i = (x - region_.x) / spacing_px_, j = (y - region_.y) / spacing_px_;
    const Eigen::Matrix2Xd &a = node(i, j), &b = node(i + 1, j), &c = node(i, j + 1),
                           &d = node(i + 1, j + 1);
    if (a.cols() == 0 || b.cols() == 0 || c.cols() == 0 || d.cols() == 0)
        return false;
    const double s = static_cast<double>(x - region_.x - i * spacing_px_) / spacing_px_;
    const double t = static_cast<double>(y - region_.y - j * spacing_px_) / spacing_px_;
    motion = (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d);
    return true;
}

}  // namespace etalon
