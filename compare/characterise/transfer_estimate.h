// The transfer curve T from photographs of one still scene at several exposure times: code value
// from light, without a light meter, because light on the sensor is proportional to the time.
//
//     code = black + (full scale - black) T(E t)      (sim/sensor/sensor_model.h)
//
// Uniform patches of the scene are followed through the series, each with its unknown irradiance E.
// Candidates, by Schwarz's criterion (BIC): a straight line, Rec. 709, and a monotone curve (its
// inverse as a cubic B-spline in T). A known curve is kept while its residuals are at most a fifth
// larger than those of the free one. Radiance 1 is where the curve reaches saturation. Beyond the
// brightest code seen it keeps its bend, whose whole effect counts as uncertainty. After Debevec
// and Malik (SIGGRAPH 1997). Relies on exposure times as commanded and on steady light.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "calib/camera/camera_model.h"

namespace etalon {

struct ExposedPhoto {
    CodeImage image;
    double exposure_us = 0.0;
    std::string name;
};

struct TransferCandidate {
    Transfer::Kind kind;
    double chi_square = 0.0, information_criterion = 0.0;
    int parameters = 0, degrees_of_freedom = 0;
};

// A patch in one photograph: the radiance that the fit found for it, and its code (T).
struct TransferPoint {
    double radiance, code, standard_uncertainty;
};

struct TransferEstimate {
    Transfer transfer;  // of the chosen kind; a table has 129 knots
    // Of each knot's code, parts of full scale; empty unless it is a table.
    std::vector<double> code_standard_uncertainty;
    std::vector<TransferCandidate> candidates;  // linear, Rec. 709, table
    // Largest departure of the free curve from the best straight line through black, parts of full
    // scale.
    double nonlinearity = 0.0, nonlinearity_standard_uncertainty = 0.0;
    double lowest_code = 0.0, highest_code = 0.0;  // seen, as T
    int saturation_code = 0;
    std::optional<double> light_drift;  // largest relative change between equal exposure times
    int patches = 0, photos = 0;
    std::vector<TransferPoint> points;
};

// `sensor` gives bits, mosaic and black level; its transfer is not used. At least 4 exposure times
// over a factor of 4. Throws NumericalError with the values for fewer, for different sizes, a time
// that is not positive, light that drifts by over 1 % between equal times, fewer than 4 uniform
// patches, photographs that all stay below half of full scale, and a curve that does not rise.
// About 10 ns a pixel and photograph, and a second for the fits. Safe from every thread.
TransferEstimate estimate_transfer(std::span<const ExposedPhoto> photos, const Sensor& sensor,
                                   double black_standard_uncertainty_dn);

}  // namespace etalon
