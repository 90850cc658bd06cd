#include "sim/scene/scene.h"

#include <fmt/format.h>

#include <array>
#include <limits>
#include <numbers>

#include "calib/camera/projector.h"
#include "core/errors.h"
#include "sim/scene/marker_view.h"

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

// A marker's corners as the lens centre sees them: undistorted (x, y), and the inverse depth by
// which they move when seen from another point of the lens; telecentric (X, Y) and the depth.
using Corners = std::array<Eigen::Vector3d, 4>;

Corners seen_corners(const PlacedMarker& marker, Projection projection, std::size_t number) {
    Corners seen = corners_mm(marker.grid);
    for (Eigen::Vector3d& corner : seen) {
        corner = marker.camera_from_marker * corner;
        if (!(corner.z() > 0.0))
            throw NumericalError(fmt::format("marker {} reaches behind the lens (depth {:.6g} mm)",
                                             number, corner.z()));
        if (projection != Projection::telecentric)
            corner = {corner.x() / corner.z(), corner.y() / corner.z(), 1.0 / corner.z()};
    }
    return seen;
}

Outline outline_in_focus_at(double focus, const Corners& seen, double lens_radius) {
    Outline outline;
    for (std::size_t i = 0; i < 4; ++i) {
        outline.corners[i] = seen[i].head<2>();
        outline.radius[i] = lens_radius * std::abs(seen[i].z() - focus);
    }
    return outline;
}

// A ray is told by its lens point and by where it meets some plane across the axis, in focus or
// not. Rays that meet the marker's point at (x, y) with the inverse depth w cross the plane of
// inverse depth `focus` within d/2 |w - focus| of (x, y): a disk whose radius is convex over the
// marker's image, so that all disks lie in the hull of the corners'. Where the hulls of two markers
// are apart for one such plane, no ray meets both. The plane between the markers is a good one.
bool no_ray_meets_both(const Corners& a, const Corners& b, double lens_radius) {
    double low = a[0].z(), high = low;
    for (const Corners* corners : {&a, &b})
        for (const Eigen::Vector3d& corner : *corners) {
            low = std::min(low, corner.z());
            high = std::max(high, corner.z());
        }
    const double focus = 0.5 * (low + high);
    return apart(outline_in_focus_at(focus, a, lens_radius),
                 outline_in_focus_at(focus, b, lens_radius), 0.0);
}

// Size on the marker of a part of a pixel at its nearest corner, mm.
double seam_mm(const PlacedMarker& marker, const CameraModel& camera) {
    double depth = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector3d& corner : corners_mm(marker.grid))
        depth = std::min(depth, (marker.camera_from_marker * corner).z());
    const double per_mm = std::max(camera.intrinsics.fx, camera.intrinsics.fy);
    return allowed_seam_px / per_mm *
           (camera.projection.kind == Projection::telecentric ? 1.0 : depth);
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

void check_reach(const Scene& scene, const CameraModel& camera) {
    if (camera.projection.is_flat())
        return;
    for (const PlacedMarker& marker : scene.markers)
        for (const Eigen::Vector3d& corner : corners_mm(marker.grid)) {
            const Eigen::Vector3d p = marker.camera_from_marker * corner;
            if (!(p.head<2>().norm() < wide_limit * p.z()))
                throw NumericalError(
                    "a marker reaches more than 80 degrees from the axis: wide "
                    "lenses are rendered up to there");
        }
}

void check_no_occlusion(const Scene& scene, const CameraModel& camera) {
    const double lens_radius = aperture_of(camera).radius_mm;
    std::vector<Corners> seen;
    for (const PlacedMarker& marker : scene.markers)
        seen.push_back(seen_corners(marker, camera.projection.kind, seen.size() + 1));
    for (std::size_t j = 1; j < seen.size(); ++j)
        for (std::size_t i = 0; i < j; ++i)
            if (!no_ray_meets_both(seen[i], seen[j], lens_radius) &&
                !side_by_side(scene.markers[i], scene.markers[j],
                              seam_mm(scene.markers[i], camera)))
                throw NumericalError(fmt::format(
                    "the images of markers {} and {} overlap, and the markers do not lie side by "
                    "side in one plane: one may hide the other",
                    i + 1, j + 1));
}

}  // namespace etalon
