// The blur of an image that moves along a straight line while the shutter is open: a filter for
// images that are already rendered. Exact, at the cost of tens of renders: render_moving()
// (sim/render/motion_blur.h).
//
// The filter is the mean of the interpolated image along the line, integrated exactly: the taps are
// the line integrals of the interpolation's weights, so lengths and directions are not rounded to
// pixels. Interpolated by cubic convolution (Keys, IEEE Trans. ASSP 29, 1981, a = -1/2), which
// reproduces second-order polynomials: the taps have the line's own mean, 0, and covariance,
// m m^T / 12 for the motion m. Bilinear weights would add 1/6 px^2 to it.
//
// What it cannot know is the image between the pixels. Against render_moving(), largest error and
// RMS around a marker's edges, of their contrast: 0.01 and 0.001 with a lens of f/8 on pixels of
// 2.8 um, 0.07 and 0.008 where nothing but the pixels blurs (a test measures both). The edges are
// softer or overshoot by that; they are not displaced, for the filter is even.
#pragma once

#include <Eigen/Core>

#include "core/image/image.h"

namespace etalon {

// The image of the same size, moved from -motion/2 to +motion/2 (px, x right, y down). Beyond the
// border the image goes on as at the border. Where all that the line meets is even the result is
// the image to the last bit; elsewhere it is right to float rounding. A motion of zero gives the
// image itself, not a copy.
// Needs CV_32FC1 and a finite motion. One thread; CPU time of a pixel about 4 ns for 1 px, 14 for
// 20 px and 65 for 100 px, of those only that are not of an even background (the tail of
// diffraction makes all of it uneven).
Radiance line_blurred(const Radiance& radiance, const Eigen::Vector2d& motion_px);

}  // namespace etalon
