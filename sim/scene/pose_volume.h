// The six-dimensional volume of a marker study: low-discrepancy points (sim/scene/pose_sampling.h)
// at which the whole marker is seen. Rejected points leave holes: strata are exact only without.
#pragma once

#include "calib/camera/projector.h"
#include "core/geometry/rigid.h"
#include "sim/marker/cell_grid.h"
#include "sim/scene/pose_sampling.h"

namespace etalon {

// Both ends included; equal ends: a fixed value.
struct Interval {
    double low = 0.0, high = 0.0;

    bool is_fixed() const { return low == high; }
    // Uniform for u uniform in [0, 1); a fixed value exactly.
    double at(double u) const { return std::min(low + u * (high - low), high); }
};

// The marker's origin in the camera frame, mm, and R = Rz(yaw) Ry(pitch) Rx(roll), rad
// (core/geometry/rigid.h), each uniform in its interval. x or y not given covers what is seen at
// that depth: without both the origin's pixel is uniform, with x (y) alone its row (column).
struct PoseVolume {
    std::optional<Interval> x_mm = {}, y_mm = {};
    Interval z_mm;
    Interval roll, pitch, yaw;
    double margin_px = 0.0;  // of the marker's outline to the image's border (is_in_view())
};

// Not safe from several threads, but the same arguments give the same poses everywhere, and a
// longer list begins with a shorter one. Keeps no poses: memory does not grow.
class PoseSampler {
public:
    struct Sample {
        std::uint64_t index;  // of the point in the sequence; gaps are points left out
        Rigid camera_from_marker;
        std::vector<double> extra;  // in [0, 1), one per extra dimension
    };

    // Poses at which every one of the grids is in view. The sequence's dimensions are the moving
    // axes, in the order x, y, z, roll, pitch, yaw, then `extra_dimensions` for what is sampled
    // with the pose; at most 16. Fixing an axis changes the others' values. Throws ConfigError with
    // the axis as key (z_mm, roll, ...) for an impossible interval, a depth not positive, an angle
    // beyond +-2 pi, and margin_px below 0 or not finite; NumericalError without a grid, for
    // impossible dimensions, and as Projector does.
    PoseSampler(const CameraModel& camera, std::span<const CellGrid> grids,
                const PoseVolume& volume, SequenceKind kind, std::uint64_t seed,
                int extra_dimensions = 0);

    // Throws NumericalError when one point in a thousand or less fits (of ten thousand). A point
    // tried costs about 1 us, and 1 us for each grid (2 us with distortion).
    Sample next();

private:
    std::optional<Sample> sample(std::uint64_t index) const;
    std::optional<Eigen::Vector3d> position(const std::array<double, 6>& u) const;

    Projector projector_;
    PoseVolume volume_;
    std::vector<CellGrid> grids_;
    std::array<bool, 6> moves_;  // by axis
    std::ptrdiff_t extra_dimensions_;
    PointSequence sequence_;
    std::uint64_t points_ = 0, seen_ = 0;
};

// Poses that fill what a camera can see of a marker: Halton points, the outline 20 px from the
// border, all of the lens seeing its front. The same arguments give the same poses; longer lists
// begin with shorter ones. Both throw NumericalError when one draw in a thousand or less fits.

// What the camera sees between two depths of the grid's centre, mm, with tilts up to max_tilt, rad.
struct SeenVolume {
    double nearest_mm = 150.0, farthest_mm = 1500.0;  // from near focus to far
    double max_tilt = 1.2217304763960306;             // 70 degrees
};

// Depth uniform, tilt uniform about any axis in the image plane, any turn in the marker's plane,
// the centre anywhere in the image.
std::vector<Rigid> volume_poses(const CameraModel& camera, const CellGrid& grid, int count,
                                std::uint64_t seed, const SeenVolume& volume = {});

// The volume of the published comparison of detectors (FMAC, 10 000 images): depth uniform from 500
// to 1500 mm, R = Rz(yaw) Ry(pitch) Rx(roll) with roll and pitch uniform within +-45 degrees and
// any yaw, the marker's origin anywhere in the image.
std::vector<Rigid> study_poses(const CameraModel& camera, const CellGrid& grid, int count,
                               std::uint64_t seed);

}  // namespace etalon
