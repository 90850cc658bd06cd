// One photograph against its rendering, twice: at the pose that was given, where only the
// photometric model is fitted, and at the photometric pose. Everything is fitted on one half of the
// marker's cells; the other half is scored. Perspective cameras.
#pragma once

#include <string>
#include <vector>

#include "compare/photometric/photometric_detector.h"

namespace etalon {

// Residuals of photographs are in gray = code value / full scale * 255, behind the tone curve.
struct ResidualStatistics {
    int pixels = 0;
    double mean_gray = 0.0;   // signed
    double rms_gray = 0.0;    // about zero
    double p99_gray = 0.0;    // 99 % of the absolute residuals are at most this
    double worst_gray = 0.0;  // the largest absolute residual
    // Proportion of pixels over three standard deviations of the noise: 0.0027 is pure noise.
    std::optional<double> significant;
};

enum class NoiseSource {
    camera,     // shot, read and rounding noise of the camera's file, by gray
    residuals,  // one standard deviation, robustly from the fitted half of this image
};

struct MatchParameter {
    std::string name;  // "black level", "width of the blur", ...
    double value = 0.0;
    // Standard deviation, the other fitted parameters marginalised; nothing where not known.
    std::optional<double> deviation;
    std::string unit;    // "gray", "px", ""
    const char* source;  // of a number that a rendering needs: "calibration" or "this image"
};

// A photograph with its rendering at one pose, pixel by pixel.
struct PhotoFit {
    PhotoState state;      // fitted on one half of the marker's cells
    cv::Mat predicted;     // CV_32FC1, gray: what the photograph should have been
    cv::Mat residual;      // CV_32FC1, gray: photograph - predicted, everywhere in the image
    cv::Mat significance;  // CV_32FC1: residual / standard deviation of the noise
    cv::Mat use;           // CV_8UC1 of PixelUse
    NoiseSource noise_source = NoiseSource::residuals;
    double noise_gray = 0.0;                 // its standard deviation, RMS over the scored pixels
    ResidualStatistics fitted, scored;       // of the two halves; the scored one is reported
    std::vector<MatchParameter> parameters;  // photometric ones, fitted to this image
};

// Standard deviation of a pixel's noise in gray at a noise-free gray: shot and read noise behind
// the transfer curve, and rounding (EMVA 1288). Nothing when the sensor section gives no gain.
std::optional<double> noise_gray(const Sensor& sensor, double gray);

struct PhotoMatch {
    PhotoFit calibrated;                      // at the pose that was given
    PhotoFit refined;                         // at the photometric pose
    PhotometricPose pose;                     // of the refined fit, with its covariance
    std::vector<MatchParameter> calibration;  // what the renderings took from the camera's file
};

// Intrinsics, distortion, lens and sensor as far as the camera has them, with the deviations that
// its file states.
std::vector<MatchParameter> calibration_parameters(const CameraModel& camera);

// Black and white surfaces of second order; a Gaussian's widths along x and y where the camera has
// no lens section; a saturation's level and knee where 5 % of the fitted pixels are above 230 gray.
PhotometricTerms match_terms(const PhotoOfMarker& photo, const CameraModel& camera);

// The photometric model alone, at a pose that is held. `photo.use` is that of pixel_uses(). Throws
// NumericalError when the pixels do not determine it. Safe from every thread.
PhotoFit fit_photometry(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                        const Rigid& camera_from_marker);

// `background`: the radiance around the marker, whose white is 1. Throws NumericalError when no
// part of the marker is inside the image, or the pixels do not determine the unknowns. Under a
// second of CPU time for a board that fills 640x480 px. Safe from every thread.
PhotoMatch match_photo(const CodeImage& photo, const CellGrid& marker, const ComparedArea& area,
                       const std::shared_ptr<const PhotometricCamera>& camera,
                       const Rigid& camera_from_marker, double background = 1.0);

}  // namespace etalon
