// From samples of the aperture average to pixels: convolution with (pixel box * point spread),
// split by radius into a core, filtered at k samples per pixel, and the diffraction tail, filtered
// on coarser grids (1 px; 8 px).
//
// Weights by product integration: the samples are interpolated by the 6-point Lagrange kernel and
// the interpolant is integrated against the kernel. Each level's weights sum to the energy that its
// ring of radii holds.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "calib/camera_model.h"
#include "sim/diffraction.h"

namespace etalon {

enum class SampleKind {
    point,  // values at the centres of a pixel's k x k parts
    box,    // averages over them
};

// Weights for the samples around one output pixel: pixel p is the sum over the samples
// k p - reach ... k p + k - 1 + reach of each direction.
struct CoreKernel {
    int k = 1;
    int reach_x = 0, reach_y = 0;  // samples beyond the pixel's own
    cv::Mat weights;               // CV_32FC1, (2 reach_y + k) x (2 reach_x + k)
};

// Smooth ring of radii: 0 up to rise_from, 1 from rise_to to fall_from, 0 from fall_to.
struct RadialWindow {
    double rise_from = -1, rise_to = -1, fall_from, fall_to;

    double operator()(double r) const;
};

// Safe from every thread.
class ImageFilter {
public:
    static constexpr int block_px = 8;  // grid of the far tail

    // No lens section: pixels are box averages, no tail.
    explicit ImageFilter(const CameraModel& camera);

    bool has_point_spread() const { return psf_.has_value(); }
    bool has_near_tail() const { return near_.has_value(); }
    bool has_far_tail() const { return far_.has_value(); }
    // How far from a pixel the near tail reaches, px along x and y (the larger).
    int near_reach_px() const;
    // The same for everything but the far tail.
    int reach_px() const;

    const CoreKernel& core(int k, SampleKind kind) const;

    // Odd-sized CV_32FC1 kernel on pixel averages; needs has_near_tail().
    const cv::Mat& near_kernel() const;

    // The same on averages over blocks of 8 x 8 px, out to `reach_px`; needs has_far_tail().
    cv::Mat far_kernel(double reach_px) const;

    // Radius beyond which this small part of a point's energy lies, px along x.
    double radius_of_tail(double energy) const { return psf_->radius_of_tail(energy); }

private:
    std::optional<PointSpreadFunction> psf_;
    double pitch_y_ = 1.0;  // a pixel's height in units of its width
    std::optional<RadialWindow> core_, near_, far_;
    mutable std::mutex mutex_;
    mutable std::map<std::pair<int, SampleKind>, std::unique_ptr<const CoreKernel>> cores_;
    mutable cv::Mat near_kernel_;
};

// Convolution with a kernel of odd size, zero outside `image` (CV_32FC1), same size. By FFT.
cv::Mat convolve(const cv::Mat& image, const cv::Mat& kernel);

}  // namespace etalon
