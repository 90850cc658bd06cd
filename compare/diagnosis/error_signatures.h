// What this run could have seen. The signature of a named error of camera, marker or stage is what
// remains of it on the hold-out poses: corners at the run's poses, poses solved with the nominal
// camera, X and Y registered again. First order: one Gauss-Newton step of pose and registration
// from central differences. From it: the smallest size the run detects, errors that leave nothing
// (not observable), and errors that the run cannot tell apart.
#pragma once

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

// Standard deviations of position errors along the line of sight and across it, per hold-out pose.
struct HoldOutNoise {
    std::vector<double> along_mm, across_mm;
};

// Of the named_errors() of camera, marker and stage, then of the isotropic stage scale when two or
// more of the stage errors are scales of linear axes. `limit_rms_mm` is the limit of the RMS field.
// Throws NumericalError when a corner has no projection. Milliseconds per error.
std::vector<ErrorSignature> error_signatures(const SignatureChain& chain,
                                             std::span<const StageError> stage_errors,
                                             const HoldOutNoise& noise, double limit_rms_mm);

// What one standard deviation of the calibration's own covariance does, along each of its principal
// directions ("calibration, direction 1"...), which are independent. Position and rotation fields
// only. Nothing when the calibration states no covariance. Throws as above.
std::vector<ErrorSignature> calibration_signatures(const SignatureChain& chain);

// What is left on the hold-out poses, as ErrorSignature::after, of motions of all corners (2 rows
// per point and pose of the chain, px), a column each.
Eigen::MatrixXd fields_after_registration(const SignatureChain& chain,
                                          const Eigen::MatrixXd& corners_px);

// Root mean square and largest length of the 3-vectors that are stacked in a field.
double rms_norm(const Eigen::VectorXd& field);
double max_norm(const Eigen::VectorXd& field);

}  // namespace etalon
