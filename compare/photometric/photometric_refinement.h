// Intrinsics from all pixels of the calibration photographs instead of their corners: the
// parameters for which the renderings are closest to the photographs.
//
// Bundle adjustment on pixels: each photograph's own unknowns are eliminated (Schur complement),
// with Levenberg and Marquardt's damping and Huber's loss. These are its pose, black and white
// surfaces of second order, a tone, and a Gaussian's width where the camera has no lens section.
// The start's edges must be within about a blur width of the photograph's.
//
// A curled board, JPEG or sharpening disturb a rendering more than corners. So the refined camera
// must be better on photographs that it has not seen (k-fold cross-validation, Stone 1974):
//   1. both cameras come from the training photographs, one from their corners, the other refined
//      from it on their pixels;
//   2. the held-out photograph's pose and photometric model are fitted on half of its squares;
//   3. the residuals of the other half are compared, paired by photograph. The gain must be above
//      zero by a one-sided t test at 95 % (approximately: the folds share training photographs;
//      Bengio and Grandvalet, JMLR 5, 2004).
#pragma once

#include <span>
#include <string>
#include <vector>

#include "calib/intrinsics/calibration_covariance.h"
#include "compare/photometric/compared_area.h"

namespace etalon {

struct RefinedPhoto {
    // RMS over the scored squares of the held-out photograph, with either camera.
    double corners_rms_gray = 0.0, refined_rms_gray = 0.0;
    Rigid camera_from_target;  // with the camera refined on all photographs
};

struct PhotometricRefinement {
    CameraModel camera;                          // with covariance
    std::vector<ParameterDeviation> deviations;  // formal and cluster-robust, in the model's order
    std::vector<RefinedPhoto> photos;            // as given
    double corners_rms_gray = 0.0, refined_rms_gray = 0.0;  // means over the photographs
    double gain_gray = 0.0;                                 // mean difference
    double gain_error_gray = 0.0;                           // its standard error
    double least_gain_gray = 0.0;  // lower end of the one-sided 95 % interval
    static constexpr int folds = 5;
    bool accepted = false;  // least_gain_gray > 0

    // "held-out residual 6.43 -> 6.41 gray over 13 photos, gain 0.02 +- 0.01 (95 % at least 0.00):
    // accepted"
    std::string in_words() const;
};

// `corners` is fit_camera()'s result for all views, one for each photograph, with this model. The
// covariance takes photographs as independent, not pixels. Throws NumericalError for fewer than six
// photographs, numbers that do not match, and photographs that do not determine the camera. About
// 5 s of CPU time per photograph of 640x480 px, on all cores; the result does not depend on them.
PhotometricRefinement refine_photometrically(std::span<const CodeImage> photos,
                                             std::span<const CalibrationView> views,
                                             const CellGrid& target, const ComparedArea& area,
                                             const CameraFit& corners,
                                             const CalibrationModel& model);

}  // namespace etalon
