#include "sim/scene/scene.h"

#include <fmt/format.h>

#include "core/program/errors.h"
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

std::array<Eigen::Vector3d, 4> corners_in_camera(const PlacedMarker& marker) {
    std::array<Eigen::Vector3d, 4> corners = corners_mm(marker.grid);
    for (Eigen::Vector3d& corner : corners)
        corner = marker.camera_from_marker * corner;
    return corners;
}

std::vector<Eigen::Vector3d> corner_rays(const PlacedMarker& marker) {
    std::vector<Eigen::Vector3d> rays;
    for (const Eigen::Vector3d& corner : corners_in_camera(marker))
        rays.push_back(corner.normalized());
    return rays;
}

Corners seen_corners(const PlacedMarker& marker, Projection projection) {
    Corners seen = corners_in_camera(marker);
    if (projection != Projection::telecentric)
        for (Eigen::Vector3d& corner : seen)
            corner = {corner.x() / corner.z(), corner.y() / corner.z(), 1.0 / corner.z()};
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

// Rays that meet the marker's point at (x, y) with the inverse depth w cross the plane of inverse
// depth `focus` within d/2 |w - focus| of (x, y): a disk whose radius is convex over the marker's
// image, so that all disks lie in the hull of the corners'. Where the hulls of two markers are
// apart for one such plane, no ray meets both. The plane between the markers is a good one.
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

bool is_within_reach(const PlacedMarker& marker) {
    const auto corners = corners_in_camera(marker);
    return std::ranges::all_of(
        corners, [](const Eigen::Vector3d& p) { return p.head<2>().norm() < wide_limit * p.z(); });
}

// All rays by which a wide lens may see a marker, as a cone: twice the blur of a point at the
// nearest corner and at the focus, which are more than any between.
struct ViewCone {
    Eigen::Vector3d axis;
    double half_angle = 0.0;

    ViewCone(const PlacedMarker& marker, const Aperture& aperture)
        : axis(rotation_to_mean_direction(corner_rays(marker)).conjugate() *
               Eigen::Vector3d::UnitZ()) {
        double nearness = aperture.focus_on_axis;
        for (const Eigen::Vector3d& corner : corners_in_camera(marker)) {
            half_angle =
                std::max(half_angle, std::acos(std::min(1.0, axis.dot(corner.normalized()))));
            nearness = std::max(nearness, 1.0 / corner.norm());
        }
        half_angle += 2.0 * aperture.radius_mm * nearness;
    }
};

// Of a wide lens, in a frame that looks at both. What the pupil's disk is longer than round there,
// |(x, 1)|, the radius is taken larger.
bool wide_lens_sees_both_by_no_ray(const PlacedMarker& a, const PlacedMarker& b,
                                   const Aperture& aperture) {
    const ViewCone around_a(a, aperture), around_b(b, aperture);
    const double apart = std::acos(std::clamp(around_a.axis.dot(around_b.axis), -1.0, 1.0));
    if (apart > around_a.half_angle + around_b.half_angle)
        return true;
    std::vector<Eigen::Vector3d> rays = corner_rays(a);
    for (const Eigen::Vector3d& ray : corner_rays(b))
        rays.push_back(ray);
    const Eigen::Quaterniond turn = rotation_to_mean_direction(rays);
    const PlacedMarker seen_a = turned(a, turn), seen_b = turned(b, turn);
    if (!is_within_reach(seen_a) || !is_within_reach(seen_b))
        return false;
    double longest = 1.0;
    for (const Eigen::Vector3d& ray : rays)
        longest = std::max(longest, 1.0 / (turn * ray).z());
    return no_ray_meets_both(seen_corners(seen_a, Projection::perspective),
                             seen_corners(seen_b, Projection::perspective),
                             1.1 * longest * aperture.radius_mm);
}

// Size on the marker of a part of a pixel at its nearest corner, mm.
double seam_mm(const PlacedMarker& marker, const CameraModel& camera) {
    double depth = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector3d& corner : corners_in_camera(marker))
        depth = std::min(depth, camera.projection.is_flat() ? corner.z() : corner.norm());
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

Eigen::Quaterniond turn_towards(const PlacedMarker& marker, const CameraModel& camera) {
    return camera.projection.is_flat() ? Eigen::Quaterniond::Identity()
                                       : rotation_to_mean_direction(corner_rays(marker));
}

PlacedMarker turned(const PlacedMarker& marker, const Eigen::Quaterniond& turn) {
    const Rigid& pose = marker.camera_from_marker;
    return {marker.grid, {(turn * pose.rotation).normalized(), turn * pose.translation}};
}

void check_reach(const Scene& scene, const CameraModel& camera) {
    if (camera.projection.is_flat())
        return;
    for (const PlacedMarker& marker : scene.markers)
        if (!is_within_reach(turned(marker, turn_towards(marker, camera))))
            throw NumericalError(
                "a marker reaches more than 80 degrees from the direction of its middle: markers "
                "are rendered up to there");
}

void check_no_occlusion(const Scene& scene, const CameraModel& camera) {
    const Aperture aperture = aperture_of(camera);
    const std::vector<PlacedMarker>& markers = scene.markers;
    std::vector<Corners> seen;
    for (std::size_t i = 0; camera.projection.is_flat() && i < markers.size(); ++i) {
        for (const Eigen::Vector3d& corner : corners_in_camera(markers[i]))
            if (!(corner.z() > 0.0))
                throw NumericalError(fmt::format(
                    "marker {} reaches behind the lens (depth {:.6g} mm)", i + 1, corner.z()));
        seen.push_back(seen_corners(markers[i], camera.projection.kind));
    }
    const auto no_ray = [&](std::size_t i, std::size_t j) {
        return seen.empty() ? wide_lens_sees_both_by_no_ray(markers[i], markers[j], aperture)
                            : no_ray_meets_both(seen[i], seen[j], aperture.radius_mm);
    };
    for (std::size_t j = 1; j < markers.size(); ++j)
        for (std::size_t i = 0; i < j; ++i)
            if (!no_ray(i, j) && !side_by_side(markers[i], markers[j], seam_mm(markers[i], camera)))
                throw NumericalError(fmt::format(
                    "the images of markers {} and {} overlap, and the markers do not lie side by "
                    "side in one plane: one may hide the other",
                    i + 1, j + 1));
}

}  // namespace etalon
