// What this run could have seen: each named error of camera, marker or stage is pushed through the
// run's own chain (corners at the run's poses, poses solved with the nominal camera, X and Y
// registered again) and what remains on the hold-out poses is its signature.
//
// First order: one Gauss-Newton step of pose and registration from central differences, no pixels.
// From it: the smallest size the run detects, errors that leave nothing (not observable), and
// groups of errors whose signatures are so alike that the run cannot tell them apart.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/camera/projector.h"
#include "calib/registration/registration.h"
#include "compare/verdict/pose.h"

namespace etalon {

// The run as the signatures need it: geometry only. X and Y are the registered ones. Of the poses
// only where the stage was and which are held out counts.
struct SignatureChain {
    const Projector& projector;  // the calibration under test
    std::vector<Eigen::Vector3d> points_mm;
    Rigid camera_from_base, carriage_from_marker;
    std::vector<Pose> poses;
};

// A stage error: where the carriage would truly stand at each read-back position.
struct StageError {
    std::string name;  // "stage scale z"
    std::string unit;  // "1" (relative), "rad", "mm", "px"; empty: a coefficient's own number
    double size = 0.0;
    std::vector<Rigid> base_from_carriage;  // per pose, at this size
};

// A camera error: the true camera differs from the calibration by it. Its signature belongs to
// `size`, small enough for first order.
struct CameraError {
    std::string name;  // "focal length", "c_x", "k1"...
    std::string unit;
    double size = 0.0;
    std::function<void(CameraModel&, double)> change;  // makes the camera wrong by this much
};
std::vector<CameraError> named_camera_errors();

// The corners of a square, in order, when each of its edges is seen moved inwards by `by_px`: each
// corner goes to where its two edges then meet.
std::vector<Eigen::Vector2d> edges_moved_inwards(const std::vector<Eigen::Vector2d>& corners,
                                                 double by_px);

// The direction in which the error "constant pose offset" moves every pose, camera frame; unit.
Eigen::Vector3d pose_offset_direction();

struct ErrorSignature {
    std::string name;  // "focal length", "k1", "marker print size", "stage scale z"...
    std::string unit;
    double size = 0.0;  // that the figures below belong to

    // Position error on each hold-out pose, camera frame, mm: 3 per pose, stacked; before
    // registration (X and Y known) and after it.
    Eigen::VectorXd before, after;
    Eigen::VectorXd rotation_after;  // the rotation error after it, camera frame, rad: likewise
    double before_rms_mm = 0.0, before_max_mm = 0.0, after_rms_mm = 0.0, after_max_mm = 0.0;

    // Smallest size found in 95 % of runs by a 5 % test (3.29 standard deviations of its
    // amplitude); infinite when the signature vanishes.
    double detectable_size = 0.0;
    // False when the signature vanishes in registration, or when even the detectable size leaves a
    // field whose RMS exceeds the limit.
    bool observable = true;
    std::string reason;                        // why it is not
    std::vector<std::string> confounded_with;  // |cosine| > 0.95 with their signatures
};

// Standard deviation of one hold-out position error along the line of sight and across it, mm, per
// hold-out pose: what the detectable size is computed from.
struct HoldOutNoise {
    std::vector<double> along_mm, across_mm;
};

// The camera's and marker's own errors (focal length, c_x, c_y, k1, k2, k3, p1, p2, half pixel,
// edge shrink, marker print size, marker twist, marker bow, constant pose offset), then the given
// stage errors, then the isotropic stage scale when the stage errors hold two or more "stage scale"
// of linear axes
// (`linear_scale`: their indices). `limit_rms_mm` is the limit of the RMS field.
// Throws NumericalError when a corner has no projection. Milliseconds per error.
std::vector<ErrorSignature> error_signatures(const SignatureChain& chain,
                                             std::span<const StageError> stage_errors,
                                             std::span<const std::size_t> linear_scale,
                                             const HoldOutNoise& noise, double limit_rms_mm);

// What one standard deviation of the calibration's own covariance does, along each of its principal
// directions ("calibration, direction 1"...): errors that are independent of each other. Nothing
// when the calibration states no covariance. Position and rotation fields only; what makes errors
// detectable or alike is left out. Throws as above.
std::vector<ErrorSignature> calibration_signatures(const SignatureChain& chain);

// The error that explains an observed field best, with everything it is confounded with.
struct Explanation {
    std::vector<std::string> group;  // best first; a member is a suspect, not a culprit
    double cosine = 0.0;             // |cosine| of the best one with the observed field
    double size = 0.0;               // of the best one, signed, in `unit`
    std::string unit;
    std::string text;  // "focal length ~ stage scale z"
};

// `observed`: the smooth field at the hold-out poses, stacked as ErrorSignature::after. Nothing
// when no signature explains at least half of its power.
std::optional<Explanation> explain(const Eigen::VectorXd& observed,
                                   std::span<const ErrorSignature> signatures);

// Root mean square and largest length of the 3-vectors that are stacked in a field.
double rms_norm(const Eigen::VectorXd& field);
double max_norm(const Eigen::VectorXd& field);

}  // namespace etalon
