// How the lens spreads a point that is in focus: the Airy pattern, or a Gaussian in its place.
//
// Airy (Born and Wolf, Principles of Optics, 8.5.2): with x = pi r / (lambda N_w), the energy per
// area is J1(x)^2 / (pi r^2) and the energy within r is 1 - J0(x)^2 - J1(x)^2. Its tail is long:
// on average over the rings lambda N_w / (pi^3 r^3), so 2 lambda N_w / (pi^2 r) lies beyond r.
//
// Radii are lengths on the sensor in units of the pixel pitch along x, so that a pattern is round
// whatever the pixels' shape.
#pragma once

#include "calib/camera_model.h"

namespace etalon {

class PointSpreadFunction {
public:
    static PointSpreadFunction airy(double lambda_n_px);  // lambda N_w / pitch
    static PointSpreadFunction gaussian(double sigma_px);

    // Of the camera's lens section. Throws NumericalError for a wavelength or sigma that is not
    // positive and finite.
    static PointSpreadFunction of(const CameraModel& camera);

    bool is_airy() const { return is_airy_; }

    // lambda N_w (the finest detail is 1 / scale_px cycles per pixel), or sigma; px.
    double scale_px() const { return scale_px_; }

    // Energy per px^2 at the radius r >= 0; the whole plane holds 1.
    double density(double r) const;

    // The same averaged over the rings: for r far beyond them, smooth. Airy only.
    double ring_average_density(double r) const;

    // Energy within the radius r: 1 - J0(x)^2 - J1(x)^2.
    double energy_within(double r) const;

    // Radius beyond which this part of the energy lies (Airy: on average over the rings, for parts
    // of a few per cent or less).
    double radius_of_tail(double energy) const;

private:
    PointSpreadFunction(bool is_airy, double scale_px) : is_airy_(is_airy), scale_px_(scale_px) {}

    bool is_airy_;
    double scale_px_;
};

}  // namespace etalon
