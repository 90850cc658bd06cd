// Photograph minus prediction, pixel by pixel, at a pose and photometric model that were fitted on
// one half of the marker's cells (compare/photometric/photo_match.h); what is reported comes from
// the other.
//
// Residuals of photographs are in gray = code value / full scale * 255, behind the tone curve.
#pragma once

#include <optional>

#include "compare/photometric/compared_area.h"
#include "compare/photometric/photometric_equations.h"
#include "compare/photometric/photometric_model.h"
#include "core/image/image.h"

namespace etalon {

struct ResidualStatistics {
    int pixels = 0;
    double mean_gray = 0.0;   // signed
    double rms_gray = 0.0;    // about zero
    double p99_gray = 0.0;    // 99 % of the absolute residuals are at most this
    double worst_gray = 0.0;  // the largest absolute residual
    // Proportion of pixels over three standard deviations of the noise: 0.0027 would be pure noise.
    // Where the noise comes from the residuals themselves it says how far they are from normal.
    std::optional<double> significant;
};

// What residuals are held against.
enum class NoiseSource {
    camera,     // shot, read and rounding noise of the camera's file, by gray
    residuals,  // one standard deviation, robustly from the fitted half of this image
};

struct PixelDifference {
    PhotometricModel model;
    cv::Mat predicted;     // CV_32FC1, gray: what the photograph should have been
    cv::Mat residual;      // CV_32FC1, gray: photograph - predicted, everywhere in the image
    cv::Mat significance;  // CV_32FC1: residual / standard deviation of the noise
    cv::Mat use;           // CV_8UC1 of PixelUse
    NoiseSource noise_source = NoiseSource::residuals;
    double noise_gray = 0.0;  // its standard deviation, RMS over the scored pixels
    ResidualStatistics fitted, scored;
};

// At a state that was fitted. `photo.use` is that of pixel_uses(). Throws NumericalError for sizes
// that differ and what the renderer refuses. Safe from every thread.
PixelDifference difference_at(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                              const PhotoState& state);

// Standard deviation of one pixel's noise in gray at a noise-free value in gray: shot and read
// noise, taken through the transfer curve's slope, and rounding (EMVA 1288's camera model). Nothing
// when the sensor section gives no gain.
std::optional<double> noise_gray(const Sensor& sensor, double gray);

}  // namespace etalon
