// What this run could have seen: each named error of camera, marker or stage is pushed through the
// run's own chain (corners at the run's poses, poses solved with the nominal camera, X and Y
// registered again) and what remains on the hold-out poses is its signature.
//
// First order: one Gauss-Newton step of pose and registration from central differences, no pixels.
// From it: the smallest size the run detects, errors that leave nothing (not observable), and
// groups of errors whose signatures are so alike that the run cannot tell them apart.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "compare/diagnosis/error_catalogue.h"

namespace etalon {

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

// What is left on the hold-out poses, as ErrorSignature::after, of motions of all corners (2 rows
// per point and pose of the chain, px), a column each.
Eigen::MatrixXd fields_after_registration(const SignatureChain& chain,
                                          const Eigen::MatrixXd& corners_px);

// Root mean square and largest length of the 3-vectors that are stacked in a field.
double rms_norm(const Eigen::VectorXd& field);
double max_norm(const Eigen::VectorXd& field);

}  // namespace etalon
