// Which errors explain what a run saw, jointly and with a probability each.
//
// Observed are the corners of all used poses, photograph less expectation, px, and figures of the
// photographs' pixels (focus, tone...), with their covariance. It holds the stated noise, what is
// declared as uncertain, and the corners' scatter by the detector's bias, which is estimated with
// the best explanation. Where poses that moved on their own, along an axis or in all directions,
// explain the corners better than any systematic error, it holds that too. Corners that scatter
// even more enlarge all deviations. X and Y are solved again with every explanation.
//
// An explanation is a set of candidates (compare/diagnosis/error_candidates.h): none, one, all
// pairs, and the best sets of three and four. Its probability is by Schwarz's criterion (Estimating
// the dimension of a model, Ann. Statist. 6, 1978), with prior odds of one in the number of
// candidates for each member, times the periods or poses that it was chosen from. "None of these"
// is any smooth change of position and rotation.
#pragma once

#include "compare/diagnosis/error_candidates.h"

namespace etalon {

struct CausingError {
    // The best first, then those that the run cannot tell from it (over 1 to 100 against the best).
    std::vector<std::string> names;
    double size = 0.0;  // of the best: its amount, or the length of its several numbers
    double expanded_uncertainty = 0.0;  // k = 2, enlarged like the corners' scatter
    std::string unit;
    std::vector<std::string> remedies;  // one a name

    std::string text() const;  // "focal length ~ stage scale z"
};

struct Cause {
    std::vector<CausingError> errors;  // that act together
    double probability = 0.0;          // of this explanation and of those its names stand for
    // Names of as many errors, or more, which together explain as much in place of all of these.
    std::vector<std::vector<std::string>> instead = {};

    std::string text() const;  // "k3 and p1 and p2, or k6 and p1 and sensor tilt tau_y"
    std::vector<std::string> alternatives() const;  // in words; of many the first two
    // Each error's, those of a kind as one: "calibrate the camera again: k3 or k6, p1".
    std::vector<std::string> remedies() const;
};

struct Causes {
    std::vector<Cause> ranked;       // the most probable first, down to 1 %; at most 6
    double no_error = 0.0;           // probability that noise and what is declared explain it all
    double none_of_these = 0.0;      // that it is something without a name here
    double corner_scatter_px = 0.0;  // by detector biases in photograph and render; 0: none seen
    double scatter = 1.0;  // of the corners that the best explanation leaves, over what is stated

    const Cause* named() const;  // the first, where it is more probable than not
};

// The ranking with this error, present with a probability, in every explanation, and alone in place
// of none.
Causes with_error(const CausingError& error, double probability, Causes causes);

struct DiagnosisInput {
    CandidateRequest request;
    // Per pose of the chain: photographed corners less expected ones, x and y of each, and their
    // covariance.
    std::vector<Eigen::VectorXd> difference_px;
    std::vector<Eigen::MatrixXd> covariance_px2;
    // Standard uncertainties that are declared, by the candidates' names, in their units.
    std::map<std::string, double> declared;
    // Per pose, a factor of the correlation of its corners' noise; empty: no scatter is looked for.
    std::vector<Eigen::MatrixXd> corner_modes = {};
    // Of the request's pixel errors (PixelEvidence, image_agreement.h); may be empty.
    Eigen::VectorXd pixels = {};
    Eigen::MatrixXd pixel_covariance = {};
};

// Deterministic. Throws NumericalError for sizes that do not agree, and a covariance that is not
// positive definite. Some 0.3 s for 70 poses of a tag.
Causes find_causes(const DiagnosisInput& evidence);

}  // namespace etalon
