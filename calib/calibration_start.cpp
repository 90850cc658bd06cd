#include "calib/calibration_start.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <limits>

#include "core/errors.h"

namespace etalon {
namespace {

// Moves points to their centroid and scales them to a mean square of 2.
struct Normaliser {
    Eigen::Vector2d centre = Eigen::Vector2d::Zero();
    double scale = 1.0;

    template <typename Points>
    explicit Normaliser(const Points& points) {
        const double count = static_cast<double>(points.size());
        for (const auto& point : points)
            centre += point.template head<2>() / count;
        double squares = 0.0;
        for (const auto& point : points)
            squares += (point.template head<2>() - centre).squaredNorm() / count;
        scale = std::sqrt(2.0 / squares);
    }
    Eigen::Vector2d operator()(const Eigen::Vector2d& point) const {
        return scale * (point - centre);
    }
    Eigen::Matrix3d matrix() const {
        Eigen::Matrix3d map;
        map << scale, 0, -scale * centre.x(), 0, scale, -scale * centre.y(), 0, 0, 1;
        return map;
    }
};

// A view's plane, its points scaled, and the homography that takes them to what was seen, positive
// for points in front.
struct Plane {
    Eigen::Vector2d centre_mm;
    double scale;  // of the points
    std::vector<Eigen::Vector2d> points, seen;
    Eigen::Matrix3d homography;
};

Plane plane_of(const std::vector<Eigen::Vector3d>& points_mm,
               const std::vector<Eigen::Vector2d>& seen) {
    const Normaliser of_points(points_mm), of_seen(seen);
    Plane plane{of_points.centre, of_points.scale, {}, seen, {}};
    Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
    for (std::size_t i = 0; i < seen.size(); ++i) {
        plane.points.push_back(of_points(points_mm[i].head<2>()));
        const Eigen::RowVector3d p(plane.points[i].x(), plane.points[i].y(), 1.0);
        const Eigen::Vector2d q = of_seen(seen[i]);
        Eigen::Matrix<double, 2, 9> rows;
        rows << p, Eigen::RowVector3d::Zero(), -q.x() * p,  //
            Eigen::RowVector3d::Zero(), p, -q.y() * p;
        normal += rows.transpose() * rows;
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> eigen(normal);
    const Eigen::Matrix3d transposed =
        Eigen::Map<const Eigen::Matrix3d>(eigen.eigenvectors().col(0).data());
    plane.homography = of_seen.matrix().inverse() * transposed.transpose();
    if (plane.homography(2, 2) < 0.0)
        plane.homography = -plane.homography;
    return plane;
}

// [r1 r2 | t] of a plane from K^-1 H: the nearest orthonormal pair, and the scale that fits it.
struct ScaledPose {
    Eigen::Matrix<double, 3, 2> axes;
    Eigen::Vector3d translation;  // in units of the plane's points
};

ScaledPose scaled_pose(const Eigen::Matrix3d& homography) {
    const auto pair = homography.leftCols<2>();
    const Eigen::Matrix2d gram = pair.transpose() * pair;
    const double root = std::sqrt(std::max(gram.determinant(), 0.0));
    const double trace = std::sqrt(gram.trace() + 2.0 * root);  // of the square root of gram
    Eigen::Matrix2d square_root = gram;
    square_root.diagonal().array() += root;
    square_root /= trace;
    return {pair * square_root.inverse(), homography.col(2) / (0.5 * trace)};
}

// Sum of squared distances in the image, in units of `focal`; infinite behind the camera.
double projection_error(const Plane& plane, const Eigen::Vector2d& focal,
                        const Eigen::Vector2d& principal) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    Eigen::Matrix3d normalised;
    normalised.row(2) = plane.homography.row(2);
    for (int k = 0; k < 2; ++k)
        normalised.row(k) =
            (plane.homography.row(k) - principal[k] * plane.homography.row(2)) / focal[k];
    const ScaledPose pose = scaled_pose(normalised);
    double squares = 0.0;
    for (std::size_t i = 0; i < plane.points.size(); ++i) {
        const Eigen::Vector3d p = pose.axes * plane.points[i] + pose.translation;
        if (!(p.z() > 0.0))
            return infinity;
        const Eigen::Vector2d pixel = focal.cwiseProduct(p.head<2>()) / p.z() + principal;
        squares += (pixel - plane.seen[i]).squaredNorm();
    }
    return squares;
}

double projection_error(const std::vector<Plane>& planes, const Eigen::Vector2d& focal,
                        const Eigen::Vector2d& principal) {
    double sum = 0.0;
    for (const Plane& plane : planes)
        sum += projection_error(plane, focal, principal);
    return sum;
}

// The best of a grid with steps of a quarter.
Eigen::Vector2d searched_focal(const std::vector<Plane>& planes, double diagonal_px,
                               const Eigen::Vector2d& principal) {
    double best = std::numeric_limits<double>::infinity();
    Eigen::Vector2d focal = Eigen::Vector2d::Zero();
    for (double f = 0.01 * diagonal_px; f < 1e4 * diagonal_px; f *= 1.25)
        for (const double root_of_ratio : {0.7071, 0.8409, 1.0, 1.1892, 1.4142}) {
            const Eigen::Vector2d candidate(f * root_of_ratio, f / root_of_ratio);
            const double error = projection_error(planes, candidate, principal);
            if (error < best) {
                best = error;
                focal = candidate;
            }
        }
    if (!std::isfinite(best))
        throw NumericalError("no focal length puts all points in front of the camera");
    return focal;
}

}  // namespace

std::optional<Rigid> pose_from_homography(const std::vector<Eigen::Vector3d>& points_mm,
                                          const std::vector<Eigen::Vector2d>& normalised) {
    const Plane plane = plane_of(points_mm, normalised);
    const ScaledPose pose = scaled_pose(plane.homography);
    Eigen::Matrix3d rotation;
    rotation << pose.axes, pose.axes.col(0).cross(pose.axes.col(1));
    Rigid transform{Eigen::Quaterniond(rotation).normalized(), pose.translation / plane.scale};
    for (const Eigen::Vector2d& point : plane.points) {
        const double depth = (pose.axes * point + pose.translation).z();
        if (!(depth > 0.0) || !rotation.allFinite() || !transform.translation.allFinite())
            return std::nullopt;
    }
    const Eigen::Vector3d centre(plane.centre_mm.x(), plane.centre_mm.y(), 0.0);
    transform.translation -= transform.rotation * centre;
    return transform;
}

Rigid mirrored_pose(const Rigid& camera_from_target, const Eigen::Vector3d& centre_mm) {
    const Eigen::Vector3d centre = camera_from_target * centre_mm;
    const Eigen::Vector3d sight = centre.normalized();
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - 2.0 * sight * sight.transpose();
    const Eigen::Matrix3d rotation = across * camera_from_target.rotation.toRotationMatrix() *
                                     Eigen::Vector3d(1, 1, -1).asDiagonal();
    const Eigen::Quaterniond turned = Eigen::Quaterniond(rotation).normalized();
    return {turned, centre - turned * centre_mm};
}

CameraStart calibration_start(std::span<const CalibrationView> views, cv::Size image_size) {
    const Eigen::Vector2d principal(0.5 * (image_size.width - 1), 0.5 * (image_size.height - 1));
    std::vector<Plane> planes;
    for (const CalibrationView& view : views)
        planes.push_back(plane_of(view.points_mm, view.pixels));
    const Eigen::Vector2d focal =
        searched_focal(planes, std::hypot(image_size.width, image_size.height), principal);
    CameraStart start;
    start.camera.width = image_size.width;
    start.camera.height = image_size.height;
    start.camera.intrinsics = {focal.x(), focal.y(), principal.x(), principal.y()};
    for (std::size_t i = 0; i < views.size(); ++i) {
        std::vector<Eigen::Vector2d> normalised;
        for (const Eigen::Vector2d& pixel : views[i].pixels)
            normalised.push_back((pixel - principal).cwiseQuotient(focal));
        const auto pose = pose_from_homography(views[i].points_mm, normalised);
        if (!pose)
            throw NumericalError(fmt::format("view {}: no pose to start from", i));
        start.camera_from_target.push_back(*pose);
    }
    return start;
}

}  // namespace etalon
