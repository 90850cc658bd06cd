// The pose at which a marker's rendering matches a photograph: no detector's idea of a corner comes
// into it. Gauss and Newton's method on the pixels, photometric model alongside (compare/
// photometric_adjustment.h).
//
// From a start that is right to about the width of an edge's blur (any detector's is). A planar
// marker has two poses that look alike: give each as a start and compare the losses.
#pragma once

#include <memory>

#include "compare/photometric_adjustment.h"

namespace etalon {

struct PhotometricPose {
    Rigid camera_from_marker;
    // Left perturbation, rot, trans; the photometric parameters marginalised: from the full Fisher
    // matrix at the stated noise, or at that of the residuals where the camera knows none or they
    // are larger. Pixels count as independent: neighbours in a JPEG file are not.
    Matrix6d covariance;
    PhotometricModel photometry;
    double noise_scale = 1.0;      // see PhotometricAdjustment
    double reduced_squares = 0.0;  // mean square of the limited residuals, 1 for pure noise
    double loss = 0.0;             // sum of Huber's function of the residuals over the noise
    int pixels = 0;
    int iterations = 0;
    bool converged = false;
};

// `photo.use` says which pixels: those of pixel_uses() at the start pose, or a part of them. Where
// only a pose is known, starting_state() makes a start of it.
// Throws NumericalError when the pixels do not determine pose and photometric model, or nothing can
// be rendered at the start.
PhotometricPose photometric_pose(const PhotoOfMarker& photo,
                                 std::shared_ptr<const PhotometricCamera> camera,
                                 const PhotoState& start, const PhotometricTerms& terms);

}  // namespace etalon
