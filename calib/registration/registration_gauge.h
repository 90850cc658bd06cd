// The gauge of the registration X * base_from_carriage(q) * Y: which motions of the base frame
// leave every predicted pixel where it is, how they are named, and how a prior on Y fixes them.
//
// Internal to calib/registration; the method is described there.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "calib/registration/registration.h"
#include "calib/registration/stage_motion.h"
#include "core/optimize/least_squares.h"

namespace etalon {

struct XY {
    Rigid camera_from_base, carriage_from_marker;
};

// d all pixels / d (X, Y), in standard deviations.
using RegistrationJacobian = Eigen::Matrix<double, Eigen::Dynamic, 12>;

// A motion of the base frame, X' = X Exp(twist), that Y can undo: rotation, then translation.
using Twist = Vector6d;

struct RegistrationRank {
    int rank = 0;
    double condition_number = 0.0;  // of the column-scaled Jacobian, determined directions only
    std::vector<Twist> freedoms;    // pure shifts first, each with a largest entry of about 1
};

// From the singular values of the column-scaled Jacobian. Throws NumericalError for more than 4
// freedoms: a single linear axis has 4, more means that the stage hardly moved.
RegistrationRank registration_rank(const RegistrationJacobian& jacobian, const XY& xy);

// With the name and the direction in (X, Y) that the report shows.
GaugeFreedom gauge_freedom(const Twist& twist, const XY& xy, const Rigid& base_from_carriage);

// Directions about which all poses together say less than a single pose would if Y were known. The
// ratio is the squared sine of the angle between the columns of X and those of Y (canonical
// correlation; Bjorck and Golub, Math. Comp. 27, 1973), times the number of poses: it depends on no
// unit and on no choice of origin. `middle_mm` is the middle of the marker's positions, base frame.
// A motion counts as a shift when it moves this point by more than the arc of its turn at 100 mm.
std::vector<PoorlyConstrainedDirection> weak_directions(const RegistrationJacobian& jacobian,
                                                        const XY& xy,
                                                        const std::vector<Twist>& freedoms,
                                                        const Eigen::Vector3d& middle_mm,
                                                        std::size_t poses);

// Moves along the freedoms to the carriage_from_marker nearest to the nominal one (rotations count
// as arcs of 100 mm radius). Exact: the predicted pixels do not change. `base_from_carriage` is any
// one of the run. Throws NumericalError when that does not converge.
XY nearest_to_prior(XY xy, const std::vector<Twist>& freedoms, const Rigid& base_from_carriage,
                    const Rigid& nominal_carriage_from_marker);

// Covariance of (X, Y) with the freedoms held where the prior puts them.
Matrix12d constrained_covariance(const RegistrationJacobian& jacobian,
                                 const std::vector<GaugeFreedom>& freedoms);

// What registrations on corners and on poses share: the linear seed, and minimising over X and Y.

struct PosePair {
    Rigid base_from_carriage, camera_from_marker;
};

// Linear in M (camera_from_base's rotation, not yet orthogonal), w = R_Y^T t_Y and t = t_X:
//     M s_i + R_i w + t = t_i            what the marker's origin does
//     M log(S_i S_j^T) = log(R_i R_j^T)  what rotations do
// with (S_i, s_i) = base_from_carriage and (R_i, t_i) = camera_from_marker. Unlike the closed-form
// hand-eye methods it needs no particular set of axes.
XY registration_seed(std::span<const PosePair> poses);

// Throws NumericalError for fewer than 4 poses.
void require_enough_poses(std::size_t poses);

// Throws NumericalError for a stage that did not move, or fewer than 4 distinct poses.
StageMotion required_motion(std::span<const PosePair> poses);

// `linearised` gives twelve derivatives, by the left perturbations of X and Y. Throws
// NumericalError when the steps do not converge.
XY minimised(const XY& start, const LeastSquaresRule& rule,
             const std::function<std::optional<ResidualsAndJacobian>(const XY&)>& linearised);

// X and Y moved along the freedoms to the prior, with covariance, rank and names. `jacobian_at`
// gives the derivatives at `motion.without_noise`, in standard deviations. Throws what
// registration_rank() and nearest_to_prior() throw, and NumericalError for what is not finite.
Registration with_freedoms_fixed(const XY& solution, const StageMotion& motion,
                                 const Rigid& nominal_carriage_from_marker,
                                 const std::function<RegistrationJacobian(const XY&)>& jacobian_at);

}  // namespace etalon
