#include "compare/diagnosis/error_catalogue.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "compare/pose/pose_bias.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

using Points = std::vector<Eigen::Vector3d>;

Eigen::VectorXd stacked_projections(const Projector& projector, const Points& points,
                                    const Rigid& camera_from_marker) {
    const auto pixels = projected(projector, points, camera_from_marker);
    return Eigen::Map<const Eigen::VectorXd>(pixels.front().data(), 2 * std::ssize(pixels));
}

Eigen::VectorXd moved_inwards(const Eigen::VectorXd& square, double by_px) {
    std::vector<Eigen::Vector2d> corners;
    for (int k = 0; k < 4; ++k)
        corners.push_back(square.segment<2>(2 * k));
    Eigen::VectorXd moved(8);
    Eigen::Index k = 0;
    for (const Eigen::Vector2d& corner : edges_moved_inwards(corners, by_px))
        moved.segment<2>(2 * k++) = corner;
    return moved;
}

// How far the image reaches on a wide lens's plane, at least 1: a coefficient of r^n does r^n times
// as much there, and could fold it. Of a flat camera 1.
double plane_reach(const CameraModel& camera) {
    double reach = 1.0;
    if (camera.projection.is_flat())
        return reach;
    const Intrinsics& i = camera.intrinsics;
    for (const double x : {0, camera.width})
        for (const double y : {0, camera.height})
            reach = std::max(reach, std::hypot((x - i.cx) / i.fx, (y - i.cy) / i.fy));
    return reach;
}

CameraError coefficient_error(const char* name, const char* unit, double size,
                              double Distortion::*term) {
    return {name, unit, size, [term](CameraModel& c, double by) { c.distortion.*term += by; }};
}

// Of the projection's own parameters, those that can be off both ways.
void add_projection_errors(const LensProjection& projection, std::vector<CameraError>& errors) {
    constexpr double size = 1e-3;
    double LensProjection::*const parameters[] = {&LensProjection::a, &LensProjection::b};
    for (std::size_t i = 0; i < 2; ++i) {
        const auto parameter = parameters[i];
        const char* name = name_of(projection.kind).parameters[i];
        LensProjection less = projection, more = projection;
        less.*parameter -= size;
        more.*parameter += size;
        if (*name && is_possible(less) && is_possible(more))
            errors.push_back({name, "", size, [parameter](CameraModel& c, double by) {
                                  c.projection.*parameter += by;
                              }});
    }
}

}  // namespace

Eigen::MatrixXd SignatureChain::pose_jacobian(std::size_t pose) const {
    return registration_jacobian(projector, points_mm, camera_from_marker(pose), Rigid{}, Rigid{})
        .leftCols<6>();
}

std::vector<CameraError> named_camera_errors(const CameraModel& camera) {
    using Camera = CameraModel;
    const double reach2 = std::pow(plane_reach(camera), 2);
    std::vector<CameraError> errors = {
        {"focal length", "1", 1e-3, [](Camera& c, double by) { c.intrinsics.zoom(1.0 + by); }},
        {"c_x", "px", 0.1, [](Camera& c, double by) { c.intrinsics.cx += by; }},
        {"c_y", "px", 0.1, [](Camera& c, double by) { c.intrinsics.cy += by; }},
        coefficient_error("k1", "", 1e-3 / reach2, &Distortion::k1),
        coefficient_error("k2", "", 1e-3 / std::pow(reach2, 2), &Distortion::k2),
        coefficient_error("k3", "", 1e-3 / std::pow(reach2, 3), &Distortion::k3),
        coefficient_error("p1", "", 1e-4, &Distortion::p1),
        coefficient_error("p2", "", 1e-4, &Distortion::p2),
    };
    if (camera.projection.is_flat())
        return errors;
    errors.push_back(coefficient_error("k7", "", 1e-3 / std::pow(reach2, 4), &Distortion::k7));
    add_projection_errors(camera.projection, errors);
    return errors;
}

std::vector<CameraError> further_camera_errors(const CameraModel& camera) {
    const double reach2 = std::pow(plane_reach(camera), 2);
    std::vector<CameraError> errors = {
        {"aspect of fx, fy", "1", 1e-3,
         [](CameraModel& c, double by) { c.intrinsics.fy *= 1.0 + by; }},
        coefficient_error("k4", "", 1e-3 / reach2, &Distortion::k4),
        coefficient_error("k5", "", 1e-3 / std::pow(reach2, 2), &Distortion::k5),
        coefficient_error("k6", "", 1e-3 / std::pow(reach2, 3), &Distortion::k6),
        coefficient_error("thin prism s1", "", 1e-4, &Distortion::s1),
        coefficient_error("thin prism s2", "", 1e-4, &Distortion::s2),
        coefficient_error("thin prism s3", "", 1e-4, &Distortion::s3),
        coefficient_error("thin prism s4", "", 1e-4, &Distortion::s4)};
    if (camera.projection.is_flat()) {
        errors.push_back(coefficient_error("sensor tilt tau_x", "rad", 1e-3, &Distortion::tau_x));
        errors.push_back(coefficient_error("sensor tilt tau_y", "rad", 1e-3, &Distortion::tau_y));
    }
    return errors;
}

std::vector<Eigen::Vector2d> edges_moved_inwards(const std::vector<Eigen::Vector2d>& corners,
                                                 double by_px) {
    if (corners.size() != 4)
        throw NumericalError(fmt::format("edges of a square: {} corners", corners.size()));
    const auto corner = [&](std::size_t k) { return corners[k % 4]; };
    const Eigen::Vector2d centre = (corner(0) + corner(1) + corner(2) + corner(3)) / 4.0;
    const auto inward_normal = [&](std::size_t k) {
        const Eigen::Vector2d edge = (corner(k + 1) - corner(k)).normalized();
        const Eigen::Vector2d normal(-edge.y(), edge.x());
        return Eigen::Vector2d(normal.dot(centre - corner(k)) < 0.0 ? -normal : normal);
    };
    std::vector<Eigen::Vector2d> moved;
    for (std::size_t k = 0; k < 4; ++k) {
        Eigen::Matrix2d normals;
        normals << inward_normal(k + 3).transpose(), inward_normal(k).transpose();
        moved.push_back(corner(k) + normals.inverse() * Eigen::Vector2d(by_px, by_px));
    }
    return moved;
}

Eigen::Vector3d pose_offset_direction() {
    return Eigen::Vector3d(2, -3, 6) / 7.0;
}

Eigen::VectorXd NamedError::displacement(std::size_t pose) const {
    return one_sided ? Eigen::VectorXd(pixels(pose, size) - pixels(pose, 0.0))
                     : Eigen::VectorXd(0.5 * (pixels(pose, size) - pixels(pose, -size)));
}

Eigen::VectorXd NamedError::secant(std::size_t pose, double at) const {
    if (one_sided)
        return displacement(pose);
    return size / at * (pixels(pose, at) - pixels(pose, 0.0));
}

NamedErrors::NamedErrors(const SignatureChain& chain) : chain_(chain) {
    for (std::size_t i = 0; i < chain.poses.size(); ++i)
        truth_.push_back(chain.camera_from_marker(i));
}

std::vector<NamedError> NamedErrors::with_signatures(
    std::span<const StageError> stage_errors) const {
    std::vector<NamedError> errors;
    for (const CameraError& error : named_camera_errors(chain_.projector.camera()))
        errors.push_back(camera_error(error));
    for (NamedError& error : marker_errors())
        errors.push_back(std::move(error));
    for (const StageError& error : stage_errors)
        errors.push_back(stage_error(error));
    return errors;
}

std::vector<NamedError> NamedErrors::further() const {
    std::vector<NamedError> errors;
    for (const CameraError& error : further_camera_errors(chain_.projector.camera()))
        errors.push_back(camera_error(error));
    errors.push_back({"skew", "1", 1e-3, [this](std::size_t pose, double by) {
                          const double middle = chain_.projector.camera().intrinsics.cy;
                          Eigen::VectorXd pixels = nominal(pose);
                          for (Eigen::Index k = 0; k < pixels.size(); k += 2)
                              pixels[k] += by * (pixels[k + 1] - middle);
                          return pixels;
                      }});
    return errors;
}

NamedError NamedErrors::camera_error(const CameraError& error) const {
    return {error.name, error.unit, error.size,
            [this, change = error.change](std::size_t pose, double by) {
                CameraModel camera = chain_.projector.camera();
                change(camera, by);
                return stacked_projections(Projector(camera, chain_.projector), chain_.points_mm,
                                           truth_[pose]);
            }};
}

NamedError NamedErrors::stage_error(const StageError& error) const {
    if (error.base_from_carriage.size() != truth_.size() || !std::isfinite(error.size) ||
        error.size == 0.0)
        throw NumericalError(fmt::format(
            "error signatures: '{}' needs a size and one transform per pose", error.name));
    const auto moved = [this, transforms = error.base_from_carriage](std::size_t pose, double by) {
        return by == 0.0 ? nominal(pose)
                         : stacked_projections(chain_.projector, chain_.points_mm,
                                               chain_.camera_from_base * transforms[pose] *
                                                   chain_.carriage_from_marker);
    };
    return {error.name, error.unit, error.size, moved, true};
}

std::vector<NamedError> NamedErrors::marker_errors() const {
    std::vector<NamedError> errors;
    errors.push_back({"marker print size", "1", 1e-3, [this](std::size_t pose, double by) {
                          Points points = chain_.points_mm;
                          for (Eigen::Vector3d& point : points)
                              point *= 1.0 + by;
                          return stacked_projections(chain_.projector, points, truth_[pose]);
                      }});
    errors.push_back({"half pixel", "px", 0.5, [this](std::size_t pose, double by) {
                          return Eigen::VectorXd(nominal(pose).array() + by);
                      }});
    if (chain_.points_mm.size() == 4)  // the corners of a square; a chessboard's do not move
        errors.push_back({"edge shrink", "px", 0.1, [this](std::size_t pose, double by) {
                              return moved_inwards(nominal(pose), by);
                          }});
    errors.push_back(
        out_of_plane("marker twist", [](const Eigen::Vector3d& p) { return p.x() * p.y(); }));
    if (chain_.points_mm.size() != 4)  // a bow lifts the corners of a square all alike
        errors.push_back(out_of_plane(
            "marker bow", [](const Eigen::Vector3d& p) { return p.head<2>().squaredNorm(); }));
    errors.push_back({"constant pose offset", "mm", 0.1, [this](std::size_t pose, double by) {
                          Rigid moved = truth_[pose];
                          moved.translation += by * pose_offset_direction();
                          return stacked_projections(chain_.projector, chain_.points_mm, moved);
                      }});
    return errors;
}

// The marker's points stand out of its plane by `shape`, scaled to the size at the highest one.
NamedError NamedErrors::out_of_plane(
    std::string name, const std::function<double(const Eigen::Vector3d&)>& shape) const {
    double highest = 0.0;
    for (const Eigen::Vector3d& point : chain_.points_mm)
        highest = std::max(highest, std::abs(shape(point)));
    Points lifted;
    for (const Eigen::Vector3d& point : chain_.points_mm)
        lifted.emplace_back(0.0, 0.0, highest > 0.0 ? shape(point) / highest : 0.0);
    return {std::move(name), "mm", 0.1, [this, lifted](std::size_t pose, double by) {
                Points points = chain_.points_mm;
                for (std::size_t k = 0; k < points.size(); ++k)
                    points[k] += by * lifted[k];
                return stacked_projections(chain_.projector, points, truth_[pose]);
            }};
}

Eigen::VectorXd NamedErrors::nominal(std::size_t pose) const {
    return stacked_projections(chain_.projector, chain_.points_mm, truth_[pose]);
}

}  // namespace etalon
