// Gain and read noise from photographs of the same still view: the photon transfer method, EMVA
// 1288 release 4, linear (section 6.6). The pixels of a view are sorted by their own mean. The dark
// photographs are the point without light. Black level and transfer curve are undone.
//
//     variance = (read noise / gain)^2 + signal / gain + rounding      [DN^2], signal in DN
//
// Only smooth parts of the view are used. Changes of light up to 2 % and shifts up to 0.25 px are
// taken out.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "calib/camera/camera_model.h"

namespace etalon {

// The mean code value of photographs without light, at the exposure time, gain and temperature of
// the photographs that it is for. EMVA 1288 release 4, section 7. Standard uncertainty: the larger
// of temporal noise over all pixels and scatter of the frames' means, and rounding.
struct BlackLevel {
    double dn = 0.0, standard_uncertainty_dn = 0.0;
    // Of one pixel from frame to frame, rounding included; 0 with one frame.
    double temporal_variance_dn2 = 0.0, temporal_variance_standard_uncertainty = 0.0;
    double fixed_pattern_dn = 0.0;  // DSNU: of the pixels' own means, temporal noise taken out
    double drift_dn = 0.0;          // largest mean of a frame minus the smallest
    int frames = 0;
};

// Throws NumericalError for no frames, different sizes or bits, and with the values when
//  - more than 0.1 % of the pixels are at code 0: the mean of the rest would be too high;
//  - the frames' means drift by more than half the temporal noise (and half a code);
//  - there is light: the pixels' own means differ by more than 3 % of full scale.
// About 2 ns a pixel and frame. Safe from every thread.
BlackLevel measure_black_level(std::span<const CodeImage> dark_frames);

// Photographs with the same settings of the same view, two at least.
using RepeatedView = std::vector<CodeImage>;

struct NoiseLevel {
    double signal_dn = 0.0;     // mean linear signal above black
    double variance_dn2 = 0.0;  // of that signal, rounding taken out
    double standard_uncertainty_dn2 = 0.0;
    double model_dn2 = 0.0;  // what the fit has there
    double pixels = 0.0;
    bool is_used = false;  // not clipped, not lost in the rounding
};

struct PhotonTransfer {
    double gain_e_per_dn = 0.0, gain_standard_uncertainty = 0.0;
    // Nothing when it is not determined; `read_noise_remark` says why.
    std::optional<double> read_noise_e;
    double read_noise_standard_uncertainty_e = 0.0;
    std::string read_noise_remark;
    Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // of (gain, read noise)
    double reduced_chi_square = 0.0;                       // over 1: multiplied into the covariance
    int degrees_of_freedom = 0;
    int saturation_code = 0;
    double brightness_drift = 0.0;   // largest relative difference of two repeats
    double shift_px = 0.0;           // largest displacement of a repeat from their mean
    double noise_correlation = 0.0;  // between neighbouring pixels, the larger of x and y
    std::vector<NoiseLevel> levels;  // ascending; the dark one first, if there is one
};

// The camera's sensor section gives bits, black level, transfer curve and mosaic. Without `dark`
// the read noise is not determined. Throws NumericalError with the values for a view with fewer
// than 2 photographs, different sizes, and when
//  - repeats differ in brightness by over 2 %, are shifted by over 0.25 px, or over 0.1 % of the
//    pixels differ by more than noise: they do not show the same view;
//  - the noise of neighbouring pixels is correlated by over 0.05 (JPEG, interpolated colours,
//    denoising, sharpening);
//  - fewer than 4 levels of 100 pixels are neither clipped nor lost in rounding (variance below
//    0.24 DN^2, as EMVA 1288 has it), or they do not determine the gain to 20 %;
//  - the variance does not follow the model to 10 %.
// About 30 ns a pixel and photograph. Safe from every thread.
PhotonTransfer measure_photon_transfer(std::span<const RepeatedView> views,
                                       const CameraModel& camera,
                                       const std::optional<BlackLevel>& dark);

}  // namespace etalon
