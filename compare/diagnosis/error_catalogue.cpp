#include "compare/diagnosis/error_catalogue.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>

namespace etalon {
namespace {

template <class Shape>
void bend(ObjectPoints& points, double size_mm, const Shape& shape) {
    double highest = 0.0;
    for (const Eigen::Vector3d& point : points)
        highest = std::max(highest, std::abs(shape(point)));
    for (Eigen::Vector3d& point : points)
        point.z() += highest > 0.0 ? size_mm * (shape(point) / highest) : 0.0;
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

ImagePoints edges_moved_inwards(const ImagePoints& corners, double by_px) {
    if (corners.size() != 4)
        throw NumericalError(fmt::format("edges of a square: {} corners", corners.size()));
    const auto corner = [&](std::size_t k) { return corners[k % 4]; };
    const Eigen::Vector2d centre = (corner(0) + corner(1) + corner(2) + corner(3)) / 4.0;
    const auto inward_normal = [&](std::size_t k) {
        const Eigen::Vector2d edge = (corner(k + 1) - corner(k)).normalized();
        const Eigen::Vector2d normal(-edge.y(), edge.x());
        return Eigen::Vector2d(normal.dot(centre - corner(k)) < 0.0 ? -normal : normal);
    };
    ImagePoints moved;
    for (std::size_t k = 0; k < 4; ++k) {
        Eigen::Matrix2d normals;
        normals << inward_normal(k + 3).transpose(), inward_normal(k).transpose();
        moved.push_back(corner(k) + normals.inverse() * Eigen::Vector2d(by_px, by_px));
    }
    return moved;
}

void TrueMarker::scale(double factor) {
    for (Eigen::Vector3d& point : points_mm)
        point *= factor;
}

void TrueMarker::twist(double size_mm) {
    bend(points_mm, size_mm, [](const Eigen::Vector3d& p) { return p.x() * p.y(); });
}

void TrueMarker::bow(double size_mm) {
    bend(points_mm, size_mm, [](const Eigen::Vector3d& p) { return p.head<2>().squaredNorm(); });
}

ImagePoints TrueMarker::seen(const Projector& projector, Rigid camera_from_marker) const {
    camera_from_marker.translation += offset_mm;
    ImagePoints corners = projected(projector, points_mm, camera_from_marker);
    for (Eigen::Vector2d& corner : corners)
        corner += corner_shift_px;
    return edges_inwards_px == 0.0 ? corners : edges_moved_inwards(corners, edges_inwards_px);
}

std::vector<MarkerError> marker_errors(std::size_t points) {
    using Marker = TrueMarker;
    const bool is_single_tag = points == 4;
    const Eigen::Vector3d offset = Eigen::Vector3d(2, -3, 6) / 7.0;  // along no axis
    std::vector<MarkerError> errors = {
        {"marker print size", "1", 1e-3, [](Marker& m, double by) { m.scale(1.0 + by); }},
        {"half pixel", "px", 0.5, [](Marker& m, double by) { m.corner_shift_px.array() += by; }}};
    if (is_single_tag)  // a chessboard's corners do not move with its edges
        errors.push_back(
            {"edge shrink", "px", 0.1, [](Marker& m, double by) { m.edges_inwards_px += by; }});
    errors.push_back({"marker twist", "mm", 0.1, [](Marker& m, double by) { m.twist(by); }});
    if (!is_single_tag)  // whose corners a bow lifts all alike
        errors.push_back({"marker bow", "mm", 0.1, [](Marker& m, double by) { m.bow(by); }});
    errors.push_back({"constant pose offset", "mm", 0.1,
                      [offset](Marker& m, double by) { m.offset_mm += by * offset; }});
    return errors;
}

Eigen::VectorXd NamedError::motion(std::size_t poses, std::optional<double> at) const {
    Eigen::VectorXd all;
    for (std::size_t i = 0; i < poses; ++i) {
        Eigen::VectorXd moved;
        if (one_sided)
            moved = pixels(i, size) - pixels(i, 0.0);
        else if (at)
            moved = size / *at * (pixels(i, *at) - pixels(i, 0.0));
        else
            moved = 0.5 * (pixels(i, size) - pixels(i, -size));
        if (i == 0)
            all.resize(static_cast<Eigen::Index>(poses) * moved.size());
        all.segment(static_cast<Eigen::Index>(i) * moved.size(), moved.size()) = moved;
    }
    return all;
}

NamedError named_error(const SignatureChain& chain, const CameraError& error) {
    return {error.name, error.unit, error.size,
            [&chain, change = error.change](std::size_t pose, double by) {
                CameraModel camera = chain.projector.camera();
                change(camera, by);
                return stacked(projected(Projector(camera, chain.projector), chain.points_mm,
                                         chain.camera_from_marker(pose)));
            }};
}

NamedError named_error(const SignatureChain& chain, const StageError& error) {
    if (error.base_from_carriage.size() != chain.poses.size() || !std::isfinite(error.size) ||
        error.size == 0.0)
        throw NumericalError(fmt::format(
            "error signatures: '{}' needs a size and one transform per pose", error.name));
    const auto moved = [&chain, transforms = error.base_from_carriage](std::size_t pose,
                                                                       double by) {
        const Rigid& carriage = by == 0.0 ? chain.poses[pose].base_from_carriage : transforms[pose];
        return stacked(projected(chain.projector, chain.points_mm,
                                 chain.camera_from_base * carriage * chain.carriage_from_marker));
    };
    return {error.name, error.unit, error.size, moved, true};
}

std::vector<NamedError> named_errors(const SignatureChain& chain,
                                     std::span<const StageError> stage_errors) {
    std::vector<NamedError> errors;
    for (const CameraError& error : named_camera_errors(chain.projector.camera()))
        errors.push_back(named_error(chain, error));
    for (const MarkerError& error : marker_errors(chain.points_mm.size()))
        errors.push_back({error.name, error.unit, error.size,
                          [&chain, change = error.change](std::size_t pose, double by) {
                              TrueMarker marker{chain.points_mm};
                              change(marker, by);
                              return stacked(
                                  marker.seen(chain.projector, chain.camera_from_marker(pose)));
                          }});
    for (const StageError& error : stage_errors)
        errors.push_back(named_error(chain, error));
    return errors;
}

std::vector<NamedError> further_errors(const SignatureChain& chain) {
    std::vector<NamedError> errors;
    for (const CameraError& error : further_camera_errors(chain.projector.camera()))
        errors.push_back(named_error(chain, error));
    errors.push_back({"skew", "1", 1e-3, [&chain](std::size_t pose, double by) {
                          const double middle = chain.projector.camera().intrinsics.cy;
                          Eigen::VectorXd pixels = stacked(projected(
                              chain.projector, chain.points_mm, chain.camera_from_marker(pose)));
                          for (Eigen::Index k = 0; k < pixels.size(); k += 2)
                              pixels[k] += by * (pixels[k + 1] - middle);
                          return pixels;
                      }});
    return errors;
}

}  // namespace etalon
