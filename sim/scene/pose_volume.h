// The six-dimensional volume of a marker study, and its poses: points of a low-discrepancy sequence
// (sim/scene/pose_sampling.h), without those at which the camera would not see the whole marker.
//
// A rejected point leaves a hole that no later one fills. What the camera sees is covered evenly
// all the same, but its strata are exact only where all of the volume is seen.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "calib/camera/camera_model.h"
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

// Position of the marker's origin in the camera frame, mm, and R = Rz(yaw) Ry(pitch) Rx(roll), rad
// (core/geometry/rigid.h). Every axis is uniform in its interval. x or y that is not given
// ranges over all that the camera sees at that depth, uniformly in the image: without both, the
// origin's pixel is uniform in the image area; with x alone, x is uniform in mm and the origin's
// image row uniform in the image, wherever the distortion puts it along the row; with y alone its
// column.
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

    // Poses at which every one of the grids is in view, so that the same serve several markers.
    //
    // The sequence's dimensions are the axes that move, in the order x, y, z, roll, pitch, yaw,
    // then `extra_dimensions` for what is sampled together with the pose (disturbances); at most
    // 16. Fixed axes take none: all sequences are most even in their first dimensions, and those go
    // to axes that use them. Hence fixing an axis changes the others' values too.
    //
    // Throws ConfigError with the axis as key (z_mm, roll, ...) for an interval that is not finite
    // or has its ends swapped, a depth that is not positive and an angle beyond +-2 pi (degrees
    // given by mistake), with margin_px for one that is negative or not finite; NumericalError
    // without a grid, for too many dimensions or fewer than no extra ones, and as Projector does.
    PoseSampler(const CameraModel& camera, std::span<const CellGrid> grids,
                const PoseVolume& volume, SequenceKind kind, std::uint64_t seed,
                int extra_dimensions = 0);

    // Throws NumericalError when one point in a thousand or less fits (of ten thousand). Costs a
    // point of the sequence and about 1 us for every point tried, and 1 us for each grid (2 us with
    // distortion); a grid within another one costs nothing.
    Sample next();

private:
    std::optional<Sample> sample(std::uint64_t index) const;
    std::optional<Eigen::Vector3d> position(const std::array<double, 6>& u) const;

    Projector projector_;
    PoseVolume volume_;
    std::vector<CellGrid> grids_;  // none within another
    std::array<bool, 6> moves_;    // by axis
    std::ptrdiff_t extra_dimensions_;
    PointSequence sequence_;
    std::uint64_t points_ = 0, seen_ = 0;
};

// Poses that fill what a camera can see of a marker, for statistics over poses: Halton points
// (sim/scene/pose_sampling.h). Left out are those that would bring the grid's outline outside the
// image or nearer than 20 px to its border, and those whose plane passes through the lens (part of
// which would see the back). The same arguments give the same poses, and a longer list begins with
// a shorter one. All throw NumericalError when one draw in a thousand or less fits.

// What the camera sees between two depths of the grid's centre, mm, with tilts up to max_tilt, rad.
struct SeenVolume {
    double nearest_mm = 150.0, farthest_mm = 1500.0;
    double max_tilt = 1.2217304763960306;  // 70 degrees
};

// Depth uniform, tilt uniform about any axis in the image plane, any turn in the marker's plane,
// the centre anywhere in the image.
std::vector<Rigid> volume_poses(const CameraModel& camera, const CellGrid& grid, int count,
                                std::uint64_t seed, const SeenVolume& volume);

// From near focus to far: 150 to 1500 mm, tilts to 70 degrees.
std::vector<Rigid> spread_poses(const CameraModel& camera, const CellGrid& grid, int count,
                                std::uint64_t seed);

// The volume of the published comparison of detectors (FMAC, 10 000 images): depth uniform from 500
// to 1500 mm, R = Rz(yaw) Ry(pitch) Rx(roll) with roll and pitch uniform within +-45 degrees and
// any yaw, the marker's origin anywhere in the image.
std::vector<Rigid> study_poses(const CameraModel& camera, const CellGrid& grid, int count,
                               std::uint64_t seed);

}  // namespace etalon
