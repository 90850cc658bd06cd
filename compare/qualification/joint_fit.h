// Everything that moves a run's corners, fitted at once: what the camera does by itself, whether
// what the station declares holds, and what is left. Errors of camera, stage and marker can cancel
// in the judged field; each moves the corners in its own way.
//
// Generalised least squares on the corners of all used poses, with their covariance
// (diagnosis_input.h): X and Y and every named error of the camera are free; what the station
// declares has its standard uncertainty as prior. Then, the best first, errors are added that must
// be there: an input off by more than is declared, or an undeclared error of the stage. Each must
// lower the sum of squares by what chance does as seldom as 4 standard deviations (data snooping;
// W. Baarda, A testing procedure for use in geodetic networks, 1968). Corners that scatter by more
// than is stated enlarge all deviations.
#pragma once

#include "compare/diagnosis/causes.h"

namespace etalon {

// What each error does to the corners, and to the hold-out poses once X and Y are registered again.
struct ErrorEffects {
    std::vector<ErrorCandidate> errors;
    // Position errors on each hold-out pose, camera frame, mm at the error's size: 3 rows per pose,
    // a column for each of its numbers.
    std::vector<Eigen::MatrixXd> after_mm;
};
// Throws as error_candidates() does. Some 10 ms for 70 poses of a tag.
ErrorEffects error_effects(const CandidateRequest& request);

struct ContradictedInput {
    std::string name, unit;
    double declared = 0.0;               // standard uncertainty
    double found = 0.0;                  // by all else
    double expanded_uncertainty = 0.0;   // k = 2, of what is found
    double deviations = 0.0;             // found, in standard deviations of it and the declared
    std::vector<std::string> or_all_of;  // which look the same when they are all off together
};

// What some errors do by themselves to the hold-out poses' positions, registration's part taken
// out: 3 numbers per pose, camera frame, mm, and a factor F of their covariance F F^T.
struct EffectAlone {
    Eigen::VectorXd mean_mm;
    Eigen::MatrixXd factor_mm;
};

struct JointFit {
    std::vector<ContradictedInput> contradicted;  // in the order in which they were found
    std::vector<std::string> beside;  // errors for which nothing is declared and that must be there
    // Of one more error that is in doubt (2.5 standard deviations) the larger of with and without.
    EffectAlone camera;
    EffectAlone edges;  // where edges lie elsewhere than in the render: exposure, tone, print
    std::vector<Eigen::VectorXd> residual_px;  // per pose of the chain
    double scatter = 1.0;                      // of the corners, over what is stated; 1 at least
};

// `effects` are of the evidence's chain. Throws NumericalError as find_causes() does. Some 5 ms for
// 70 poses of a tag.
JointFit joint_fit(const DiagnosisInput& evidence, const ErrorEffects& effects);

inline constexpr double contradiction_deviations = 4.0;

}  // namespace etalon
