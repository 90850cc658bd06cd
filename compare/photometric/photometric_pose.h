// The pose at which a marker's rendering matches a photograph: no detector's idea of a corner comes
// into it. Gauss and Newton's method on the pixels, photometric model alongside.
//
// Two stages. The approach takes one rendering a step and central differences on it for the
// gradient: wrong by some 10 %, which costs steps, not accuracy. At its end the gradient is
// rendered (compare/photometric/render_derivatives.h) and kept; the last steps bring J^T r to
// zero with that J, and the covariance is made of (J^T J)^-1. Nothing of the approach is left in
// the result.
//
// A planar marker has two poses that look alike: the tilt mirrored about the line of sight. The
// other one is sought by geometry, from the points of the pattern, and rendered once; it is fitted
// where a step promises to bring its loss near the first one's. The one with the lower loss is the
// result, the other is stated with it.
//
// From a start whose edges are within about a blur width of the photograph's (any detector's is);
// compare/photometric/photometric_detector.h starts from farther away.
#pragma once

#include <memory>
#include <optional>

#include "compare/photometric/photometric_equations.h"

namespace etalon {

// The other planar solution, on the same pixels at the same noise; where there is no doubt, as
// geometry has it.
struct OtherPose {
    Rigid camera_from_marker;
    double loss = 0.0;
    // Of the better pose to this one: the difference of the losses. With 3 the other one would be
    // true in 1 of 20 cases; beyond 20 there is no doubt.
    double log_likelihood_ratio = 0.0;
};

struct PhotometricPose {
    Rigid camera_from_marker;
    // Left perturbation, rot, trans; the photometric parameters marginalised: from the full Fisher
    // matrix at the stated noise, or at that of the residuals where the camera knows none or they
    // are larger; widened where the residuals of parts of the picture (10 x 10 of the marker's box)
    // pull at the pose more than independent pixels would (core/statistics/covariance.h).
    // Neighbouring parts of a bent print pull alike: deviations may then still be too small by
    // half. It does not hold what pulls all parts alike: a wrong calibration, or the size of the
    // print.
    Matrix6d covariance;
    PhotometricModel photometry;
    // In units of the known noise, or gray. 1.4826 times the median size of the residuals; 1 where
    // the camera knows its noise and that is not larger by three of its own standard errors.
    double noise_scale = 1.0;
    double reduced_squares = 0.0;  // mean square of the limited residuals, 1 for pure noise
    double loss = 0.0;             // sum of Huber's function of the residuals over the noise
    int pixels = 0;
    int renderings = 0;  // that it took, both solutions together
    // The next step is below a hundredth of its formal uncertainty, or, where a picture that no
    // model fits has a far larger one, below a tenth of the stated one.
    bool converged = false;
    // Nothing where both starts end in one pose: the marker is seen frontally.
    std::optional<OtherPose> other;
};

// `photo.use` says which pixels: those of pixel_uses() at the start pose, or a part of them. Where
// only a pose is known, starting_state() makes a start of it.
// Throws NumericalError when the pixels do not determine pose and photometric model, or nothing can
// be rendered at the start. For a tag of 900 to 22 000 px in a VGA image 3 to 30 ms of CPU time
// (tests/evidence/photometric_pose.cpp has it beside a detector's).
PhotometricPose photometric_pose(const PhotoOfMarker& photo,
                                 std::shared_ptr<const PhotometricCamera> camera,
                                 const PhotoState& start, const PhotometricTerms& terms);

// The pose with the marker's tilt mirrored about the line of sight to the middle of its grid.
Rigid tilt_mirrored(const Rigid& camera_from_marker, const CellGrid& grid);

}  // namespace etalon
