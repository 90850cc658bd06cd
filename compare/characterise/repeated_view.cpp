#include "compare/characterise/repeated_view.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/program/errors.h"

namespace etalon {
namespace {

// The mean image and its derivatives in x and y (central differences), by pixel.
struct Regressors {
    cv::Mat level, along_x, along_y;
};

Regressors regressors_of(const cv::Mat& mean, int step) {
    cv::Mat padded;
    cv::copyMakeBorder(mean, padded, step, step, step, step, cv::BORDER_REPLICATE);
    const cv::Rect inside(step, step, mean.cols, mean.rows);
    const auto derivative = [&](cv::Point to) -> cv::Mat {
        return (padded(inside + to) - padded(inside - to)) / (2.0 * step);
    };
    return {mean, derivative({step, 0}), derivative({0, step})};
}

// Least squares of `difference` on the regressors: relative brightness, and minus the shift in x
// and y.
Eigen::Vector3d change_of(const cv::Mat& difference, const Regressors& r, const cv::Mat& use) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (int y = 0; y < use.rows; ++y)
        for (int x = 0; x < use.cols; ++x) {
            if (!use.at<uchar>(y, x))
                continue;
            const Eigen::Vector3d row(r.level.at<float>(y, x), r.along_x.at<float>(y, x),
                                      r.along_y.at<float>(y, x));
            normal += row * row.transpose();
            right += difference.at<float>(y, x) * row;
        }
    // A uniform view has no derivatives: a shift that cannot be seen is none.
    const double scale = std::max(normal(0, 0), 1e-30);
    for (int i = 1; i < 3; ++i)
        normal(i, i) += 1e-9 * scale;
    return normal.ldlt().solve(right);
}

}  // namespace

ViewNoise view_noise(std::span<const cv::Mat> signals, const cv::Mat& use, int step) {
    if (signals.size() < 2 || cv::countNonZero(use) == 0)
        throw NumericalError("repeats: two photos with pixels that are not clipped are needed");
    const double n = static_cast<double>(signals.size());
    ViewNoise noise;
    noise.mean = cv::Mat::zeros(use.size(), CV_32FC1);
    for (const cv::Mat& signal : signals)
        noise.mean += signal / n;
    const Regressors regressors = regressors_of(noise.mean, step);
    noise.variance = cv::Mat::zeros(use.size(), CV_32FC1);
    double least = 0.0, most = 0.0;
    for (const cv::Mat& signal : signals) {
        const cv::Mat difference = signal - noise.mean;
        const Eigen::Vector3d change = change_of(difference, regressors, use);
        least = std::min(least, change(0));
        most = std::max(most, change(0));
        noise.shift_px = std::max(noise.shift_px, change.tail<2>().norm());
        noise.residual.push_back(difference - change(0) * regressors.level -
                                 change(1) * regressors.along_x - change(2) * regressors.along_y);
        noise.variance += noise.residual.back().mul(noise.residual.back()) / (n - 1.0);
    }
    noise.brightness_drift = most - least;
    return noise;
}

cv::Mat smooth_pixels(const cv::Mat& mean, const cv::Mat& most, int step) {
    cv::Mat smooth(mean.size(), CV_8UC1, cv::Scalar(0));
    for (int y = step; y < mean.rows - step; ++y)
        for (int x = step; x < mean.cols - step; ++x) {
            const float level = mean.at<float>(y, x), limit = most.at<float>(y, x);
            const bool is_smooth = std::abs(mean.at<float>(y, x - step) - level) < limit &&
                                   std::abs(mean.at<float>(y, x + step) - level) < limit &&
                                   std::abs(mean.at<float>(y - step, x) - level) < limit &&
                                   std::abs(mean.at<float>(y + step, x) - level) < limit;
            smooth.at<uchar>(y, x) = is_smooth ? 255 : 0;
        }
    return smooth;
}

cv::Mat local_level(const cv::Mat& mean, const cv::Mat& use, int step) {
    cv::Mat kernel = cv::Mat::zeros(4 * step + 1, 4 * step + 1, CV_32FC1);
    for (int y = 0; y < 5; ++y)
        for (int x = 0; x < 5; ++x)
            kernel.at<float>(y * step, x * step) = 1.0f;
    cv::Mat weight, sum, count;
    use.convertTo(weight, CV_32F, 1.0 / 255.0);
    cv::filter2D(mean.mul(weight), sum, CV_32F, kernel, {-1, -1}, 0.0, cv::BORDER_CONSTANT);
    cv::filter2D(weight, count, CV_32F, kernel, {-1, -1}, 0.0, cv::BORDER_CONSTANT);
    return sum / cv::max(count, 1.0);
}

double neighbour_correlation(std::span<const cv::Mat> residuals, const cv::Mat& use, int dx,
                             int dy) {
    double product = 0.0, square = 0.0;
    for (const cv::Mat& residual : residuals)
        for (int y = 0; y < use.rows - dy; ++y)
            for (int x = 0; x < use.cols - dx; ++x) {
                if (!use.at<uchar>(y, x) || !use.at<uchar>(y + dy, x + dx))
                    continue;
                const double a = residual.at<float>(y, x), b = residual.at<float>(y + dy, x + dx);
                product += a * b;
                square += 0.5 * (a * a + b * b);
            }
    return square > 0.0 ? product / square : 0.0;
}

}  // namespace etalon
