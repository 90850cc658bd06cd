// What registrations on corners and on poses share: the linear seed, and minimising over X and Y.
//
// Internal to calib/registration; the method is described there.
#pragma once

#include <functional>
#include <optional>
#include <span>

#include "calib/registration/registration_gauge.h"
#include "calib/registration/stage_motion.h"
#include "core/optimize/least_squares.h"

namespace etalon {

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
