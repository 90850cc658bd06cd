// Errors that have no name: the marker moves as a function of something, smooth or in steps. An
// error that the catalogue does not know is one of these; named ones must explain more than they
// do.
//
// Each is a Gaussian process (C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine
// Learning, MIT Press 2006): poses that are near each other in what the error follows are moved
// alike. It follows one axis (or that and the side that the axis came from), two axes, the place in
// the volume or in the image, or time; it shifts or turns the marker, or moves one axis.
#pragma once

#include <memory>

#include "compare/diagnosis/error_candidates.h"

namespace etalon {

struct UnlistedError {
    std::string text;  // "an error of x that follows y"
    std::string unit;  // "mm", or "rad"
    // Per pose, what a unit of it does to the marker: left perturbations of camera_from_marker
    // (rad, mm), by 3 columns or 1.
    std::shared_ptr<const std::vector<Eigen::MatrixXd>> moves;
    // F, a row a pose: the covariance of two poses is that of F F^T, in units of the size's square.
    std::shared_ptr<const Eigen::MatrixXd> factor;

    // Of all poses, 6 rows each: columns C such that the covariance is size^2 C C^T.
    Eigen::MatrixXd perturbations() const;
    // The same of the corners: 2 rows per point and pose, px.
    Eigen::MatrixXd corners_px(const SignatureChain& chain) const;
};

// All of a run's, some 200 for a stage of four axes. A process is kept to 1e-3 of its largest
// component. Those that follow time need times_s. Some 30 ms.
std::vector<UnlistedError> unlisted_errors(const CandidateRequest& request);

// What a run's whitened rows say of perturbations of its poses: the projection on them of the rows
// that are left when all else that is in the explanation is solved with them.
struct ObservedPoses {
    std::vector<Matrix6d> seen_by;       // per pose: rows that a perturbation changes
    Eigen::MatrixXd absorbed;            // L: of rows r, r - L L^T r is left; 6 rows a pose
    Eigen::VectorXd values;              // what is left of the observed
    double square = 0.0, freedom = 0.0;  // of all rows: the sum of squares, and how many are free
};

struct UnlistedFit {
    std::size_t error = 0;  // the one that makes the observed most probable
    double size = 0.0;      // of it
    // Logs of how much more probable than without it: that one, and the mean over all and all
    // sizes.
    double best = 0.0, mean = 0.0;
};

// Of sizes from 1e-3 to 8 mm (1e-5 to 0.08 rad) in steps of two, in closed form. Some 0.1 s.
UnlistedFit fit_unlisted(const std::vector<UnlistedError>& errors, const ObservedPoses& observed);

}  // namespace etalon
