#include "compare/photometric/photometric_model.h"

#include <opencv2/imgproc.hpp>

#include "core/statistics/distributions.h"
#include "sim/sensor/sensor_model.h"

namespace etalon {
namespace {

// exp(variance * half of the second difference at a frequency) as a kernel: the inverse Fourier
// transform by the trapezoidal rule.
cv::Mat discrete_gaussian(double sigma_px) {
    const int radius = static_cast<int>(std::ceil(5.0 * sigma_px)) + 4;
    const int steps = 4 * radius;
    cv::Mat kernel(1, 2 * radius + 1, CV_64F, cv::Scalar(0.0));
    for (int k = 0; k < steps; ++k) {
        const double frequency = 2.0 * std::numbers::pi * k / steps;
        const double half_second_difference =
            (-15.0 + 16.0 * std::cos(frequency) - std::cos(2.0 * frequency)) / 12.0;
        const double gain = std::exp(sigma_px * sigma_px * half_second_difference);
        for (int n = -radius; n <= radius; ++n)
            kernel.at<double>(n + radius) += gain * std::cos(n * frequency) / steps;
    }
    return kernel / cv::sum(kernel)[0];
}

}  // namespace

LightCurve::LightCurve(const std::optional<Sensor>& sensor, const PhotometricModel& model) {
    constexpr double min_contrast = 0.01;  // of full scale; below, the levels say nothing
    if (!sensor || sensor->transfer.kind == Transfer::Kind::linear)
        return;
    transfer_ = sensor->transfer;
    const double black_level = sensor->black_dn / ((1 << sensor->bits) - 1);
    const auto light_of = [&](double gray) {
        return decode(transfer_, (gray / 255.0 - black_level) / (1.0 - black_level));
    };
    const double dark = light_of(model.black[0]), light = light_of(model.white[0]);
    if (light > dark + min_contrast) {
        dark_ = dark;
        light_ = light;
    }
    low_ = encode(transfer_, dark_);
    range_ = encode(transfer_, light_) - low_;
}

double LightCurve::value(double radiance) const {
    if (transfer_.kind == Transfer::Kind::linear)
        return radiance;
    return (encode(transfer_, std::lerp(dark_, light_, radiance)) - low_) / range_;
}

LightCurve::Point LightCurve::at(double radiance) const {
    constexpr double step = 1e-4;
    if (transfer_.kind == Transfer::Kind::linear)
        return {radiance, 1.0};
    return {value(radiance), (value(radiance + step) - value(radiance - step)) / (2.0 * step)};
}

Vector6d level_terms(double x, double y, cv::Size size) {
    const double u = (x - 0.5 * (size.width - 1)) / size.width;
    const double v = (y - 0.5 * (size.height - 1)) / size.height;
    Vector6d terms;
    terms << 1.0, u, v, u * u, u * v, v * v;
    return terms;
}

LevelRow::LevelRow(const PhotometricModel& model, int y, cv::Size size)
    : middle_(0.5 * (size.width - 1)), per_px_(1.0 / size.width) {
    const double v = (y - 0.5 * (size.height - 1)) / size.height;
    const auto along_x = [v](const Vector6d& levels) {
        return Eigen::Vector3d(levels[0] + v * (levels[2] + v * levels[5]),
                               levels[1] + v * levels[4], levels[3]);
    };
    black_ = along_x(model.black);
    white_ = along_x(model.white);
}

cv::Mat gray_of(const CodeImage& image) {
    cv::Mat gray;
    image.pixels.convertTo(gray, CV_32F, 255.0 / image.full_scale());
    return gray;
}

Saturation::Point Saturation::at(double gray) const {
    constexpr double far = 8.0;  // standard deviations: beyond, nothing is left to see
    const double z = (level_gray - gray) / knee_gray;
    if (z > far)
        return {gray, 1.0, 0.0, 0.0};
    if (z < -far)
        return {level_gray, 0.0, 1.0, 0.0};
    const double below = normal_probability(z);
    const double density = std::exp(-0.5 * z * z) * std::numbers::inv_sqrtpi / std::numbers::sqrt2;
    return {level_gray - knee_gray * (z * below + density), below, 1.0 - below, -density};
}

Eigen::Vector2d PhotometricModel::psf_sigmas_px() const {
    const double mean = psf_sigma_px * psf_sigma_px;
    return Eigen::Vector2d(mean + psf_anisotropy_px2, mean - psf_anisotropy_px2)
        .cwiseMax(0.0)
        .cwiseSqrt();
}

PhotometricModel::Point PhotometricModel::at(const Vector6d& level_terms, double seen) const {
    return between(black.dot(level_terms), white.dot(level_terms), seen);
}

PhotometricModel::Point PhotometricModel::between(double dark, double light, double seen) const {
    const double contrast = light - dark;
    const double gray = dark + contrast * seen * (1.0 + tone * (1.0 - seen));
    const double slope = contrast * (1.0 + tone * (1.0 - 2.0 * seen));
    if (!saturation)
        return {gray, slope};
    const Saturation::Point point = saturation->at(gray);
    return {point.gray, point.slope * slope};
}

cv::Mat blurred(const cv::Mat& image, double sigma_px) {
    return blurred(image, Eigen::Vector2d::Constant(sigma_px));
}

cv::Mat blurred(const cv::Mat& image, const Eigen::Vector2d& sigmas_px) {
    cv::Mat result;
    cv::sepFilter2D(image, result, -1, discrete_gaussian(sigmas_px.x()),
                    discrete_gaussian(sigmas_px.y()), {-1, -1}, 0.0, cv::BORDER_REPLICATE);
    return result;
}

cv::Mat predicted_gray(const PhotometricModel& model, const Radiance& radiance,
                       const LightCurve& curve) {
    cv::Mat gray = blurred(radiance, model.psf_sigmas_px());
    for (int y = 0; y < gray.rows; ++y) {
        const LevelRow levels(model, y, gray.size());
        float* row = gray.ptr<float>(y);
        for (int x = 0; x < gray.cols; ++x)
            row[x] = static_cast<float>(
                model.between(levels.black(x), levels.white(x), curve.value(row[x])).gray);
    }
    return gray;
}

namespace {

constexpr int samples_per_code = 16, most_bits = 10;

// Linear signals in DN between which codes change, and those of codes themselves.
class CodeScale {
public:
    explicit CodeScale(const Sensor& sensor)
        : sensor_(sensor), range_((1 << sensor.bits) - 1 - sensor.black_dn) {
        const double highest = sensor.black_dn + range_ * encode(sensor.transfer, 1.0);
        for (double code = 1.0; code - 0.5 < highest; ++code)
            thresholds_.push_back(signal(code - 0.5));
    }

    double signal(double code) const {
        return range_ * decode(sensor_.transfer, (code - sensor_.black_dn) / range_);
    }

    // Of the linear signal at this code, with the floor of MeanCode::at.
    double noise(double code) const {
        constexpr double least_codes = 0.1;
        const double s = std::max(signal(code), 0.0);
        const double code_width = signal(code + 0.5) - signal(code - 0.5);
        return std::max(std::sqrt(s / sensor_.gain_e_per_dn +
                                  std::pow(sensor_.read_noise_e / sensor_.gain_e_per_dn, 2)),
                        least_codes * code_width);
    }

    struct Mean {
        double code = 0.0, by_log_noise = 0.0;
    };
    Mean mean(double at_code) const {
        constexpr double certain = 7.0;  // standard deviations
        const double s = signal(at_code), sigma = noise(at_code);
        auto threshold = std::ranges::lower_bound(thresholds_, s - certain * sigma);
        Mean mean{static_cast<double>(threshold - thresholds_.begin())};
        for (; threshold != thresholds_.end() && *threshold < s + certain * sigma; ++threshold) {
            const double z = (s - *threshold) / sigma;
            mean.code += 0.5 * std::erfc(-z * std::numbers::sqrt2 / 2.0);
            mean.by_log_noise -= z * (std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi));
        }
        return mean;
    }

private:
    Sensor sensor_;
    double range_;
    std::vector<double> thresholds_;  // t_1, t_2, ...
};

}  // namespace

MeanCode::MeanCode(const Sensor& sensor) {
    if (sensor.gain_e_per_dn == 0.0 || sensor.bits > most_bits)
        return;
    const int full_scale = (1 << sensor.bits) - 1;
    codes_per_gray_ = full_scale / 255.0;
    const CodeScale scale(sensor);
    for (int i = -samples_per_code; i <= (full_scale + 1) * samples_per_code; ++i) {
        const CodeScale::Mean mean = scale.mean(static_cast<double>(i) / samples_per_code);
        mean_.push_back(mean.code);
        by_log_noise_.push_back(mean.by_log_noise);
    }
}

MeanCode::Point MeanCode::at(double gray) const {
    if (mean_.empty())
        return {.gray = gray};
    const double last = static_cast<double>(mean_.size() - 1);
    const double place = (gray * codes_per_gray_ + 1.0) * samples_per_code;
    if (!(place > 0.0 && place < last))
        return {place > 0.0 ? mean_.back() / codes_per_gray_ : mean_.front() / codes_per_gray_, 0.0,
                0.0};
    const auto below = static_cast<std::size_t>(place);
    const double part = place - static_cast<double>(below);
    return {std::lerp(mean_[below], mean_[below + 1], part) / codes_per_gray_,
            (mean_[below + 1] - mean_[below]) * samples_per_code,
            std::lerp(by_log_noise_[below], by_log_noise_[below + 1], part) / codes_per_gray_};
}

}  // namespace etalon
