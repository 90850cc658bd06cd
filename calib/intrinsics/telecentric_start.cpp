#include "calib/intrinsics/telecentric_start.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>
#include <limits>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double nearly_flat_rad = 0.035;  // 2 degrees

// A view's affine map, about the middle of its points.
struct AffineView {
    Eigen::Vector3d centre_mm;
    Eigen::Vector2d middle;  // where the centre is seen
    Eigen::Matrix2d map;     // d seen / d (x, y)
    double reach_mm;         // of the farthest point
};

AffineView affine_view(const std::vector<Eigen::Vector3d>& points_mm,
                       const std::vector<Eigen::Vector2d>& seen) {
    const double count = static_cast<double>(seen.size());
    AffineView view{Eigen::Vector3d::Zero(), Eigen::Vector2d::Zero(), {}, 0.0};
    for (std::size_t i = 0; i < seen.size(); ++i) {
        view.centre_mm += points_mm[i] / count;
        view.middle += seen[i] / count;
    }
    Eigen::Matrix2d seen_by_point = Eigen::Matrix2d::Zero(), scatter = Eigen::Matrix2d::Zero();
    for (std::size_t i = 0; i < seen.size(); ++i) {
        const Eigen::Vector2d arm = (points_mm[i] - view.centre_mm).head<2>();
        seen_by_point += (seen[i] - view.middle) * arm.transpose();
        scatter += arm * arm.transpose();
        view.reach_mm = std::max(view.reach_mm, arm.norm());
    }
    view.map = seen_by_point * scatter.inverse();
    return view;
}

double larger_singular_value(const Eigen::Matrix2d& map) {
    return Eigen::JacobiSVD<Eigen::Matrix2d>(map).singularValues()[0];
}

// What the views make of the magnification along x where that along y is `ratio` times it.
struct Magnification {
    double mean = 0.0, scatter = std::numeric_limits<double>::infinity();  // relative, squared
};

Magnification magnification(const std::vector<AffineView>& views, double ratio) {
    const double count = static_cast<double>(views.size());
    double mean = 0.0, squares = 0.0;
    for (const AffineView& view : views) {
        const double value =
            larger_singular_value(Eigen::Vector2d(1.0, 1.0 / ratio).asDiagonal() * view.map);
        mean += value / count;
        squares += value * value / count;
    }
    return {mean, squares / (mean * mean) - 1.0};
}

// Square pixels, unless others halve the scatter: what is left of the distortion would choose any.
double searched_ratio(const std::vector<AffineView>& views) {
    double ratio = 1.0, least = 0.5 * magnification(views, 1.0).scatter;
    const auto consider = [&](double candidate) {
        const double scatter = magnification(views, candidate).scatter;
        if (scatter < least) {
            least = scatter;
            ratio = candidate;
        }
    };
    for (int i = -70; i <= 70; ++i)
        consider(std::exp2(i / 70.0));
    for (double step = 0.005; step > 1e-5; step *= 0.5) {
        const double middle = ratio;
        consider(middle * (1.0 - step));
        consider(middle * (1.0 + step));
    }
    return ratio;
}

// Of a plane seen by the view's map in mm. Below `flat_rad` no tilt at all.
Rigid pose_of(const AffineView& view, double flat_rad) {
    const Eigen::JacobiSVD<Eigen::Matrix2d> svd(view.map,
                                                Eigen::ComputeFullU | Eigen::ComputeFullV);
    const double larger = svd.singularValues()[0];
    double cosine = larger > 0.0 ? svd.singularValues()[1] / larger : 0.0;
    if (cosine >= std::cos(flat_rad))
        cosine = 1.0;
    const double sine = std::sqrt((1.0 - cosine) * (1.0 + cosine));
    const auto turned = [](const Eigen::Matrix2d& in_plane) {
        Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();
        turn.topLeftCorner<2, 2>() = in_plane;
        turn(2, 2) = in_plane.determinant() > 0.0 ? 1.0 : -1.0;
        return turn;
    };
    Eigen::Matrix3d tilt;
    tilt << 1, 0, 0, 0, cosine, -sine, 0, sine, cosine;
    const Eigen::Quaterniond rotation(
        Eigen::Matrix3d(turned(svd.matrixU()) * tilt * turned(svd.matrixV()).transpose()));
    const Eigen::Vector3d place(view.middle.x(), view.middle.y(), 2.0 * view.reach_mm);
    const Rigid pose{rotation.normalized(), place - rotation.normalized() * view.centre_mm};
    return cosine < 1.0 ? pose : flat_on(pose, view.centre_mm);
}

}  // namespace

CameraStart telecentric_calibration_start(std::span<const CalibrationView> views,
                                          cv::Size image_size) {
    std::vector<AffineView> affine;
    for (const CalibrationView& view : views)
        affine.push_back(affine_view(view.points_mm, view.pixels));
    const double ratio = searched_ratio(affine);
    const double fx = magnification(affine, ratio).mean, fy = ratio * fx;
    if (!std::isfinite(fx) || !(fx > 0.0))
        throw NumericalError("the pixels of a view do not make a plane");
    CameraStart start;
    start.camera.projection.kind = Projection::telecentric;
    start.camera.width = image_size.width;
    start.camera.height = image_size.height;
    const Eigen::Vector2d principal(0.5 * (image_size.width - 1), 0.5 * (image_size.height - 1));
    start.camera.intrinsics = {fx, fy, principal.x(), principal.y()};
    const Eigen::Vector2d to_mm(1.0 / fx, 1.0 / fy);
    for (AffineView& view : affine) {
        view.map = to_mm.asDiagonal() * view.map;
        view.middle = to_mm.cwiseProduct(view.middle - principal);
        start.camera_from_target.push_back(pose_of(view, nearly_flat_rad));
    }
    return start;
}

Rigid pose_from_affine(const std::vector<Eigen::Vector3d>& points_mm,
                       const std::vector<Eigen::Vector2d>& undistorted_mm) {
    return pose_of(affine_view(points_mm, undistorted_mm), 0.0);
}

Rigid flat_on(const Rigid& camera_from_target, const Eigen::Vector3d& centre_mm) {
    Eigen::Quaterniond rotation = camera_from_target.rotation;
    const bool from_behind = (rotation * Eigen::Vector3d::UnitZ()).z() < 0.0;
    if (from_behind)
        rotation.z() = rotation.w() = 0.0;
    else
        rotation.x() = rotation.y() = 0.0;
    rotation.normalize();
    return {rotation, camera_from_target * centre_mm - rotation * centre_mm};
}

bool is_flat_on(const Eigen::Quaterniond& rotation) {
    return (rotation.x() == 0.0 && rotation.y() == 0.0) ||
           (rotation.z() == 0.0 && rotation.w() == 0.0);
}

double tilt_rad(const Eigen::Quaterniond& rotation) {
    const Eigen::Vector3d normal = rotation * Eigen::Vector3d::UnitZ();
    return std::atan2(normal.head<2>().norm(), std::abs(normal.z()));
}

}  // namespace etalon
