// Projection of camera-frame points to pixels with its Jacobian, and the exact inverse: onto the
// projection's plane (calib/camera/lens_projection.h; telecentric in mm, with coefficients per
// mm^2, mm^4, ...), OpenCV's distortion, then the intrinsics. Nothing outside the region around the
// axis where that is invertible (calib/camera/valid_region.h).
//
// Immutable after construction, safe from every thread. Construction costs 0.05 ms for a radial
// distortion and some milliseconds otherwise; project() tens, unproject() hundreds of ns.
#pragma once

#include <Eigen/Geometry>

#include "calib/camera/distortion.h"
#include "calib/camera/valid_region.h"

namespace etalon {

// The tangent of the angle to which normalised coordinates stand for the rays of a wide lens.
inline constexpr double wide_limit = 5.671;  // 80 degrees

struct Projected {
    Eigen::Vector2d pixel;
    Eigen::Matrix<double, 2, 3> jacobian;  // d pixel / d p_camera, px/mm
};

class Projector {
public:
    // Throws NumericalError for numbers that are not finite, fx or fy not positive, an impossible
    // projection, or a sensor tilt of a camera that is not perspective.
    explicit Projector(const CameraModel& camera);

    // A camera that differs from `like` by little: it takes the border of the valid region from
    // there, so that it costs next to nothing.
    Projector(const CameraModel& camera, const Projector& like);

    // A wide lens's camera in a frame that is turned about its centre: p_camera and rays are `turn`
    // times what they were, angles are those to the new axis (docs/rendering.md).
    Projector turned(const Eigen::Quaterniond& turn) const;
    // The optical axis in that frame; (0, 0, 1) if it was not turned.
    Eigen::Vector3d axis() const { return turn_.col(2); }

    // Nothing when the projection has no image of the point (of a flat one: z <= 0), when it is
    // outside the valid region, or not finite. The pixel may lie outside the image.
    std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& p_camera) const;
    std::optional<Projected> project_with_jacobian(const Eigen::Vector3d& p_camera) const;

    // The undistorted point of the plane: damped Newton inside the valid region, right to 1e-12
    // relative to radius plus a pixel. Nothing where the pixel has no preimage (some us).
    std::optional<Eigen::Vector2d> undistorted(const Eigen::Vector2d& pixel) const;

    // The ray of a pixel, of length 1 or, of a flat projection, with Z = 1 (telecentric: X and Y in
    // mm). Nothing where undistorted() or the projection has none.
    std::optional<Eigen::Vector3d> ray(const Eigen::Vector2d& pixel) const;

    // Normalised coordinates of the ray: (X/Z, Y/Z), telecentric (X, Y). Nothing also for a ray of
    // a wide lens more than 80 degrees from the axis (wide_limit), where they run away.
    std::optional<Eigen::Vector2d> unproject(const Eigen::Vector2d& pixel) const;

    // The same sooner, from a guess near it (of any quality).
    std::optional<Eigen::Vector2d> unproject(const Eigen::Vector2d& pixel,
                                             const Eigen::Vector2d& near) const;

    // d pixel / d such coordinates, at coordinates of which unproject() has a pixel.
    Eigen::Matrix2d pixel_by_normalised(const Eigen::Vector2d& normalised) const;

    // Whether an undistorted point of the plane is inside the valid region.
    bool is_valid(const Eigen::Vector2d& undistorted) const;

    // Radius of the valid region's border in the direction of this point; infinity where there is
    // none. With a projection that has a table it is searched (some 10 us), to 1e3 at most.
    double border(const Eigen::Vector2d& direction) const;

    const CameraModel& camera() const { return camera_; }
    const ValidRegion& valid_region() const { return region_; }

private:
    Projector(const CameraModel& camera, ValidRegion region);
    std::optional<Distorted> distorted(const Eigen::Vector2d& undistorted) const;
    bool has_ray(const Eigen::Vector2d& undistorted) const;
    bool is_accepted(const Eigen::Vector2d& solution) const;
    // Whether or not a projection with a table has a ray there, which costs its inverse.
    std::optional<Eigen::Vector2d> on_plane(const Eigen::Vector2d& pixel,
                                            const Eigen::Vector2d* near) const;
    std::optional<Eigen::Vector3d> ray_of(const std::optional<Eigen::Vector2d>& point) const;
    std::optional<Eigen::Vector2d> untilted(const Eigen::Vector2d& distorted) const;
    std::optional<Eigen::Vector2d> solve(const Eigen::Vector2d& target,
                                         const Eigen::Vector2d& start) const;
    std::optional<Eigen::Vector2d> solve_along_ray(const Eigen::Vector2d& target) const;

    CameraModel camera_;
    bool has_distortion_, has_tilt_;  // a skew counts as both
    Eigen::Matrix3d tilt_, untilt_;
    Eigen::Matrix3d turn_ = Eigen::Matrix3d::Identity();  // of a wide lens: see turned()
    double pixel_size_;  // of one pixel in normalised coordinates, the larger of x and y
    ValidRegion region_;
};

// How far away a point of the camera's frame is for focus: along the axis, of a wide lens along the
// line of sight.
double depth_mm(const LensProjection& projection, const Eigen::Vector3d& p_camera);

// Rays (Projector::ray()) about a camera, seen by one that looks their way: as points of a plane,
// for the closed forms of a plane's pose.

// Turns the rays' mean into the axis.
Eigen::Quaterniond rotation_to_mean_direction(const std::vector<Eigen::Vector3d>& rays);

struct VisibleProjection {
    std::vector<std::size_t> kept;        // which rays are less than 80 degrees from the axis then
    std::vector<Eigen::Vector2d> points;  // their X/Z and Y/Z
};
VisibleProjection seen_across(const Eigen::Quaterniond& turn,
                              const std::vector<Eigen::Vector3d>& rays);

}  // namespace etalon
