#include "compare/match/block_steps.h"

#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace etalon {

double BlockSteps::excess_gray() const {
    return std::sqrt(std::max(across_gray * across_gray - inside_gray * inside_gray, 0.0));
}

BlockSteps block_steps(const PixelDifference& difference, double contrast_gray) {
    constexpr int block_px = 8;
    cv::Mat by_x, by_y;
    constexpr double per_px = 1.0 / 8.0;  // of Sobel's filter
    cv::Sobel(difference.predicted, by_x, CV_32F, 1, 0, 3, per_px);
    cv::Sobel(difference.predicted, by_y, CV_32F, 0, 1, 3, per_px);
    const cv::Mat flat =
        (cv::abs(by_x) + cv::abs(by_y) < 0.01 * contrast_gray) & (difference.use != pixel_outside);
    std::array<double, 2> squares{}, pairs{};  // inside, across
    const auto add = [&](int x, int y, int before_x, int before_y, bool across) {
        if (!flat.at<uchar>(y, x) || !flat.at<uchar>(before_y, before_x))
            return;
        const double step =
            difference.residual.at<float>(y, x) - difference.residual.at<float>(before_y, before_x);
        squares[across ? 1 : 0] += step * step;
        pairs[across ? 1 : 0] += 1.0;
    };
    for (int y = 1; y < flat.rows; ++y)
        for (int x = 1; x < flat.cols; ++x) {
            add(x, y, x - 1, y, x % block_px == 0);
            add(x, y, x, y - 1, y % block_px == 0);
        }
    if (pairs[0] == 0 || pairs[1] == 0)
        return {};
    return {std::sqrt(squares[1] / pairs[1]), std::sqrt(squares[0] / pairs[0]),
            static_cast<int>(pairs[1])};
}

}  // namespace etalon
