#include "compare/characterise/uniform_patches.h"

#include <algorithm>
#include <cmath>

#include "compare/characterise/code_statistics.h"

namespace etalon {
namespace {

// Variance of a pixel from the differences of neighbours at distance `step`.
double noise_variance(const cv::Mat& pixels, int step) {
    const cv::Mat across =
        pixels.colRange(step, pixels.cols) - pixels.colRange(0, pixels.cols - step);
    const cv::Mat down =
        pixels.rowRange(step, pixels.rows) - pixels.rowRange(0, pixels.rows - step);
    return 0.25 * (cv::mean(across.mul(across))[0] + cv::mean(down.mul(down))[0]);
}

}  // namespace

PatchStatistics patch_statistics(const CodeImage& image, const cv::Rect& block, int saturation,
                                 Mosaic mosaic) {
    cv::Mat pixels;
    image.pixels(block).convertTo(pixels, CV_64F);
    cv::Scalar mean, deviation;
    cv::meanStdDev(pixels, mean, deviation);
    double lowest, highest;
    cv::minMaxLoc(pixels, &lowest, &highest);
    const double variance = noise_variance(pixels, mosaic == Mosaic::none ? 1 : 2);
    const double rounding =
        rounding_uncertainty_of_mean(std::sqrt(std::max(variance - rounding_variance, 0.0)));
    PatchStatistics patch;
    patch.mean = mean[0];
    patch.standard_uncertainty = std::hypot(std::sqrt(variance / block.area()), rounding);
    patch.unevenness = std::sqrt(std::max(deviation[0] * deviation[0] - variance, 0.0));
    const double room = 5.0 * std::sqrt(variance);
    patch.is_clipped = std::min(lowest, patch.mean - room) <= 0.0 ||
                       std::max(highest, patch.mean + room) >= saturation;
    return patch;
}

std::vector<cv::Rect> image_blocks(cv::Size image, int across) {
    const int side = std::max(4, image.width / across / 2 * 2);
    std::vector<cv::Rect> blocks;
    for (int y = 0; y + side <= image.height; y += side)
        for (int x = 0; x + side <= image.width; x += side)
            blocks.emplace_back(x, y, side, side);
    return blocks;
}

}  // namespace etalon
