#include "compare/characterise/code_statistics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr int harmonics = 200;  // the sum of 1/k^2 to half a percent, for sigma = 0

// Calls `term(k, decay)` for the harmonics that matter: decay = exp(-2 pi^2 k^2 sigma^2).
template <class Term>
double sum_over_harmonics(double sigma, Term term) {
    double sum = 0.0;
    for (int k = 1; k <= harmonics; ++k) {
        const double angle = std::numbers::pi * k * sigma;
        const double decay = std::exp(-2.0 * angle * angle);
        if (decay < 1e-9)
            break;
        sum += term(k, decay);
    }
    return sum;
}

template <class Code>
void count_codes(const cv::Mat& pixels, std::vector<double>& counts) {
    for (int y = 0; y < pixels.rows; ++y)
        for (const Code* code = pixels.ptr<Code>(y); code != pixels.ptr<Code>(y) + pixels.cols;
             ++code)
            counts[*code] += 1.0;
}

}  // namespace

double rounding_uncertainty_of_mean(double sigma) {
    return std::sqrt(0.5 * sum_over_harmonics(sigma, [](int k, double decay) {
                         return std::pow(decay / (std::numbers::pi * k), 2);
                     }));
}

double rounding_uncertainty_of_variance(double sigma) {
    return std::sqrt(0.5 * sum_over_harmonics(sigma, [sigma](int k, double decay) {
                         const double amplitude =
                             1.0 / std::pow(std::numbers::pi * k, 2) + 4.0 * sigma * sigma;
                         return std::pow(decay * amplitude, 2);
                     }));
}

int saturation_code(std::span<const CodeImage> images) {
    if (images.empty())
        throw NumericalError("no images to find the saturation of");
    std::vector<double> counts(65536);
    double pixels = 0.0;
    for (const CodeImage& image : images) {
        image.pixels.depth() == CV_8U ? count_codes<std::uint8_t>(image.pixels, counts)
                                      : count_codes<std::uint16_t>(image.pixels, counts);
        pixels += static_cast<double>(image.pixels.total());
    }
    int highest = images.front().full_scale();
    while (highest > 1 && counts[highest] == 0.0)
        --highest;
    const bool piled_up = counts[highest] > 1e-3 * pixels &&
                          counts[highest] > 5.0 * counts[static_cast<std::size_t>(highest) - 1];
    // A picture of few tones piles up without noise: the neighbouring codes are then empty.
    const bool has_noise = counts[static_cast<std::size_t>(highest) - 1] > 0.0;
    return piled_up && has_noise ? highest : images.front().full_scale();
}

double share_at_floor(const CodeImage& image) {
    return 1.0 - static_cast<double>(cv::countNonZero(image.pixels)) /
                     static_cast<double>(image.pixels.total());
}

double share_at_saturation(const CodeImage& image, int saturation) {
    return static_cast<double>(cv::countNonZero(image.pixels >= saturation)) /
           static_cast<double>(image.pixels.total());
}

void require_alike(std::span<const CodeImage> images, const std::string& what) {
    for (std::size_t i = 0; i < images.size(); ++i) {
        const CodeImage &image = images[i], &first = images.front();
        const bool is_code = image.pixels.type() == CV_8UC1 || image.pixels.type() == CV_16UC1;
        if (!is_code || image.pixels.empty())
            throw NumericalError(
                fmt::format("{}: image {} is no image of code values", what, i + 1));
        if (image.pixels.size() != first.pixels.size() || image.bits != first.bits)
            throw NumericalError(fmt::format(
                "{}: image {} has {} x {} px of {} bits, the first {} x {} px of {} bits", what,
                i + 1, image.pixels.cols, image.pixels.rows, image.bits, first.pixels.cols,
                first.pixels.rows, first.bits));
    }
}

PatchStatistics patch_statistics(const CodeImage& image, const cv::Rect& block, int saturation,
                                 Mosaic mosaic) {
    cv::Mat pixels;
    image.pixels(block).convertTo(pixels, CV_64F);
    cv::Scalar mean, deviation;
    cv::meanStdDev(pixels, mean, deviation);
    double lowest, highest;
    cv::minMaxLoc(pixels, &lowest, &highest);
    const int step = mosaic == Mosaic::none ? 1 : 2;
    const cv::Mat across =
        pixels.colRange(step, pixels.cols) - pixels.colRange(0, pixels.cols - step);
    const cv::Mat down =
        pixels.rowRange(step, pixels.rows) - pixels.rowRange(0, pixels.rows - step);
    const double variance = 0.25 * (cv::mean(across.mul(across))[0] + cv::mean(down.mul(down))[0]);
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
