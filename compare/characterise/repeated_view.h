// What changed between photographs of the same still view: brightness, a shift, and the noise that
// is left. The groundwork of compare/characterise/photon_transfer.h.
#pragma once

#include <opencv2/core.hpp>
#include <span>
#include <vector>

namespace etalon {

// The noise of every pixel, from photographs in linear signal.
struct ViewNoise {
    cv::Mat mean;                   // CV_32FC1, over the photographs
    cv::Mat variance;               // CV_32FC1, sample variance over them; unbiased
    std::vector<cv::Mat> residual;  // CV_32FC1 of each photograph, brightness and shift taken out
    double brightness_drift = 0.0;  // largest relative difference between two photographs
    double shift_px = 0.0;          // largest displacement of one from their mean
};

// `signals`: at least two CV_32FC1 of one size, linear, 0 without light. `use` (CV_8UC1, 255: yes):
// pixels that are not clipped. Of each photograph brightness and shift against the mean are fitted
// to all used pixels at once (one linear regression on the mean and its two derivatives) and taken
// out. `step`: distance of neighbours of the same colour, 2 with a mosaic. Throws NumericalError
// when no pixel is used.
ViewNoise view_noise(std::span<const cv::Mat> signals, const cv::Mat& use, int step);

// Pixels whose mean differs from that of each of the four neighbours at distance `step` by less
// than `most` (CV_32FC1, by pixel). CV_8UC1; the image's border is never smooth.
cv::Mat smooth_pixels(const cv::Mat& mean, const cv::Mat& most, int step);

// Mean over the 5 x 5 pixels around, at distances of `step`, that are used (CV_8UC1). A pixel's own
// mean over a few photographs is noisy, and pixels that are sorted by it come with their noise:
// those at the end of a tone's range would seem brighter than they are. 0 where no pixel is used.
cv::Mat local_level(const cv::Mat& mean, const cv::Mat& use, int step);

// Correlation of a residual between pixels (x, y) and (x + dx, y + dy), over pairs that are both
// used: mean product over mean square. 0 without pairs.
double neighbour_correlation(std::span<const cv::Mat> residuals, const cv::Mat& use, int dx,
                             int dy);

}  // namespace etalon
