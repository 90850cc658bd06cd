// How the rendering of a planar marker changes with the marker's pose and with the camera's
// parameters, for fits of renderings to photographs.
//
// Whatever moves a flat marker, or bends its image, displaces what each pixel sees: with q'(pixel)
// the derivative of the displacement by a parameter, in px,
//     d radiance / d parameter = -(gradient of the rendering) . q'.
// The gradient is of the image that the pixels integrate, taken from renderings displaced by
// +- 0.1 px (the principal point moves, and all of the image with it). Filters on the pixel grid
// would do with one rendering, but a pixel's box lets structure pass that they cannot see: with a
// Gaussian PSF of 0.5 px the best filter of nine taps is wrong by 11 % (RMS), this by 0.3 %.
// Left out: that the blur does not grow with the marker, and changes with its depth: 2 % (RMS) of
// the derivatives by depth and tilt for a marker of 70 px, 8 % of that by k3. Across an edge it is
// even where displacement is odd, so that a fit's steps and covariance hardly see it.
//
// Perspective cameras.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "calib/calibration_model.h"
#include "calib/projector.h"
#include "core/rigid.h"
#include "sim/renderer.h"

namespace etalon {

// CV_32FC1 of the camera's size, right within the region that was asked for.
struct RenderedGradient {
    Radiance radiance;
    cv::Mat by_x, by_y;  // d radiance / d position, per px
};

// Five renderers of one camera; see sim/renderer.h for what a rendering costs and throws. Safe from
// every thread once built.
class GradientRenderer {
public:
    explicit GradientRenderer(const CameraModel& camera);

    const Renderer& renderer() const { return centre_; }
    RenderedGradient render(const Scene& scene, const RenderOptions& options = {}) const;

private:
    static constexpr double shift_px_ = 0.1;

    Renderer centre_;
    std::array<Renderer, 2> by_x_, by_y_;  // image moved by -shift, +shift
};

// The displacement of what the pixels see by a small left perturbation of the marker's pose (rx ry
// rz tx ty tz: px per rad and px per mm) and by the camera's parameters. Evaluated every 4 px and
// interpolated linearly: right to 1e-3 of the largest displacement in the image.
class ImageMotion {
public:
    // `parameters` may be empty. The field covers `region`, which is not empty. Throws
    // NumericalError for a telecentric camera.
    ImageMotion(const Projector& projector, const Rigid& camera_from_marker,
                const CalibrationModel& parameters, const cv::Rect& region);

    int columns() const { return columns_; }  // parameters first, then the pose's six

    // One column each, px per unit of the parameter; false (and nothing written) where a ray is
    // missing nearby, or does not meet the marker's plane in front of the camera.
    bool at(int x, int y, Eigen::Ref<Eigen::Matrix2Xd> motion) const;

private:
    void evaluate(const Projector& projector, const Rigid& camera_from_marker,
                  const CalibrationModel& parameters, int node_x, int node_y);
    const Eigen::Matrix2Xd& node(int x, int y) const {
        return nodes_[static_cast<std::size_t>(y * nodes_per_row_ + x)];
    }

    static constexpr int spacing_px_ = 4;

    cv::Rect region_;
    int columns_, nodes_per_row_;
    std::vector<Eigen::Matrix2Xd> nodes_;  // no columns: no ray
};

}  // namespace etalon
