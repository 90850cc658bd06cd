// Filters of the wave-optical point spread (sim/psf/wave_point_spread.h) at any blur radius:
// pixel box convolved with the pattern, in two levels. The core is filtered at k box averages a
// pixel, by product integration against their 6-point Lagrange interpolant; the rest of the
// pattern, the mean over its rings, on pixel averages. Core and tail together hold the energy 1.
//
// One per camera. Kernels are built when first asked for and kept. Safe from every thread.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <opencv2/core.hpp>

#include "calib/camera/camera_model.h"
#include "sim/psf/wave_point_spread.h"

namespace etalon {

class WaveFilter {
public:
    // Throws NumericalError for a camera without a lens section, or lambda N_w too small for blur
    // radii up to max_wave_blur_px.
    explicit WaveFilter(const CameraModel& camera);

    double lambda_n_px() const { return lambda_n_px_; }
    double pitch_y() const { return pitch_y_; }  // a pixel's height in units of its width

    // Steps of the blur radius between kernels. The phases of the pattern's integral turn by 1/8
    // from one to the next: straight lines between them are off by 3e-4 of the peak in focus.
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
