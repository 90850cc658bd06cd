// What this run could have seen. The signature of a named error of camera, marker or stage is what
// remains of it on the hold-out poses: poses solved with the nominal camera, X and Y registered
// again. First order, one Gauss-Newton step. From it: the smallest size the run detects, errors
// that are not observable, and errors that the run cannot tell apart.
#pragma once

#include "compare/diagnosis/error_catalogue.h"

namespace etalon {

struct ErrorSignature {
    std::string name;  // "focal length", "k1", "marker print size", "stage scale z"...
    std::string unit;
    double size = 0.0;  // that the figures below belong to

    // 3 numbers per hold-out pose, camera frame: position error, mm, before registration (X and Y
    // known) and after it, and rotation error after it, rad.
    Eigen::VectorXd before, after, rotation_after;
    double before_rms_mm = 0.0, before_max_mm = 0.0, after_rms_mm = 0.0, after_max_mm = 0.0;

    // Found in 95 % of runs by a 5 % test (3.29 standard deviations of its amplitude); infinite
    // when the signature vanishes.
    double detectable_size = 0.0;
    // False when it vanishes in registration, or the detectable size's field exceeds the limit.
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

// One standard deviation of the calibration's own covariance along each of its principal directions
// ("calibration, direction 1"...). Fields only. Empty without a covariance. Throws as above.
std::vector<ErrorSignature> calibration_signatures(const SignatureChain& chain);

// What is left on the hold-out poses, as ErrorSignature::after, of motions of all corners (2 rows
// per point and pose of the chain, px), a column each.
Eigen::MatrixXd fields_after_registration(const SignatureChain& chain,
                                          const Eigen::MatrixXd& corners_px);

// Root mean square and largest length of the 3-vectors that are stacked in a field.
double rms_norm(const Eigen::VectorXd& field);
double max_norm(const Eigen::VectorXd& field);

}  // namespace etalon
