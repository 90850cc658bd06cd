// Pictures of how a photograph and its rendering differ: red where the photograph is brighter, cyan
// where the rendering is. All images have the photograph's size; gray = code value / full scale *
// 255. Sizes or types that differ throw NumericalError. Safe from every thread.
#pragma once

#include <opencv2/core.hpp>

namespace etalon {

// CV_8UC3 (BGR) of CV_32FC1: red = mean + gain * difference / 2, green and blue = mean - gain *
// difference / 2, cut at 0 and 255. Where `mask` (CV_8UC1) is 0: the photograph alone, washed out.
cv::Mat red_cyan_overlay(const cv::Mat& photo_gray, const cv::Mat& render_gray, const cv::Mat& mask,
                         double gain);

// CV_8UC3 (BGR) of photo - render (CV_32FC1, gray): white at 0, full red from +full_scale_gray on,
// full cyan from -full_scale_gray on, linear between; light gray where `mask` (CV_8UC1) is 0.
// Throws NumericalError for a scale that is not positive.
cv::Mat residual_map(const cv::Mat& residual_gray, const cv::Mat& mask, double full_scale_gray);

}  // namespace etalon
