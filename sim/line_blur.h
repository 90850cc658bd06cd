// The blur of an image that moves along a straight line while the shutter is open: a filter for
// images that are already rendered, at a thousandth of the cost of render_moving()
// (sim/motion_blur.h), which is exact.
//
// The filter is the mean of the interpolated image along the line, integrated exactly: the taps are
// the line integrals of the interpolation's weights, so lengths and directions are not rounded to
// pixels. Interpolated by cubic convolution (Keys, IEEE Trans. ASSP 29, 1981, a = -1/2), which
// reproduces second-order polynomials: the taps have the line's own mean, 0, and covariance,
// m m^T / 12 for the motion m. Bilinear weights would add 1/6 px^2 to it.
//
// What it cannot know is the image between the pixels. Of an edge as sharp as pixels can see it
// (no lens, no diffraction) the result is wrong by up to 0.03 of the contrast, with a lens' blur
// much less; overshoot included. A test measures both.
#pragma once

#include <Eigen/Core>

#include "core/image.h"

namespace etalon {

// The image of the same size, moved from -motion/2 to +motion/2 (px, x right, y down). Beyond the
// border the image goes on as at the border. Where all that the line meets is even the result is
// the image to the last bit; elsewhere it is right to float rounding. A motion of zero gives the
// image itself, not a copy.
// Needs CV_32FC1 and a finite motion. CPU time about TODO, for the pixels that are not of the
// even background only.
Radiance line_blurred(const Radiance& radiance, const Eigen::Vector2d& motion_px);

}  // namespace etalon
