// Nonlinear least squares of small dense problems: Levenberg and Marquardt's damping relative to
// the columns' lengths, with Huber's loss by iterated weights (Björck, Numerical Methods for Least
// Squares Problems, 9.2). Single-threaded, nothing random.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <optional>

namespace etalon {

// Residuals in standard deviations, and their derivatives by a step from where they were taken.
struct Linearised {
    Eigen::VectorXd residuals;
    Eigen::MatrixXd jacobian;
};

struct LeastSquaresRule {
    int group = 1;  // rows that one weight is given to, by their length
    double huber = std::numeric_limits<double>::infinity();  // that length, standard deviations
    int max_steps = 200;
    double enough_gain = 1e-15;  // of the loss: converged when a step promises less
};

struct DampedStep {
    Eigen::VectorXd step;
    double predicted_gain = 0.0;  // of the loss
};

// The sum of squares / 2 where groups are shorter than `huber`, linear beyond.
double robust_loss(const Linearised& at, const LeastSquaresRule& rule);

// The step with `damping` times the columns' squared lengths added to the normal equations, from a
// QR decomposition: directions that no row tells anything about stay where they are.
DampedStep damped_step(Linearised at, double damping, const LeastSquaresRule& rule);

// `linearised(place)` gives std::optional<Linearised>, nothing where there are no residuals: such a
// place is not entered. `moved(place, step)` is the place after a step. Nothing when the start has
// no residuals, no step helps, or `max_steps` were not enough.
template <class Place, class Linearise, class Move>
std::optional<Place> least_squares(Place place, const LeastSquaresRule& rule,
                                   const Linearise& linearised, const Move& moved) {
    constexpr double first_damping = 1e-4, min_damping = 1e-12, max_damping = 1e8;
    constexpr double rounding = 1e-13, nothing = 1e-20;  // relative to the loss; absolute
    std::optional<Linearised> here = linearised(place);
    double damping = first_damping;
    for (int i = 0; here && i < rule.max_steps && damping < max_damping; ++i) {
        const double loss = robust_loss(*here, rule);
        const DampedStep step = damped_step(*here, damping, rule);
        if (!step.step.allFinite())
            return std::nullopt;
        const Place next = moved(place, step.step);
        std::optional<Linearised> there = linearised(next);
        const bool is_better =
            there && robust_loss(*there, rule) <= loss * (1.0 + rounding) + nothing;
        if (is_better && damping <= first_damping &&
            step.predicted_gain <= rule.enough_gain * loss + nothing)
            return next;
        damping = is_better ? std::max(0.1 * damping, min_damping) : 10.0 * damping;
        if (is_better)
            place = next, here = std::move(there);
    }
    return std::nullopt;
}

}  // namespace etalon
