#include "compare/characterise/code_statistics.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <vector>

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
    // A picture of few tones piles up without noise; then nothing tells a limit from a tone, and
    // the neighbouring codes are empty altogether.
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

}  // namespace etalon
