// Registration: where the stage stands before the camera, and how the marker sits on the carriage.
//
//     camera_from_marker(i) = camera_from_base * base_from_carriage(q_i) * carriage_from_marker
//
// X = camera_from_base and Y = carriage_from_marker from corner pixels by robust weighted least
// squares, the camera fixed: "robot-world / hand-eye" (Zhuang et al. 1994; Tabb & Ahmad Yousef
// 2017).
//
// With few axes some directions stay undetermined (gauge freedoms). They are found from the
// Jacobian, named, and fixed at the nominal carriage_from_marker; predictions never depend on that.
#pragma once

#include "calib/camera/projector.h"
#include "core/geometry/rigid.h"

namespace etalon {

using Vector12d = Eigen::Matrix<double, 12, 1>;
using Matrix12d = Eigen::Matrix<double, 12, 12>;

// What one pose contributes.
struct RegistrationPose {
    Rigid base_from_carriage;             // from the axes' read-back positions
    Rigid camera_from_marker;             // a first estimate; only the seed uses it
    std::vector<Eigen::Vector2d> pixels;  // where the marker's points were seen
    double sigma_px = 1.0;                // standard deviation of one coordinate: the weight
};

// A direction in (X, Y) that leaves every predicted pixel where it is: to first order X moves by
// left perturbation direction[0..5] and Y by direction[6..11] (rotation rad, translation mm).
struct GaugeFreedom {
    std::string name;     // "shift along base z between X and Y"
    Vector12d direction;  // largest entry of the base-frame motion is 1 (rad or mm)
};

// A direction about which all poses together say less than a single photograph would if Y were
// known. A rotary axis of +-2 degrees leaves some. It affects X and Y, not the predicted poses.
struct PoorlyConstrainedDirection {
    std::string name;        // like that of a freedom
    Vector12d direction;     // by 1 mm of a shift or 1 rad of a rotation
    double deviation = 0.0;  // standard, mm or rad, for the stated sigma_px
    // How many photographs would say as much if Y were known: below 1.
    double worth_poses = 0.0;

    bool is_shift() const { return name.starts_with("shift"); }
};

struct Registration {
    Rigid camera_from_base;      // X
    Rigid carriage_from_marker;  // Y

    // Left perturbations of X then of Y, each rotation then translation, for the stated sigma_px
    // and with the gauge freedoms held at the prior.
    Matrix12d covariance;

    double residual_rms_px = 0.0;  // over the coordinates, not weighted; of poses: 0
    // Sum of the squared residuals in standard deviations per degree of freedom: 1 when the stated
    // ones are right.
    double reduced_squares = 0.0;
    int down_weighted_points = 0;   // flagged as outliers by the robust loss; of poses: poses
    int rank = 0;                   // 12 - freedoms.size()
    double condition_number = 0.0;  // of the column-scaled Jacobian, determined directions only
    std::vector<GaugeFreedom> freedoms;
    std::vector<PoorlyConstrainedDirection> weak;  // worst first
    std::string motion;  // of the poses, in words (calib/registration/stage_motion.h)

    Rigid camera_from_marker(const Rigid& base_from_carriage) const {
        return camera_from_base * base_from_carriage * carriage_from_marker;
    }
};

// Estimates X and Y. `nominal_carriage_from_marker` fixes the gauge freedoms and nothing else. A
// linear seed for any set of axes, then Levenberg-Marquardt with a Huber loss whose threshold comes
// from the residuals' median. Single-threaded and repeatable to the bit; some ms for 100 poses.
//
// Throws NumericalError for fewer than 4 distinct poses, sizes that do not agree, values that are
// not finite, a stage that hardly moved (more than 4 free directions), a marker predicted outside
// the valid region, and no convergence. Whether poses move all that the stage can:
// require_full_motion().
Registration register_stage(const Projector& projector,
                            const std::vector<Eigen::Vector3d>& points_mm,
                            std::span<const RegistrationPose> poses,
                            const Rigid& nominal_carriage_from_marker);

// A pose that was measured as such (compare/photometric/photometric_detector.h), with its
// covariance: left perturbation in the camera frame, rotation then translation.
struct MeasuredPose {
    Rigid base_from_carriage;
    Rigid camera_from_marker;
    Matrix6d covariance;
};

// The same from poses, each weighted by its covariance. No marker and no camera come in. Throws
// NumericalError as above, and for a covariance that is not positive definite.
Registration register_stage_on_poses(std::span<const MeasuredPose> poses,
                                     const Rigid& nominal_carriage_from_marker);

// d pixels / d (X, Y) at one pose: 2 rows per point (x, y), 12 columns in the order of
// Registration::covariance. Throws NumericalError when a point has no projection.
Eigen::Matrix<double, Eigen::Dynamic, 12> registration_jacobian(
    const Projector& projector, const std::vector<Eigen::Vector3d>& points_mm,
    const Rigid& camera_from_base, const Rigid& base_from_carriage,
    const Rigid& carriage_from_marker);

}  // namespace etalon
