// What code values do to statistics: rounding, and the ends of the scale.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/image/image.h"

namespace etalon {

// Variance that rounding to whole code values adds, DN^2 (EMVA 1288 release 4, 2.3).
inline constexpr double rounding_variance = 1.0 / 12.0;

// Errors of mean and variance (less rounding_variance) by rounding a value with noise of standard
// deviation sigma (DN): their standard deviations over the fractions of a code (Widrow and Kollár,
// "Quantization noise", 2008). Of the mean 0.289 DN without noise, 0.04 at sigma 0.3, 0 above 1.
double rounding_uncertainty_of_mean(double sigma);
double rounding_uncertainty_of_variance(double sigma);

// The code from which on values are cut off: full scale, or the highest code where it piles up (5
// times as many pixels as the code below, and one in a thousand). Throws NumericalError for no
// images.
int saturation_code(std::span<const CodeImage> images);

// Proportion of pixels at code 0, and of those at `saturation` or above.
double share_at_floor(const CodeImage& image);
double share_at_saturation(const CodeImage& image, int saturation);

// Throws NumericalError that begins with `what` unless all images are single-channel and have the
// first one's size and bits.
void require_alike(std::span<const CodeImage> images, const std::string& what);

struct PatchStatistics {
    double mean = 0.0;  // code value
    // Of the mean, by pixel noise and rounding. The noise is that of neighbours' differences, fixed
    // pattern included.
    double standard_uncertainty = 0.0;
    double unevenness = 0.0;  // standard deviation of the pixels beyond that noise
    bool is_clipped = false;  // a pixel is at either end of the scale, or 5 times its noise from it
};

// `block` must lie in the image and be at least 4 px wide and high. With a mosaic neighbours of the
// same colour are compared.
PatchStatistics patch_statistics(const CodeImage& image, const cv::Rect& block, int saturation,
                                 Mosaic mosaic);

// Square blocks with an even side of about 1/`across` of the image's width, at least 4 px; a rest
// at the right and lower side is left out.
std::vector<cv::Rect> image_blocks(cv::Size image, int across);

}  // namespace etalon
