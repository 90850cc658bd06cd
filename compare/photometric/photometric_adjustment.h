// Photographs of markers and one camera brought together: the poses, the photometric models and, if
// asked, the camera's parameters for which the renderings are closest to the photographs. Bundle
// adjustment with pixels in place of points: what belongs to one photograph only is eliminated from
// its normal equations (Schur complement), Levenberg and Marquardt's damping, Huber's loss.
//
// Finds the minimum that the start leads to: the start's edges must be within about a blur width of
// the photograph's. See compare/photometric/photometric_pose.h and photometric_refinement.h.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "calib/intrinsics/camera_fit.h"
#include "compare/photometric/photometric_equations.h"

namespace etalon {

struct PhotometricAdjustment {
    std::shared_ptr<const PhotometricCamera> camera;
    std::vector<PhotoState> photos;
    std::vector<PhotoEquations> equations;  // there, by photograph
    int iterations = 0;                     // steps taken
    bool converged = false;                 // the next step is below a hundredth of its uncertainty
};

// The noise scale of each photograph is 1.4826 times the median size of its residuals (that of a
// normal distribution), not below 1 where the camera knows its noise, and found again until it no
// longer changes. `start` holds one state per photograph, `parameters` what is free of the camera
// (may be empty). Same result for any number of threads. Throws NumericalError when the photographs
// do not determine all unknowns, and what photo_equations() throws.
PhotometricAdjustment adjust_to_photos(std::span<const PhotoOfMarker> photos,
                                       std::shared_ptr<const PhotometricCamera> camera,
                                       std::span<const PhotoState> start,
                                       const PhotometricTerms& terms,
                                       const CalibrationModel& parameters);

// What a photograph says of the camera's parameters, pose and photometric model eliminated, in the
// form that covariances are made of (calib/intrinsics/calibration_covariance.h); `rest` is not set.
ViewEquations camera_equations(const PhotoEquations& equations, std::size_t parameters);

}  // namespace etalon
