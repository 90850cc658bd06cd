// Pictures of how a photograph and its rendering differ, for people: red where the photograph is
// brighter, cyan where the rendering is.
//
// Images in and out have the photograph's size; gray = code value / full scale * 255. Safe from
// every thread.
#pragma once

#include <opencv2/core.hpp>

namespace etalon {

// CV_8UC3 (BGR): red = mean + gain * difference / 2, green and blue = mean - gain * difference / 2,
// cut at 0 and 255. With gain 1 red is the photograph and cyan the rendering; equal pixels are gray
// at every gain. Where `mask` (CV_8UC1) is 0 there is no rendering worth showing: there stands the
// photograph alone, washed out. The images are CV_32FC1; throws NumericalError when sizes or types
// differ.
cv::Mat red_cyan_overlay(const cv::Mat& photo_gray, const cv::Mat& render_gray, const cv::Mat& mask,
                         double gain);

// CV_8UC3 (BGR) of photo - render (CV_32FC1, gray): white at 0, full red at +full_scale_gray and
// beyond, full cyan at -full_scale_gray and beyond, linear between; light gray where `mask`
// (CV_8UC1) is 0. Throws NumericalError when sizes or types differ or the scale is not positive.
cv::Mat residual_map(const cv::Mat& residual_gray, const cv::Mat& mask, double full_scale_gray);

}  // namespace etalon
