// The wave-optical image of a point out of focus, where disk and Airy pattern convolved are only an
// approximation. docs/rendering.md, "Wave optics", has the integral |U|^2 (u, v). In Lommel's
// functions (Born and Wolf, Principles of Optics, 8.8.1)
//     outside the disk  |U|^2 = (2/u)^2 (U1^2 + U2^2)
//     inside            |U|^2 = (2/u)^2 (1 + V0^2 + V1^2 - 2 V0 cos s - 2 V1 sin s),
//                       s = (u + v^2/u) / 2
// whose series of Bessel functions are summed to rounding. Beyond the disk of radius R, averaged
// over the rings, the density is (lambda N_w / (pi^3 r^3)) (1 + q^2) / (1 - q^2)^2, q = R/r, and
// 2 lambda N_w r / (pi^2 (r^2 - R^2)) of the energy lies outside r: Airy's tail from q -> 0.
//
// Lengths in units of the pixel pitch along x, as in sim/psf/diffraction.h.
#pragma once

#include "calib/camera/camera_model.h"

namespace etalon {

// The renderers go no farther: there geometrical optics is right.
inline constexpr double max_wave_blur_px = 20.0;

// |U|^2 for u, v >= 0, relative to the centre of the Airy pattern (u = v = 0: 1). Some us; absolute
// error below 1e-12 for u and v up to 1000.
double wave_intensity(double u, double v);

// At one blur radius. Tabulated in v to where the mean over the rings takes over; 1 to 30 ms to
// build. Immutable.
class WavePointSpread {
public:
    // lambda N_w > 0 and the blur radius R >= 0, px. Throws NumericalError for other numbers and
    // for R above 600 lambda N_w, where geometrical optics is right.
    WavePointSpread(double lambda_n_px, double blur_radius_px);

    double blur_radius_px() const { return blur_radius_px_; }

    // Energy per px^2 at r >= 0: exact within the table, beyond it the mean over the rings. The
    // whole plane holds 1.
    double density(double r) const;

    // Energy within r >= 0; to 1e-6, cubic between the table's rows.
    double energy_within(double r) const;

    // The radius that holds this energy, 0 <= energy < 1; inverts energy_within().
    double radius_of(double energy) const;

    // Beyond this radius all is the mean over the rings; px.
    double table_end_px() const;

private:
    double scale_;  // pi / (lambda N_w): v = scale r
    double blur_radius_px_;
    double u_;
    std::vector<double> intensity_;  // |U|^2 at v = i step
    std::vector<double> energy_;     // within it
    double closing_;                 // energy not in the table, relative to the asymptote's
};

// The patterns of one lens over blur radii, with straight lines between steps of 0.1 in u. Each is
// built when first asked for. Safe from every thread.
class WaveTable {
public:
    // Radii from 0 to `largest_blur_px`. Throws NumericalError as WavePointSpread.
    WaveTable(double lambda_n_px, double largest_blur_px);

    // The radius that holds this energy at a blur radius (beyond the largest: at the largest).
    double radius_of(double energy, double blur_radius_px) const;

private:
    struct Entry {
        std::once_flag once;
        std::unique_ptr<const WavePointSpread> psf;
    };

    const WavePointSpread& entry(std::size_t i) const;

    double lambda_n_px_, step_px_;
    mutable std::vector<Entry> entries_;
};

// Filters of the pattern at any blur radius: pixel box convolved with it. The core is for k box
// averages a pixel, against their 6-point Lagrange interpolant; the rest, its mean over the rings,
// for pixel averages; energy 1 together. One per camera; kernels are built on demand and kept.
// Every thread.
class WaveFilter {
public:
    // Throws NumericalError for a camera without a lens section, or lambda N_w too small for blur
    // radii up to max_wave_blur_px.
    explicit WaveFilter(const CameraModel& camera);

    double lambda_n_px() const { return lambda_n_px_; }
    double pitch_y() const { return pitch_y_; }  // a pixel's height in units of its width

    // Between kernels; straight lines between them are off by 3e-4 of the peak in focus.
    double blur_step_px() const;

    // The core at the blur radius index * blur_step_px(): CV_32FC1 with k + 2 core_reach() rows and
    // columns, for the box averages in and around one pixel.
    const cv::Mat& core(int k, int index) const;

    // Box averages that a core looks beyond its pixel on each side of x (width) and y (height).
    cv::Size core_reach(int k, int index) const;

    // The tail on pixel averages, CV_32FC1 of 2 half + 1 columns and rows.
    cv::Mat tail(double blur_radius_px, const cv::Size& half) const;

private:
    double core_radius_px(int index) const;
    double window(double blur_radius_px, double r) const;
    double core_energy(const WavePointSpread& psf) const;
    cv::Mat make_core(int k, int index) const;

    double lambda_n_px_, pitch_y_, ring_px_;
    mutable std::mutex mutex_;
    mutable std::map<std::pair<int, int>, std::unique_ptr<const cv::Mat>> cores_;
};

}  // namespace etalon
