// How the lens spreads a point, one pattern for the image: the Airy pattern (Born and Wolf,
// Principles of Optics, 8.5.2), a Gaussian in its place, or a measured radial profile in place of
// diffraction and defocus (straight lines of density, nothing beyond the last). Formulas:
// docs/rendering.md, "Point spread". Radii are lengths on the sensor in pixel pitches along x: a
// pattern is round.
#pragma once

#include "calib/camera/camera_model.h"

namespace etalon {

// lambda N_w in pixel pitches. Throws NumericalError without a lens.
double lambda_n_px(const CameraModel& camera);

class PointSpreadFunction {
public:
    static PointSpreadFunction airy(double lambda_n_px);  // lambda N_w / pitch
    static PointSpreadFunction gaussian(double sigma_px);

    // Of (radius px, density): at least 4 rows, radii rising strictly from 0, densities not
    // negative and with some energy, all finite (NumericalError otherwise). Normalised to energy 1.
    static PointSpreadFunction measured(const std::vector<std::pair<double, double>>& profile);

    // Of the camera's lens section. Throws NumericalError for an impossible wavelength or sigma,
    // and for the wave-optical model, whose pattern depends on the defocus.
    static PointSpreadFunction of(const CameraModel& camera);

    bool is_airy() const { return kind_ == Kind::airy; }

    // lambda N_w (the finest detail is 1 / scale_px cycles per pixel), sigma, or the shortest step
    // between the profile's radii; px.
    double scale_px() const { return scale_px_; }

    // Energy per px^2 at the radius r >= 0; the whole plane holds 1.
    double density(double r) const;

    // The same averaged over the rings: for r far beyond them, smooth. Airy only.
    double ring_average_density(double r) const;

    // Energy within the radius r (Airy: 1 - J0(x)^2 - J1(x)^2).
    double energy_within(double r) const;

    // Whether there is a spatial frequency beyond which (almost) nothing is left, 1 / scale_px or
    // so: not known of a measured profile.
    bool has_cutoff() const { return kind_ != Kind::measured; }

    // Radius beyond which this part of the energy lies, 0 < energy < 1 (Airy: on average over the
    // rings, for parts of a few per cent or less).
    double radius_of_tail(double energy) const;

private:
    enum class Kind { airy, gaussian, measured };
    struct Ring {  // energy within r, and the density from there on: density + slope (s - r)
        double r, energy, density, slope;
    };

    PointSpreadFunction(Kind kind, double scale_px) : kind_(kind), scale_px_(scale_px) {}

    const Ring& ring_at(double r) const;

    Kind kind_;
    double scale_px_;
    std::vector<Ring> rings_;  // of a profile; the last begins at its last radius
};

}  // namespace etalon
