#include "compare/match/covered_areas.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/program/errors.h"

namespace etalon {
namespace {

// White minus black, and white, at every pixel.
struct Levels {
    cv::Mat white, contrast;

    Levels(const PhotometricModel& model, cv::Size size)
        : white(size, CV_32FC1), contrast(size, CV_32FC1) {
        for (int y = 0; y < size.height; ++y) {
            const LevelRow row(model, y, size);
            for (int x = 0; x < size.width; ++x) {
                const double black = row.black(x), full = row.white(x);
                const double light = model.between(black, full, 1.0).gray,
                             dark = model.between(black, full, 0.0).gray;
                white.at<float>(y, x) = static_cast<float>(light);
                contrast.at<float>(y, x) = static_cast<float>(std::max(light - dark, 1.0));
            }
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

// Means over windows, of the used pixels among them; 0 where fewer than a sixth are used. The
// values are averaged over `step` x `step` px first, and the windows stand that far apart.
cv::Mat window_means(const cv::Mat& values, const cv::Mat& used, int side, int step) {
    constexpr double min_share = 1.0 / 6.0;
    const cv::Size size((values.cols + step - 1) / step, (values.rows + step - 1) / step);
    cv::Mat weight, weighted, sum, count;
    used.convertTo(weight, CV_32F, 1.0 / 255.0);
    cv::resize(values.mul(weight), weighted, size, 0, 0, cv::INTER_AREA);
    cv::resize(weight, weight, size, 0, 0, cv::INTER_AREA);
    const cv::Size window(side / step, side / step);
    cv::boxFilter(weighted, sum, CV_32F, window, {-1, -1}, true, cv::BORDER_CONSTANT);
    cv::boxFilter(weight, count, CV_32F, window, {-1, -1}, true, cv::BORDER_CONSTANT);
    cv::Mat means = sum / cv::max(count, 0.01f);
    means.setTo(0.0f, count < min_share);
    return means;
}

}  // namespace

CoveredAreas covered_areas(const cv::Mat& photo_gray, const PixelDifference& difference,
                           double window_px, double limit, double saturation_gray) {
    if (photo_gray.size() != difference.use.size() || photo_gray.type() != CV_32FC1)
        throw NumericalError("the photograph is not the one that was compared");
    constexpr int enough_steps = 12;  // in a window
    const int side = std::max(3, static_cast<int>(std::lround(window_px)));
    const int step = std::max(1, side / enough_steps);
    const cv::Mat used = difference.use != pixel_outside;
    const Levels levels(difference.model, used.size());
    const cv::Mat means =
        window_means(difference.residual / levels.contrast,
                     used & flat_places(difference.predicted, levels.contrast), side, step);
    const cv::Mat size = cv::abs(means);

    CoveredAreas areas;
    cv::Mat used_windows, large;
    cv::resize(used, used_windows, size.size(), 0, 0, cv::INTER_NEAREST);
    cv::minMaxLoc(size, nullptr, &areas.largest, nullptr, nullptr, used_windows);
    cv::dilate(size > limit, large,
               cv::getStructuringElement(cv::MORPH_RECT, {side / step + 2, side / step + 2}));
    cv::resize(large, areas.pixels, used.size(), 0, 0, cv::INTER_NEAREST);
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
