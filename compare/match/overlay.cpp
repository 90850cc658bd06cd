#include "compare/match/overlay.h"

#include <fmt/format.h>

#include "core/program/errors.h"

namespace etalon {
namespace {

void require_same_size(const cv::Mat& image, int type, const cv::Mat& other, int other_type) {
    if (image.type() != type || other.type() != other_type || image.size() != other.size())
        throw NumericalError(
            fmt::format("images of {} x {} and {} x {} px cannot be laid over each other",
                        image.cols, image.rows, other.cols, other.rows));
}

}  // namespace

cv::Mat red_cyan_overlay(const cv::Mat& photo_gray, const cv::Mat& render_gray, const cv::Mat& mask,
                         double gain) {
    require_same_size(photo_gray, CV_32FC1, render_gray, CV_32FC1);
    require_same_size(photo_gray, CV_32FC1, mask, CV_8UC1);
    cv::Mat overlay(photo_gray.size(), CV_8UC3);
    for (int y = 0; y < overlay.rows; ++y) {
        const float* photo = photo_gray.ptr<float>(y);
        const float* render = render_gray.ptr<float>(y);
        const uchar* inside = mask.ptr<uchar>(y);
        cv::Vec3b* out = overlay.ptr<cv::Vec3b>(y);
        for (int x = 0; x < overlay.cols; ++x) {
            if (!inside[x]) {
                out[x] = cv::Vec3b::all(cv::saturate_cast<uchar>(120.0 + 0.45 * photo[x]));
                continue;
            }
            const double mean = 0.5 * (photo[x] + render[x]);
            const double half = 0.5 * gain * (photo[x] - render[x]);
            const auto cyan = cv::saturate_cast<uchar>(mean - half);
            out[x] = {cyan, cyan, cv::saturate_cast<uchar>(mean + half)};
        }
    }
    return overlay;
}

cv::Mat residual_map(const cv::Mat& residual_gray, const cv::Mat& mask, double full_scale_gray) {
    require_same_size(residual_gray, CV_32FC1, mask, CV_8UC1);
    if (!(full_scale_gray > 0))
        throw NumericalError("the scale of a residual map must be positive");
    // A little darkened so that both print.
    const cv::Vec3d red(30, 25, 205), cyan(170, 145, 0);
    cv::Mat map(residual_gray.size(), CV_8UC3, cv::Scalar::all(228));
    for (int y = 0; y < map.rows; ++y)
        for (int x = 0; x < map.cols; ++x) {
            if (!mask.at<uchar>(y, x))
                continue;
            const double share = residual_gray.at<float>(y, x) / full_scale_gray;
            const cv::Vec3d white = cv::Vec3d::all(255.0), end = share > 0 ? red : cyan;
            map.at<cv::Vec3b>(y, x) = white + (end - white) * std::min(std::abs(share), 1.0);
        }
    return map;
}

}  // namespace etalon
