#include "station/devices/live_view.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace etalon {
namespace {

constexpr double smoothing = 0.1;

// What does not change between two frames cancels in their difference; the noise of both adds up.
// Drifts of the light are taken off with the mean.
double noise_of_two(const cv::Mat& a, const cv::Mat& b) {
    cv::Mat difference;
    cv::subtract(a, b, difference, cv::noArray(), CV_32F);
    cv::Scalar mean, deviation;
    cv::meanStdDev(difference, mean, deviation);
    return deviation[0] / std::numbers::sqrt2;
}

double sharpness_of(const cv::Mat& codes, double mean) {
    if (!(mean > 0.0))
        return 0.0;
    cv::Mat second_differences;
    cv::Laplacian(codes, second_differences, CV_32F);
    const double square_sum = second_differences.dot(second_differences);
    return 1000.0 * std::sqrt(square_sum / static_cast<double>(codes.total())) / mean;
}

}  // namespace

void LiveView::add(const Frame& frame) {
    last_status_ = frame.status;
    if (frame.status != FrameStatus::complete) {
        ++figures_.bad;
        return;
    }
    const cv::Mat& codes = frame.image.pixels;
    figures_.mean = cv::mean(codes)[0];
    figures_.saturated = static_cast<double>(cv::countNonZero(codes >= frame.image.full_scale())) /
                         static_cast<double>(codes.total());
    figures_.sharpness = sharpness_of(codes, figures_.mean);
    if (last_.size() == codes.size() && last_.type() == codes.type()) {
        figures_.noise = noise_of_two(codes, last_);
        const double rate =
            1.0 / std::chrono::duration<double>(frame.exposure_start - last_start_).count();
        const double old = figures_.frames_per_second;
        figures_.frames_per_second = old > 0.0 ? old + smoothing * (rate - old) : rate;
    }
    last_ = codes;
    last_start_ = frame.exposure_start;
}

std::string LiveView::line() const {
    if (last_.empty() || last_status_ != FrameStatus::complete)
        return fmt::format("no frame: {}  bad {}", name(last_status_), figures_.bad);
    return fmt::format("{:5.1f} fps  mean {:7.1f}  noise {:6.2f}  sat {:6.2f} %  sharp {:5.0f}{}",
                       figures_.frames_per_second, figures_.mean, figures_.noise,
                       100.0 * figures_.saturated, figures_.sharpness,
                       figures_.bad ? fmt::format("  bad {}", figures_.bad) : "");
}

}  // namespace etalon
