#include "compare/photometric/mean_code.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/sensor/sensor_model.h"

namespace etalon {
namespace {

constexpr int samples_per_code = 16, most_bits = 10;

double normal_density(double z) {
    return std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
}

double normal_distribution(double z) {
    return 0.5 * std::erfc(-z * std::numbers::sqrt2 / 2.0);
}

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
        return std::max(
            std::sqrt(s / sensor_.gain_e_per_dn +
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
            mean.code += normal_distribution(z);
            mean.by_log_noise -= z * normal_density(z);
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
        return {place > 0.0 ? mean_.back() / codes_per_gray_ : mean_.front() / codes_per_gray_,
                0.0, 0.0};
    const auto below = static_cast<std::size_t>(place);
    const double part = place - static_cast<double>(below);
    return {std::lerp(mean_[below], mean_[below + 1], part) / codes_per_gray_,
            (mean_[below + 1] - mean_[below]) * samples_per_code,
            std::lerp(by_log_noise_[below], by_log_noise_[below + 1], part) / codes_per_gray_};
}

}  // namespace etalon
