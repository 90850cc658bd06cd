// Levenberg and Marquardt's method for small dense problems, with Huber's loss by iterated weights
// (Björck, Numerical Methods for Least Squares Problems, 9.2). Single-threaded, nothing random.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <optional>
#include <utility>

namespace etalon {

// Losses and gains are in units of the loss, half a sum of squares.
struct DescentRule {
    double first_damping = 1e-4;  // relative to the squared lengths of the Jacobian's columns
    double max_damping = 1e8;     // beyond, no better place is near
    int max_tries = 200;
    double enough_gain = 1e-20;  // converged where a step promises less than this
    double enough_part = 1e-15;  // or than this part of the loss
    double slack = 0.0;          // a loss that rises by less is not taken as a rise
};

template <class Place>
struct OptimizerResult {
    Place place;
    int steps = 0;  // that were taken
    bool converged = false;
};

// From a place with `loss()`: `step_at(place, damping)` gives a step with its `predicted_gain`,
// `tried(place, step)` the place it leads to, nothing where there is none. Converged means that a
// step with little damping promises next to nothing; a gain that is not finite ends the descent.
template <class Place, class StepAt, class Tried>
OptimizerResult<Place> levenberg_marquardt(Place start, const DescentRule& rule,
                                           const StepAt& step_at, const Tried& tried) {
    constexpr double min_damping = 1e-9, first_rise = 1e-2;
    constexpr double rounding = 1e-11;  // of a loss
    const double little_damping = std::max(rule.first_damping, 1e-4);
    OptimizerResult<Place> at{std::move(start)};
    double damping = rule.first_damping;
    for (int i = 0; i < rule.max_tries && damping <= rule.max_damping; ++i) {
        const double loss = at.place.loss();
        const auto step = step_at(at.place, damping);
        const double enough = std::max(rule.enough_gain, rule.enough_part * loss);
        at.converged = damping <= little_damping && step.predicted_gain <= enough;
        if (at.converged || !(step.predicted_gain < std::numeric_limits<double>::infinity()))
            break;
        std::optional<Place> next = tried(at.place, step);
        if (next && next->loss() <= loss * (1.0 + rounding) + rule.slack) {
            at.place = std::move(*next);
            ++at.steps;
            damping = std::max(0.1 * damping, min_damping);
        } else {
            damping = std::max(10.0 * damping, first_rise);
        }
    }
    return at;
}

// Residuals in standard deviations, and their derivatives by a step from where they were taken.
struct ResidualsAndJacobian {
    Eigen::VectorXd residuals;
    Eigen::MatrixXd jacobian;
};

struct LeastSquaresRule {
    DescentRule descent = {};
    int group = 1;  // rows that one weight is given to, by their length
    double huber = std::numeric_limits<double>::infinity();  // that length, standard deviations
};

struct DampedStep {
    Eigen::VectorXd step;
    double predicted_gain = 0.0;
};

// Half the sum of squares where groups are shorter than `huber`, linear beyond.
double robust_loss(const ResidualsAndJacobian& at, const LeastSquaresRule& rule);

// From a QR decomposition: directions that no row tells anything about stay where they are.
DampedStep damped_step(ResidualsAndJacobian at, double damping, const LeastSquaresRule& rule);

// Where a problem is, and its equations there.
template <class Unknowns>
struct Fitted {
    Unknowns unknowns;
    ResidualsAndJacobian at;
    double robust_loss = 0.0;

    double loss() const { return robust_loss; }
};

// `linearised(unknowns)` gives std::optional<ResidualsAndJacobian>, nothing where there are no
// residuals: such a place is not entered. `moved(unknowns, step)` gives the optional unknowns after
// a step, which it may refuse. Nothing when the start has no residuals; else see `converged`.
template <class Unknowns, class Linearise, class Move>
std::optional<OptimizerResult<Fitted<Unknowns>>> least_squares(const Unknowns& start,
                                                               const LeastSquaresRule& rule,
                                                               const Linearise& linearised,
                                                               const Move& moved) {
    using Place = Fitted<Unknowns>;
    const auto place_at = [&](const Unknowns& unknowns) -> std::optional<Place> {
        std::optional<ResidualsAndJacobian> at = linearised(unknowns);
        if (!at)
            return std::nullopt;
        const double loss = robust_loss(*at, rule);
        return Place{unknowns, std::move(*at), loss};
    };
    std::optional<Place> first = place_at(start);
    if (!first)
        return std::nullopt;
    return levenberg_marquardt(
        std::move(*first), rule.descent,
        [&](const Place& place, double damping) { return damped_step(place.at, damping, rule); },
        [&](const Place& place, const DampedStep& step) -> std::optional<Place> {
            const std::optional<Unknowns> next = moved(place.unknowns, step.step);
            return next ? place_at(*next) : std::nullopt;
        });
}

}  // namespace etalon
