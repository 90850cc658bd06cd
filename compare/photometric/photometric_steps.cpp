#include "compare/photometric/photometric_steps.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "core/program/errors.h"

namespace etalon {
namespace {

struct PhotoStep {
    Eigen::VectorXd delta;
    double predicted_gain;  // half of score . delta: how much the loss should fall
};

// Scaled to a unit diagonal, so that rad, mm and gray compare.
PhotoStep step_of(const PhotoEquations& equations, double damping) {
    const Eigen::VectorXd scale =
        equations.information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    Eigen::MatrixXd scaled = scale.asDiagonal() * equations.information * scale.asDiagonal();
    scaled.diagonal() *= 1.0 + damping;
    const Eigen::LLT<Eigen::MatrixXd> solver(scaled);
    const Eigen::VectorXd delta =
        scale.cwiseProduct(Eigen::VectorXd(solver.solve(scale.cwiseProduct(equations.score))));
    const double gain = 0.5 * equations.score.dot(delta);
    if (solver.info() != Eigen::Success || !std::isfinite(gain))
        throw NumericalError("the photograph does not determine pose and photometric model");
    return {delta, gain};
}

// To the last bit: then their renderings are the same.
bool same_pose(const Rigid& a, const Rigid& b) {
    return a.rotation.coeffs() == b.rotation.coeffs() && a.translation == b.translation;
}

// Without a Gaussian, what central differences reach.
int room_px(const PhotometricTerms& terms, const PhotometricModel& photometry) {
    return terms.psf || !photometry.psf_sigmas_px().isZero() ? gaussian_reach_px : 1;
}

}  // namespace

PhotometricSteps::PhotometricSteps(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                                   const PhotometricTerms& terms, const PhotoState& near)
    : photo_(&photo),
      camera_(&camera),
      terms_(terms),
      motion_(camera.projector(), near.camera_from_marker, {},
              fitted_region(photo, camera, room_px(terms, near.photometry))) {}

void PhotometricSteps::render(const Rigid& camera_from_marker) {
    if (rendered_ && same_pose(*rendered_, camera_from_marker))
        return;
    ++renderings_;
    gradient_.radiance = camera_->at_sensor(
        {{{photo_->grid, camera_from_marker}}, photo_->background}, motion_.region(),
        gradient_.by_x.empty() ? PhotometricCamera::rough_tolerance_gray
                               : PhotometricCamera::fine_tolerance_gray);
    rendered_ = camera_from_marker;
}

PhotoPlace PhotometricSteps::at(const PhotoState& state, double noise_scale) {
    render(state.camera_from_marker);
    return {state,
            photo_equations(*photo_, *camera_, state, terms_, gradient_, motion_, noise_scale),
            noise_scale};
}

void PhotometricSteps::render_gradient(const PhotoState& state) {
    renderings_ += 3;
    motion_ = ImageMotion(camera_->projector(), state.camera_from_marker, {}, motion_.region());
    gradient_ = camera_->gradient_at_sensor({photo_->grid, state.camera_from_marker},
                                            photo_->background, motion_, Differences::forward);
    rendered_ = state.camera_from_marker;
}

// Where nothing can be rendered it is no better than where the loss is higher.
std::optional<PhotoPlace> PhotometricSteps::after(const PhotoPlace& place,
                                                  const Eigen::VectorXd& step) {
    return attempted([&] { return at(stepped(place.state, terms_, step), place.noise_scale); })
        .value;
}

bool PhotometricSteps::descend(PhotoPlace& place, DescentRule rule) {
    rule.max_tries = std::min(rule.max_tries, 25);
    rule.max_damping = std::min(rule.max_damping, 1e3);
    const auto tried = [&](const PhotoPlace& from, const PhotoStep& step) {
        return after(from, step.delta);
    };
    const auto step_at = [](const PhotoPlace& from, double damping) {
        return step_of(from.equations, damping);
    };
    auto descent = levenberg_marquardt(std::move(place), rule, step_at, tried);
    place = std::move(descent.place);
    return descent.converged || promised_gain(place.equations) < rule.enough_gain;
}

bool PhotometricSteps::settle(PhotoPlace& place, double enough_gain) {
    constexpr double slow = 0.5;
    PhotoStep step = step_of(place.equations, 0.0);
    while (step.predicted_gain > enough_gain) {
        auto next = after(place, step.delta);
        if (!next)
            return false;
        PhotoStep next_step = step_of(next->equations, 0.0);
        if (!(next_step.predicted_gain < slow * step.predicted_gain))
            return false;
        place = std::move(*next);
        step = std::move(next_step);
    }
    return true;
}

double promised_gain(const PhotoEquations& equations) {
    return step_of(equations, 0.0).predicted_gain;
}

double noise_scale_of(const PhotoPlace& place, bool knows_noise) {
    constexpr double min_gray = 0.2;  // rounding to 8 bits: 1 / sqrt(12), and a little less
    const double found = 1.4826 * place.equations.median_size * place.noise_scale;
    if (!knows_noise)
        return std::max(found, min_gray);
    const double median_error = 1.17 / std::sqrt(place.equations.pixels);
    return found < 1.0 + 3.0 * median_error ? 1.0 : found;
}

PhotoPlace approached(PhotometricSteps& steps, const PhotoState& start) {
    constexpr double above_all = 1e4, least = 0.2;
    constexpr double largest = 2.0;  // edges, few pixels of all, are off by some ten times the rms
    const PhotoPlace first = steps.at(start, above_all);
    const double rms = above_all * std::sqrt(first.equations.squares / first.equations.pixels);
    PhotoPlace place = steps.at(start, std::max(largest * rms, least));
    const double enough = std::max(1.0, 0.02 * place.equations.loss);
    steps.descend(place, {.first_damping = 1e-3, .max_damping = 1.0, .enough_gain = enough});
    return place;
}

}  // namespace etalon
