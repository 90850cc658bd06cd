// Which errors explain what a run saw, jointly and with a probability each.
//
// Observed are the corners of all used poses, photograph less expectation, in px, with the noise
// that is stated for them (repeated frames, renders, repeatability of the stage), and what the
// photographs' pixels tell beside, of focus, tone and the like, with its covariance. X and Y are
// solved anew with every explanation, so that what registration can absorb is not attributed to any
// error. What is declared as uncertain is expected to be off by that much: it is part of the
// covariance. The detector's bias changes within a pixel and drops out only where photograph and
// render agree: how much corners scatter by it is found beside the best explanation and is part of
// the covariance. Should the corners scatter even more, all deviations are enlarged.
//
// Random errors are looked for first: should poses that each moved on their own along an axis, or
// in all directions, explain the corners better than any error that follows a rule, their
// covariance takes it up and the search goes on with that.
//
// An explanation is a set of candidates (compare/diagnosis/error_candidates.h): none, one,
// all pairs, and the best sets of three and four. Its probability is that of Schwarz's criterion
// (G. Schwarz, Estimating the dimension of a model, Ann. Statist. 6, 1978), with prior odds of one
// in the number of candidates for each member, times the periods or poses that it was chosen
// from. "None of these" is any smooth change of position and rotation that no candidate needs to
// make.
#pragma once

#include <map>
#include <span>
#include <string>
#include <vector>

#include "compare/diagnosis/error_candidates.h"

namespace etalon {

// One error of an explanation.
struct CausingError {
    // The best name first, then those that would explain as much in its place: the run cannot tell
    // them apart (more than 1 to 100 against the best).
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
    // Names of as many errors, or more, which would together explain as much in place of all of
    // these.
    std::vector<std::vector<std::string>> instead = {};

    std::string text() const;  // "k3 and p1 and p2, or k6 and p1 and sensor tilt tau_y"
    std::vector<std::string> alternatives() const;  // in words; of many the first two
    // Each error's, those of a kind as one: "calibrate the camera again: k3 or k6, p1".
    std::vector<std::string> remedies() const;
};

struct Causes {
    std::vector<Cause> ranked;   // the most probable first, down to 1 %; at most 6
    double no_error = 0.0;       // probability that noise and what is declared explain it all
    double none_of_these = 0.0;  // that it is something without a name here
    // What corners scatter by beside the best explanation and the stated noise: the detector's
    // biases where photograph and render lie apart. 0 where it does not show.
    double corner_scatter_px = 0.0;
    double scatter = 1.0;  // of the corners beside the best explanation, over what is stated

    // The cause, where it is more probable than not.
    const Cause* named() const;
};

// The ranking with this error, which is there with a probability, in every explanation, and alone
// in place of none.
Causes with_error(const CausingError& error, double probability, Causes causes);

struct DiagnosisInput {
    CandidateRequest request;
    // Per pose of the chain: photographed corners less expected ones, x and y of each, and their
    // covariance.
    std::vector<Eigen::VectorXd> difference_px;
    std::vector<Eigen::MatrixXd> covariance_px2;
    // Standard uncertainties that are declared, by the candidates' names, in their units.
    std::map<std::string, double> declared;
    // Per pose, a factor of the correlation of its corners' noise: they scatter more where the
    // detector's biases in photograph and render differ. Empty: not looked for.
    std::vector<Eigen::MatrixXd> corner_modes = {};
    // What the photographs' pixels tell beside (PixelEvidence in
    // compare/diagnosis/image_agreement.h), of the request's pixel errors; may be empty.
    Eigen::VectorXd pixels = {};
    Eigen::MatrixXd pixel_covariance = {};
};

// Deterministic. Throws NumericalError for sizes that do not agree, and a covariance that is not
// positive definite. Some 0.3 s for 70 poses of a tag.
Causes find_causes(const DiagnosisInput& evidence);

}  // namespace etalon
