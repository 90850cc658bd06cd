#include "compare/photometric/pixel_difference.h"

#include <functional>
#include <limits>

#include "core/program/errors.h"
#include "sim/sensor/sensor_model.h"

namespace etalon {
namespace {

constexpr double limit = 3.0;  // of significance, standard deviations

// The value that 99 % of the sizes do not exceed.
double percentile_99(std::vector<double>& sizes) {
    const auto rank =
        static_cast<std::ptrdiff_t>(std::ceil(0.99 * static_cast<double>(sizes.size()))) - 1;
    std::nth_element(sizes.begin(), sizes.begin() + rank, sizes.end());
    return sizes[static_cast<std::size_t>(rank)];
}

ResidualStatistics statistics(const PixelDifference& difference, PixelUse use) {
    std::vector<double> sizes;
    double sum = 0.0, squares = 0.0;
    int significant = 0;
    for (int y = 0; y < difference.use.rows; ++y)
        for (int x = 0; x < difference.use.cols; ++x) {
            if (difference.use.at<uchar>(y, x) != use)
                continue;
            const double residual = difference.residual.at<float>(y, x);
            sizes.push_back(std::abs(residual));
            sum += residual;
            squares += residual * residual;
            significant += std::abs(difference.significance.at<float>(y, x)) > limit ? 1 : 0;
        }
    if (sizes.empty())
        throw NumericalError("no pixel of the marker is left to be scored");
    const double count = static_cast<double>(sizes.size());
    ResidualStatistics result;
    result.pixels = static_cast<int>(sizes.size());
    result.mean_gray = sum / count;
    result.rms_gray = std::sqrt(squares / count);
    result.worst_gray = *std::max_element(sizes.begin(), sizes.end());
    result.p99_gray = percentile_99(sizes);
    result.significant = significant / count;
    return result;
}

// Where half of the noise is clipped and more: Saturation's slope is below 0.5.
double clipping_gray(const PhotometricModel& model) {
    if (!model.saturation)
        return std::numeric_limits<double>::infinity();
    return model.saturation->at(model.saturation->level_gray).gray;
}

// 1.4826 times the median size of the fitted residuals of pixels that do not clip: their standard
// deviation if they are normal, whatever a tenth of them is. Not below rounding to 8 bits.
double deviation_of_residuals(const PixelDifference& difference) {
    constexpr double min_gray = 0.289;
    const double clipping = clipping_gray(difference.model);
    std::vector<float> sizes;
    for (int y = 0; y < difference.use.rows; ++y)
        for (int x = 0; x < difference.use.cols; ++x)
            if (difference.use.at<uchar>(y, x) == pixel_fitted &&
                difference.predicted.at<float>(y, x) < clipping)
                sizes.push_back(std::abs(difference.residual.at<float>(y, x)));
    if (sizes.empty())
        throw NumericalError("no pixel of the marker was fitted");
    const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
    std::nth_element(sizes.begin(), middle, sizes.end());
    return std::max(1.4826 * static_cast<double>(*middle), min_gray);
}

// The standard deviation of each pixel's noise.
cv::Mat noise_map(const cv::Mat& predicted, const std::function<double(double)>& noise_of_gray) {
    cv::Mat noise(predicted.size(), CV_32FC1);
    for (int y = 0; y < noise.rows; ++y)
        for (int x = 0; x < noise.cols; ++x)
            noise.at<float>(y, x) = static_cast<float>(noise_of_gray(predicted.at<float>(y, x)));
    return noise;
}

}  // namespace

PixelDifference difference_at(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                              const PhotoState& state) {
    PixelDifference difference;
    difference.model = state.photometry;
    difference.use = photo.use;
    difference.predicted = predicted_at(photo, camera, state);
    difference.residual = photo.gray - difference.predicted;
    const bool known = camera.knows_noise();
    difference.noise_source = known ? NoiseSource::camera : NoiseSource::residuals;
    const double found = known ? 0.0 : deviation_of_residuals(difference);
    const cv::Mat noise = noise_map(
        difference.predicted, [&](double gray) { return known ? camera.noise_gray(gray) : found; });
    difference.significance = difference.residual / noise;
    const cv::Mat scored = photo.use == pixel_scored;
    difference.noise_gray =
        cv::norm(noise, cv::NORM_L2, scored) / std::sqrt(std::max(cv::countNonZero(scored), 1));
    difference.fitted = statistics(difference, pixel_fitted);
    difference.scored = statistics(difference, pixel_scored);
    return difference;
}

std::optional<double> noise_gray(const Sensor& sensor, double gray) {
    if (!(sensor.gain_e_per_dn > 0))
        return std::nullopt;
    const double full_scale = (1 << sensor.bits) - 1;
    const double range = full_scale - sensor.black_dn;
    const double code = (gray / 255.0 * full_scale - sensor.black_dn) / range;
    const double linear = decode(sensor.transfer, code);
    constexpr double step = 1e-4;  // of full scale
    const double slope =
        (encode(sensor.transfer, linear + step) - encode(sensor.transfer, linear - step)) /
        (2.0 * step);
    const double read_dn = sensor.read_noise_e / sensor.gain_e_per_dn;
    const double linear_variance =
        std::max(linear * range, 0.0) / sensor.gain_e_per_dn + read_dn * read_dn;
    const double rounding = 1.0 / 12.0;  // variance of a rounding error, DN^2
    return std::sqrt(slope * slope * linear_variance + rounding) * 255.0 / full_scale;
}

}  // namespace etalon
