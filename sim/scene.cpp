#include "sim/scene.h"

#include <array>
#include <limits>
#include <numbers>

#include "calib/camera_model.h"
#include "core/errors.h"
#include "sim/marker_view.h"

namespace etalon {
namespace {

constexpr double allowed_seam_px = 2e-5;

// Four corners around a marker, each the centre of a disk; 0 in the radius for a bare corner.
struct Outline {
    std::array<Eigen::Vector2d, 4> corners;
    std::array<double, 4> radius{};
};

std::array<Eigen::Vector3d, 4> corners_mm(const CellGrid& grid) {
    const int c = grid.columns(), r = grid.rows();
    return {grid.point_mm(0, 0), grid.point_mm(c, 0), grid.point_mm(c, r), grid.point_mm(0, r)};
}

// Space along u between the hulls of the disks of `a` and, farther along u, of `b`.
double gap_along(const Eigen::Vector2d& u, const Outline& a, const Outline& b) {
    double a_ends = -std::numeric_limits<double>::infinity(), b_begins = -a_ends;
    for (std::size_t i = 0; i < 4; ++i) {
        a_ends = std::max(a_ends, u.dot(a.corners[i]) + a.radius[i]);
        b_begins = std::min(b_begins, u.dot(b.corners[i]) - b.radius[i]);
    }
    return b_begins - a_ends;
}

// Whether one of some directions separates the hulls. The edges' own are exact for bare corners;
// those all around find nearly every separation of the hulls of disks.
bool apart(const Outline& a, const Outline& b, double allowed_overlap) {
    const auto separates = [&](const Eigen::Vector2d& u) {
        return gap_along(u, a, b) >= -allowed_overlap || gap_along(-u, a, b) >= -allowed_overlap;
    };
    constexpr int directions = 32;  // the first one and the middle one are bounding boxes
    for (int i = 0; i < directions; ++i) {
        const double angle = std::numbers::pi * (i % 2 * directions / 2 + i / 2) / directions;
        if (separates({std::cos(angle), std::sin(angle)}))
            return true;
    }
    for (const Outline* outline : {&a, &b})
        for (std::size_t i = 0; i < 4; ++i) {
            const Eigen::Vector2d edge = outline->corners[(i + 1) % 4] - outline->corners[i];
            if (edge.norm() > 0.0 && separates(edge.unitOrthogonal()))
                return true;
        }
    return false;
}

// The undistorted sensor points whose rays can meet a marker lie in the hull of these disks. A
// point p of the marker is met by the rays of a disk around p = (X/Z, Y/Z) of the radius
// d/2 |1/Z - 1/z_f|: affine over the marker's image within the bars, thus convex, and nowhere
// outside the hull of the corners' disks. With a tilted sensor 1/z_f changes within the disk, by at
// most d/2 |slope| times its radius: hence the denominator. Telecentric the same with (X, Y) and
// tangents.
Outline seen_outline(const PlacedMarker& marker, const Aperture& aperture, std::size_t number) {
    const double shrink = 1.0 - aperture.radius_mm * aperture.focus_slope.norm();
    const bool telecentric = aperture.projection == Projection::telecentric;
    const auto corners = corners_mm(marker.grid);
    Outline outline;
    for (std::size_t i = 0; i < 4; ++i) {
        const Eigen::Vector3d p = marker.camera_from_marker * corners[i];
        if (!(p.z() > 0.0 && shrink > 0.0))
            throw NumericalError(
                fmt::format("marker {} reaches behind the lens (depth {:.6g} mm)", number, p.z()));
        const double depth = telecentric ? p.z() : 1.0 / p.z();
        outline.corners[i] = telecentric ? p.head<2>() : Eigen::Vector2d(p.head<2>() / p.z());
        outline.radius[i] =
            aperture.radius_mm * std::abs(depth - aperture.focus(outline.corners[i])) / shrink;
    }
    return outline;
}

// Size on the marker of a part of a pixel at its nearest corner, mm.
double seam_mm(const PlacedMarker& marker, const CameraModel& camera) {
    double depth = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector3d& corner : corners_mm(marker.grid))
        depth = std::min(depth, (marker.camera_from_marker * corner).z());
    const double per_mm = std::max(camera.intrinsics.fx, camera.intrinsics.fy);
    return allowed_seam_px / per_mm * (camera.projection == Projection::telecentric ? 1.0 : depth);
}

bool side_by_side(const PlacedMarker& a, const PlacedMarker& b, double seam) {
    const Rigid a_from_b = a.camera_from_marker.inverse() * b.camera_from_marker;
    const auto a_corners = corners_mm(a.grid), b_corners = corners_mm(b.grid);
    Outline in_a, of_b;
    for (std::size_t i = 0; i < 4; ++i) {
        const Eigen::Vector3d p = a_from_b * b_corners[i];
        if (!(std::abs(p.z()) <= seam))
            return false;
        in_a.corners[i] = a_corners[i].head<2>();
        of_b.corners[i] = p.head<2>();
    }
    return apart(in_a, of_b, seam);
}

}  // namespace

void check_no_occlusion(const Scene& scene, const CameraModel& camera) {
    const Aperture aperture = aperture_of(camera);
    std::vector<Outline> seen;
    for (const PlacedMarker& marker : scene.markers)
        seen.push_back(seen_outline(marker, aperture, seen.size() + 1));
    for (std::size_t j = 1; j < seen.size(); ++j)
        for (std::size_t i = 0; i < j; ++i)
            if (!apart(seen[i], seen[j], 0.0) && !side_by_side(scene.markers[i], scene.markers[j],
                                                               seam_mm(scene.markers[i], camera)))
                throw NumericalError(fmt::format(
                    "the images of markers {} and {} overlap, and the markers do not lie side by "
                    "side in one plane: one may hide the other",
                    i + 1, j + 1));
}

}  // namespace etalon
