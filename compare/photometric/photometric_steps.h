// Steps of one photograph's own unknowns (pose and photometric model) towards the least Huber loss:
// Gauss and Newton's, damped where they lead uphill (Levenberg, Marquardt). Each takes one
// rendering. The foundation of compare/photometric/photometric_pose.h and photometric_detector.h.
//
// The gradient comes from central differences on that rendering (wrong by some 10 %: it costs
// steps) until render_gradient() makes it better; then it is kept. With J kept the steps end at the
// root of J^T r = 0 for the residuals r of the last rendering.
#pragma once

#include <optional>

#include "compare/photometric/photometric_equations.h"
#include "core/optimize/least_squares.h"

namespace etalon {

struct PhotoPlace {
    PhotoState state;
    PhotoEquations equations;  // there
    double noise_scale = 1.0;  // that they were made with

    double loss() const { return equations.loss; }
};

// Another noise scale or photometric model takes no new rendering. Refers to photograph and camera,
// which must outlive it. One thread.
class PhotometricSteps {
public:
    // `near` is about where the steps will be: within some px. Throws as photo_equations() does.
    PhotometricSteps(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                     const PhotometricTerms& terms, const PhotoState& near);

    // From now on with the pixels of this one: the same photograph with all or a part of them. It
    // must outlive it.
    void look_at(const PhotoOfMarker& photo) { photo_ = &photo; }

    PhotoPlace at(const PhotoState& state, double noise_scale);

    // From now on all equations have the gradient of this state: three renderings.
    void render_gradient(const PhotoState& state);

    // Moves the place; whether it converged. At most 25 tries, and damping to 1000 where the rule
    // allows more. Throws NumericalError where the pixels do not determine the unknowns.
    bool descend(PhotoPlace& place, DescentRule rule);

    // To the root of J^T r, from where the gradient was rendered: full steps as long as each
    // promises less than half of the one before. The loss is no guide there: the renderer's own
    // steps move it by more. Whether the last one promises no more than `enough_gain`.
    bool settle(PhotoPlace& place, double enough_gain);

    int renderings() const { return renderings_; }

private:
    void render(const Rigid& camera_from_marker);
    std::optional<PhotoPlace> after(const PhotoPlace& place, const Eigen::VectorXd& step);

    const PhotoOfMarker* photo_;
    const PhotometricCamera* camera_;
    PhotometricTerms terms_;
    ImageMotion motion_;
    RenderedGradient gradient_;      // without slopes: central differences
    std::optional<Rigid> rendered_;  // where gradient_.radiance is
    int renderings_ = 0;
};

// By how much a step from there should lower the loss.
double promised_gain(const PhotoEquations& equations);

// The noise scale that the residuals show: 1.4826 times the median of their size, that of a normal
// distribution. Where the camera knows its noise, 1 unless it is larger by three of its own
// standard errors; else not below 0.2 gray.
double noise_scale_of(const PhotoPlace& place, bool knows_noise);

// Towards the photograph from a start whose residuals may be far above the noise: all pixels count,
// as in least squares, until the steps are small against what is left.
PhotoPlace approached(PhotometricSteps& steps, const PhotoState& start);

}  // namespace etalon
