#include "compare/photometric/render_derivatives.h"

#include <Eigen/LU>
#include <algorithm>

#include "calib/intrinsics/camera_fit.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// Where the ray meets the marker's plane, in the camera's frame; nothing behind its start.
std::optional<Eigen::Vector3d> point_on_marker(const Rigid& camera_from_marker,
                                               const Eigen::Vector3d& ray) {
    const Eigen::Vector3d normal = camera_from_marker.rotation * Eigen::Vector3d::UnitZ();
    const double depth = normal.dot(camera_from_marker.translation) / normal.dot(ray);
    if (!(depth > 0) || !std::isfinite(depth))
        return std::nullopt;
    return depth * ray;
}

Eigen::Matrix<double, 3, 6> moved_by_pose(const Eigen::Vector3d& arm) {
    Eigen::Matrix<double, 3, 6> moved;
    moved << -cross_matrix(arm), Eigen::Matrix3d::Identity();
    return moved;
}

// The marker displaced within its own plane.
PlacedMarker displaced(PlacedMarker marker, const Eigen::Vector3d& shift_mm) {
    marker.camera_from_marker.translation += marker.camera_from_marker.rotation * shift_mm;
    return marker;
}

}  // namespace

ImageMotion::ImageMotion(const Projector& projector, const Rigid& camera_from_marker,
                         const CalibrationModel& parameters, const cv::Rect& region)
    : region_(region),
      columns_(static_cast<int>(parameters.parameters.size()) + 6),
      nodes_per_row_((region.width - 1) / spacing_px_ + 2) {
    require_point_of_view(projector.camera(), "deriving a rendering");
    const int rows = (region.height - 1) / spacing_px_ + 2;
    const auto count = static_cast<std::size_t>(nodes_per_row_ * rows);
    nodes_.resize(count * static_cast<std::size_t>(2 * columns_));
    seen_.resize(count);
    for (int y = 0; y < rows; ++y)
        for (int x = 0; x < nodes_per_row_; ++x)
            evaluate(projector, camera_from_marker, parameters, x, y);
}

void ImageMotion::evaluate(const Projector& projector, const Rigid& camera_from_marker,
                           const CalibrationModel& parameters, int node_x, int node_y) {
    const Eigen::Vector2d pixel(region_.x + node_x * spacing_px_, region_.y + node_y * spacing_px_);
    const auto ray = projector.ray(pixel);
    if (!ray)
        return;
    const auto point = point_on_marker(camera_from_marker, *ray);
    if (!point)
        return;
    const auto projected = projector.project_with_jacobian(*point);
    if (!projected)
        return;
    Eigen::Matrix2Xd motion(2, columns_);
    if (columns_ > 6)
        motion.leftCols(columns_ - 6) = parameter_jacobian(projector.camera(), *ray, parameters);
    motion.rightCols<6>() =
        projected->jacobian * moved_by_pose(*point - camera_from_marker.translation);
    if (!motion.allFinite())
        return;
    const auto index = static_cast<std::size_t>(node_y * nodes_per_row_ + node_x);
    std::copy_n(motion.data(), motion.size(),
                &nodes_[index * static_cast<std::size_t>(motion.size())]);
    seen_[index] = 1;
}

bool ImageMotion::at(int x, int y, Eigen::Ref<Eigen::Matrix2Xd> motion) const {
    const int i = (x - region_.x) / spacing_px_, j = (y - region_.y) / spacing_px_;
    const auto a = static_cast<std::size_t>(j * nodes_per_row_ + i), b = a + 1;
    const std::size_t c = a + static_cast<std::size_t>(nodes_per_row_), d = c + 1;
    if (!seen_[a] || !seen_[b] || !seen_[c] || !seen_[d])
        return false;
    const double s = static_cast<double>(x - region_.x - i * spacing_px_) / spacing_px_;
    const double t = static_cast<double>(y - region_.y - j * spacing_px_) / spacing_px_;
    motion.noalias() = (1 - t) * (1 - s) * node(a) + (1 - t) * s * node(b) + t * (1 - s) * node(c) +
                       t * s * node(d);
    return true;
}

RenderedGradient rendered_gradient(const Renderer& renderer, const PlacedMarker& marker,
                                   double background, const ImageMotion& motion,
                                   double tolerance_gray, Differences differences) {
    constexpr double shift_px = 0.1;
    const cv::Rect& region = motion.region();
    RenderOptions options;
    options.region = region;
    options.tolerance_gray = tolerance_gray;
    const auto rendered = [&](const PlacedMarker& placed) {
        return renderer.render_part({{placed}, background}, options).within(region);
    };
    // Displacement in the image by mm along the marker's x and y.
    const Eigen::Matrix<double, 3, 2> axes =
        marker.camera_from_marker.rotation.toRotationMatrix().leftCols<2>();
    Eigen::Matrix2Xd moved(2, motion.columns());
    const auto px_per_mm = [&]() -> Eigen::Matrix2d { return moved.rightCols<3>() * axes; };
    if (!motion.at(region.x + region.width / 2, region.y + region.height / 2, moved))
        throw NumericalError("the middle of the marker's image sees nothing of its plane");
    const Eigen::Array2d shift_mm = shift_px / px_per_mm().colwise().norm().transpose().array();
    RenderedGradient gradient{rendered(marker), {}, {}};
    const auto slope = [&](const Eigen::Vector3d& shift) -> cv::Mat {
        const cv::Mat ahead = rendered(displaced(marker, shift));
        if (differences == Differences::forward)
            return (ahead - gradient.radiance) / shift.norm();
        return (ahead - rendered(displaced(marker, -shift))) / (2.0 * shift.norm());
    };
    gradient.by_x = slope({shift_mm.x(), 0, 0});
    gradient.by_y = slope({0, shift_mm.y(), 0});
    for (int y = 0; y < region.height; ++y)
        for (int x = 0; x < region.width; ++x) {
            float &along_x = gradient.by_x.at<float>(y, x),
                  &along_y = gradient.by_y.at<float>(y, x);
            if (along_x == 0.0F && along_y == 0.0F)
                continue;
            Eigen::RowVector2d in_image = Eigen::RowVector2d::Zero();
            // The marker moved to the right shows at each pixel what was to the left of it.
            if (motion.at(region.x + x, region.y + y, moved))
                in_image = -Eigen::RowVector2d(along_x, along_y) * px_per_mm().inverse();
            if (!in_image.allFinite())
                in_image.setZero();
            along_x = static_cast<float>(in_image.x());
            along_y = static_cast<float>(in_image.y());
        }
    return gradient;
}

}  // namespace etalon
