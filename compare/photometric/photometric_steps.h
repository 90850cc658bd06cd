// Steps of one photograph's own unknowns (pose and photometric model) towards the least Huber loss:
// Gauss and Newton's, damped where they lead uphill (Levenberg, Marquardt). Each takes one
// rendering. The foundation of compare/photometric/photometric_pose.h and photometric_detector.h.
//
// The gradient comes from central differences on that rendering (wrong by some 10 %: it costs
// steps) until render_gradient() makes it exact; then it is kept. With J kept the steps end at the
// root of J^T r = 0 for the residuals r of the last rendering.
#pragma once

#include <optional>

#include "compare/photometric/photometric_equations.h"

namespace etalon {

struct PhotoPlace {
    PhotoState state;
    PhotoEquations equations;  // there
    double noise_scale = 1.0;  // that they were made with
};

// What the steps of a descent obey; losses and gains are in units of the loss.
struct DescentRule {
    double damping;            // of the first step, relative to the information
    double enough_gain;        // converged where the next step promises less
    double slack;              // a loss that rises by less is not taken as a rise
    double max_damping = 1e3;  // beyond, no better place is near
};

// Another noise scale or photometric model takes no new rendering. Refers to photograph and camera,
// which must outlive it. One thread.
class PhotometricSteps {
public:
    // `near` is about where the steps will be: within some px. Throws as photo_equations() does.
    PhotometricSteps(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                     const PhotometricTerms& terms, const PhotoState& near);

    PhotoPlace at(const PhotoState& state, double noise_scale);

    // From now on all equations have the gradient of this state: five renderings.
    void render_gradient(const PhotoState& state);

    // Moves the place; whether it converged. Throws NumericalError where the pixels do not
    // determine the unknowns.
    bool descend(PhotoPlace& place, const DescentRule& rule);

    int renderings() const { return renderings_; }

private:
    void render(const Rigid& camera_from_marker);

    const PhotoOfMarker* photo_;
    const PhotometricCamera* camera_;
    PhotometricTerms terms_;
    ImageMotion motion_;
    RenderedGradient gradient_;      // without slopes: central differences
    std::optional<Rigid> rendered_;  // where gradient_.radiance is
    int renderings_ = 0;
};

// The noise scale that the residuals show: 1.4826 times the median of their size, that of a normal
// distribution. Where the camera knows its noise, 1 unless it is larger by three of its own
// standard errors; else not below 0.2 gray.
double noise_scale_of(const PhotoPlace& place, bool knows_noise);

// Towards the photograph from a start whose residuals may be far above the noise: all pixels count,
// as in least squares, until the steps are small against what is left.
PhotoPlace approached(PhotometricSteps& steps, const PhotoState& start);

}  // namespace etalon
