// How the rendering of a planar marker changes with the marker's pose and with the camera's
// parameters, for fits of renderings to photographs.
//
// Whatever moves a flat marker, or bends its image, displaces what each pixel sees: with q'(pixel)
// the derivative of the displacement by a parameter, in px,
//     d radiance / d parameter = -(gradient of the rendering) . q'.
// The gradient is of the image that the pixels integrate: the marker is displaced in its own plane
// by +- 0.1 px, which changes nothing else of its image, and the two directions in the plane are
// turned into those of the image. One renderer does it all. Filters on the pixel grid would do with
// one rendering, but a pixel's box lets structure pass that they cannot see: with a Gaussian PSF of
// 0.5 px the best filter of nine taps is wrong by 11 % (RMS), this by 0.3 %.
// Left out: that the blur does not grow with the marker, and changes with its depth: 2 % (RMS) of
// the derivatives by depth and tilt for a marker of 70 px, 8 % of that by k3. Across an edge it is
// even where displacement is odd, so that a fit's steps and covariance hardly see it.
//
// Perspective cameras.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "calib/camera/projector.h"
#include "calib/intrinsics/calibration_model.h"
#include "core/geometry/rigid.h"
#include "sim/render/renderer.h"

namespace etalon {

// The displacement of what the pixels see by a small left perturbation of the marker's pose (rx ry
// rz tx ty tz: px per rad and px per mm) and by the camera's parameters. Evaluated every 4 px and
// interpolated linearly: right to 1e-3 of the largest displacement in the image. About 0.3 us a
// node.
class ImageMotion {
public:
    // `parameters` may be empty. The field covers `region`, which is not empty. Throws
    // NumericalError for a telecentric camera.
    ImageMotion(const Projector& projector, const Rigid& camera_from_marker,
                const CalibrationModel& parameters, const cv::Rect& region);

    int columns() const { return columns_; }  // parameters first, then the pose's six
    const cv::Rect& region() const { return region_; }

    // One column each, px per unit of the parameter; false (and nothing written) where a ray is
    // missing nearby, or does not meet the marker's plane in front of the camera.
    bool at(int x, int y, Eigen::Ref<Eigen::Matrix2Xd> motion) const;

private:
    void evaluate(const Projector& projector, const Rigid& camera_from_marker,
                  const CalibrationModel& parameters, int node_x, int node_y);
    Eigen::Map<const Eigen::Matrix2Xd> node(std::size_t index) const {
        return {&nodes_[index * static_cast<std::size_t>(2 * columns_)], 2, columns_};
    }

    static constexpr int spacing_px_ = 4;

    cv::Rect region_;
    int columns_, nodes_per_row_;
    std::vector<double> nodes_;  // 2 x columns each
    std::vector<char> seen_;     // by node: there is a ray
};

// CV_32FC1 of the region's size.
struct RenderedGradient {
    Radiance radiance;
    cv::Mat by_x, by_y;  // d radiance / d position, per px
};

// Renderings with the marker displaced by 0.1 px: to both sides, five in all, or to one side,
// three: the gradient of a place 0.05 px aside, enough for a search.
enum class Differences { central, forward };

// Of the region of `motion`, which is that of this marker's pose. 0 where there is no motion.
// Throws NumericalError when the region's middle sees nothing of the marker's plane, and what the
// renderer throws. Safe from every thread.
RenderedGradient rendered_gradient(const Renderer& renderer, const PlacedMarker& marker,
                                   double background, const ImageMotion& motion,
                                   double tolerance_gray,
                                   Differences differences = Differences::central);

}  // namespace etalon
