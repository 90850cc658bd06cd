#include "compare/characterise/black_level.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "compare/characterise/code_statistics.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double max_at_floor = 1e-3;
constexpr double max_fixed_pattern = 0.03;  // of full scale

// Sums over the frames of each pixel's code and its square, less the first frame's (so that nothing
// cancels).
struct PixelSums {
    cv::Mat difference, square;  // CV_64FC1
};

PixelSums pixel_sums(std::span<const CodeImage> frames) {
    PixelSums sums{cv::Mat::zeros(frames.front().pixels.size(), CV_64FC1),
                   cv::Mat::zeros(frames.front().pixels.size(), CV_64FC1)};
    for (const CodeImage& frame : frames) {
        cv::Mat difference;
        cv::subtract(frame.pixels, frames.front().pixels, difference, cv::noArray(), CV_64F);
        sums.difference += difference;
        sums.square += difference.mul(difference);
    }
    return sums;
}

// Mean over the pixels of their sample variance over the frames.
double temporal_variance(const PixelSums& sums, double frames) {
    const cv::Mat deviation = sums.square - sums.difference.mul(sums.difference) / frames;
    return std::max(cv::mean(deviation)[0] / (frames - 1.0), 0.0);
}

double fixed_pattern(std::span<const CodeImage> frames, const PixelSums& sums,
                     double temporal_variance_dn2) {
    const double n = static_cast<double>(frames.size());
    cv::Mat first;
    frames.front().pixels.convertTo(first, CV_64F);
    const cv::Mat mean = first + sums.difference / n;
    cv::Scalar level, deviation;
    cv::meanStdDev(mean, level, deviation);
    return std::sqrt(std::max(deviation[0] * deviation[0] - temporal_variance_dn2 / n, 0.0));
}

// Noise before rounding, of codes with this variance: rounding's own part and what it may have
// added beyond are taken out.
double least_noise(double code_variance) {
    const double square = std::max(code_variance - rounding_variance, 0.0);
    const double doubt = rounding_uncertainty_of_variance(std::sqrt(square));
    return std::sqrt(std::max(square - doubt, 0.0));
}

void refuse_floor(std::span<const CodeImage> frames) {
    double share = 0.0;
    for (const CodeImage& frame : frames)
        share = std::max(share, share_at_floor(frame));
    if (share > max_at_floor)
        throw NumericalError(fmt::format(
            "black level: {:.3g} % of a dark photo's pixels are at code 0, where it is cut off: "
            "raise the camera's black level",
            100.0 * share));
}

void refuse_drift(const BlackLevel& black) {
    const double noise = std::sqrt(black.temporal_variance_dn2);
    if (black.drift_dn > 0.5 * std::max(noise, 1.0))
        throw NumericalError(
            fmt::format("black level: the dark photos' means drift by {:.3g} DN (noise of a pixel "
                        "{:.3g} DN): let the camera warm up",
                        black.drift_dn, noise));
}

void refuse_light(const BlackLevel& black, int full_scale) {
    if (black.fixed_pattern_dn > max_fixed_pattern * full_scale)
        throw NumericalError(fmt::format(
            "black level: the dark photos show a picture (pixels' means differ by {:.3g} "
            "DN RMS): is the lens covered?",
            black.fixed_pattern_dn));
}

}  // namespace

BlackLevel measure_black_level(std::span<const CodeImage> frames) {
    if (frames.empty())
        throw NumericalError("black level: no dark photos");
    require_alike(frames, "black level");
    refuse_floor(frames);
    const double n = static_cast<double>(frames.size());
    const double pixels = static_cast<double>(frames.front().pixels.total());
    cv::Mat means(1, static_cast<int>(frames.size()), CV_64FC1);
    for (std::size_t i = 0; i < frames.size(); ++i)
        means.at<double>(static_cast<int>(i)) = cv::mean(frames[i].pixels)[0];
    cv::Scalar mean, deviation;
    cv::meanStdDev(means, mean, deviation);
    double lowest, highest;
    cv::minMaxLoc(means, &lowest, &highest);

    const PixelSums sums = pixel_sums(frames);
    BlackLevel black;
    black.frames = static_cast<int>(n);
    black.dn = mean[0];
    black.drift_dn = highest - lowest;
    if (n > 1.0) {
        black.temporal_variance_dn2 = temporal_variance(sums, n);
        black.temporal_variance_standard_uncertainty =
            black.temporal_variance_dn2 * std::sqrt(2.0 / ((n - 1.0) * pixels));
    }
    black.fixed_pattern_dn = fixed_pattern(frames, sums, black.temporal_variance_dn2);
    refuse_light(black, frames.front().full_scale());
    refuse_drift(black);

    // With one frame the noise is not told from the fixed pattern: their sum is an upper bound.
    const double variance =
        n > 1.0 ? black.temporal_variance_dn2 : black.fixed_pattern_dn * black.fixed_pattern_dn;
    const double scatter = n > 1.0 ? deviation[0] * deviation[0] / (n - 1.0) : 0.0;
    const double rounding = rounding_uncertainty_of_mean(least_noise(variance));
    black.standard_uncertainty_dn =
        std::sqrt(std::max(variance / (n * pixels), scatter) + rounding * rounding);
    return black;
}

}  // namespace etalon
