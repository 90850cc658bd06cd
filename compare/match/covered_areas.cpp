#include "compare/match/covered_areas.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/errors.h"

namespace etalon {
namespace {

// White minus black, and white, at every pixel.
struct Levels {
    cv::Mat white, contrast;

    Levels(const PhotometricModel& model, cv::Size size)
        : white(size, CV_32FC1), contrast(size, CV_32FC1) {
        for (int y = 0; y < size.height; ++y)
            for (int x = 0; x < size.width; ++x) {
                const Vector6d terms = level_terms(x, y, size);
                const double light = model.at(terms, 1.0).gray, dark = model.at(terms, 0.0).gray;
                white.at<float>(y, x) = static_cast<float>(light);
                contrast.at<float>(y, x) = static_cast<float>(std::max(light - dark, 1.0));
            }
    }
};

// Where the prediction changes by less than 5 % of the contrast per px: not beside an edge, where a
// displacement of a px leaves a residual as large as a cover's.
cv::Mat flat_places(const cv::Mat& predicted, const cv::Mat& contrast) {
    cv::Mat by_x, by_y;
    constexpr double per_px = 1.0 / 8.0;  // of Sobel's filter
    cv::Sobel(predicted, by_x, CV_32F, 1, 0, 3, per_px);
    cv::Sobel(predicted, by_y, CV_32F, 0, 1, 3, per_px);
    return cv::Mat(cv::abs(by_x) + cv::abs(by_y)) < 0.05 * contrast;
}

// Means over windows, of the used pixels among them; 0 where fewer than a sixth are used.
cv::Mat window_means(const cv::Mat& values, const cv::Mat& used, int side) {
    constexpr double min_share = 1.0 / 6.0;
    cv::Mat weight, sum, count;
    used.convertTo(weight, CV_32F, 1.0 / 255.0);
    cv::boxFilter(values.mul(weight), sum, CV_32F, {side, side}, {-1, -1}, true,
                  cv::BORDER_CONSTANT);
    cv::boxFilter(weight, count, CV_32F, {side, side}, {-1, -1}, true, cv::BORDER_CONSTANT);
    cv::Mat means = sum / cv::max(count, 0.01f);
    means.setTo(0.0f, count < min_share);
    return means;
}

}  // namespace

CoveredAreas covered_areas(const cv::Mat& photo_gray, const PixelDifference& difference,
                           double window_px, double limit, double saturation_gray) {
    if (photo_gray.size() != difference.use.size() || photo_gray.type() != CV_32FC1)
        throw NumericalError("the photograph is not the one that was compared");
    const int side = std::max(3, static_cast<int>(std::lround(window_px)));
    const cv::Mat used = difference.use != pixel_outside;
    const Levels levels(difference.model, used.size());
    const cv::Mat means =
        window_means(difference.residual / levels.contrast,
                     used & flat_places(difference.predicted, levels.contrast), side);
    const cv::Mat size = cv::abs(means);

    CoveredAreas areas;
    cv::minMaxLoc(size, nullptr, &areas.largest, nullptr, nullptr, used);
    cv::dilate(size > limit, areas.pixels,
               cv::getStructuringElement(cv::MORPH_RECT, {side + 2, side + 2}));
    const cv::Mat covered = areas.pixels & used;
    const int count = cv::countNonZero(covered), all = cv::countNonZero(used);
    if (count == 0)
        return areas;
    areas.share = static_cast<double>(count) / all;
    const cv::Mat brighter =
        (photo_gray > levels.white + 0.1 * levels.contrast) | (photo_gray >= saturation_gray);
    areas.bright_share = static_cast<double>(cv::countNonZero(brighter & covered)) / count;
    return areas;
}

}  // namespace etalon
