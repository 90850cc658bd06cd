// What the pixels of a run's photographs say of its renders beside the pose, as plain data:
// compare/match/pixel_measurement.h measures it, compare/diagnosis/image_agreement.h judges it.
#pragma once

#include <array>

#include "calib/camera/camera_model.h"

namespace etalon {

// Ways in which photographs may deviate from renders wherever the marker is; 0 where the
// calibration is right.
namespace deviation {
inline constexpr int f_number = 0;       // log of the true f-number over the calibration's
inline constexpr int inverse_focus = 1;  // 1/mm: of the focus distances, true less calibration's
inline constexpr int blur = 2;           // px^2: variance of a Gaussian besides; below 0: sharper
inline constexpr int tone = 3;  // t of C(s) = s + t s (1 - s), s between black (0) and white (1)
inline constexpr int print_gain = 4;  // px by which edges lie farther out in the light
inline constexpr int count = 5;
}  // namespace deviation
using PixelDeviation = Eigen::Matrix<double, deviation::count, 1>;
using PixelInformation = Eigen::Matrix<double, deviation::count, deviation::count>;

// Prior standard deviations: e in f-number, 0.01 / mm in focus, 4 px^2 of blur, 1 in tone, 1 px in
// growth.
PixelInformation deviation_prior();

// One photograph against its render at its photometric pose, with a deviation put into the camera.
struct PhotoEvidence {
    double depth_mm = 0.0;  // of the marker
    // Normal equations of the deviations, pose and levels solved beside them, in units of the noise
    // (1 gray where none is stated) times the residuals' scale. 0 for those not asked for.
    PixelInformation information = PixelInformation::Zero();
    PixelDeviation score = PixelDeviation::Zero();
    // The score that a noise larger by the factor e than stated adds, first order (MeanCode).
    PixelDeviation score_by_log_noise = PixelDeviation::Zero();
    // Of a pixel's radiance by a deviation of 1; 0 for the tone.
    PixelDeviation largest_change = PixelDeviation::Zero();
    double loss = 0.0;            // Huber's, over all pixels
    double residual_scale = 1.0;  // 1.4826 times the median size of the residuals; 1 at least
    // Of the pixels with noise well above rounding: how many, the sum of their squared residuals
    // over the stated noise (1 gray where none is stated), and that noise, RMS.
    int pixels = 0;
    double squares = 0.0;
    double noise_gray = 0.0;
    // In flat places, found over stated; nothing where none is stated or it is below rounding.
    std::optional<double> noise_ratio;
    double contrast_gray = 0.0;        // white less black
    std::optional<double> black_gray;  // less the calibration's; nothing without a sensor section
    Eigen::Vector2d shading = Eigen::Vector2d::Zero();  // change of white along the image's width
                                                        // and height, as part of white
    std::optional<double> background_gray;              // beside the marker, less the expected
    double background_by_tone_gray = 0.0;               // that a tone of 1 would add to it
};

// What one photograph alone shows (compare/match/photo_findings.h).
struct PhotoFinding {
    std::string name, sentence;
};

struct RunEvidence {
    PixelDeviation at = PixelDeviation::Zero();  // where the photographs were compared
    std::array<bool, deviation::count> asked = {};
    std::vector<PhotoEvidence> photos;
    // Of every hold-out photograph that was looked at, also of those that `photos` is without.
    std::vector<std::vector<PhotoFinding>> findings;
};

// More than 1 in 20 photographs, and two at least.
bool is_common(int photos, const std::vector<std::vector<PhotoFinding>>& findings);

// White is at the end of the scale in so many photographs that nothing can be measured in them.
bool is_overexposed(const std::vector<std::vector<PhotoFinding>>& findings);

// Standard deviation, px, of a lens' whole blur at a depth, the pixel's box within: the disk's
// radius / 2, an Airy pattern's 0.42 wavelength x f-number. Without a lens section 0.5 px.
double blur_sigma_px(const CameraModel& camera, double depth_mm,
                     const PixelDeviation& deviating = PixelDeviation::Zero());

// The calibration with f-number and focus distance as a deviation says.
CameraModel with_lens(const CameraModel& camera, const PixelDeviation& deviating);

}  // namespace etalon
