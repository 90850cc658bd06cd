// Blocks of an image and what is in them: mean code and its uncertainty, how even they are.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "core/image/image.h"
#include "core/image/mosaic.h"

namespace etalon {

struct PatchStatistics {
    double mean = 0.0;  // code value
    // Of the mean: pixel noise over the square root of the pixels, and rounding. The noise is read
    // off differences of neighbours, so that a slope across the patch is none; a fixed pattern is
    // counted as noise.
    double standard_uncertainty = 0.0;
    double unevenness = 0.0;  // standard deviation of the pixels beyond that noise
    // A pixel is at code 0 or at `saturation` or above, or would be with five times its noise: to
    // keep those patches whose noise happened to stay below would make them darker than they are.
    bool is_clipped = false;
};

// `block` must lie in the image and be at least 4 px wide and high. With a mosaic neighbours of the
// same colour are compared.
PatchStatistics patch_statistics(const CodeImage& image, const cv::Rect& block, int saturation,
                                 Mosaic mosaic);

// Square blocks with an even side of about 1/`across` of the image's width, at least 4 px, that
// cover the image but for a rest at its right and lower side.
std::vector<cv::Rect> image_blocks(cv::Size image, int across);

}  // namespace etalon
