#include "sim/sensor/sensor_model.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <atomic>

#include "calib/camera/projector.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// ITU-R BT.709-6, item 1.2.
constexpr double rec709_slope = 4.5, rec709_break = 0.018;
constexpr double rec709_scale = 1.099, rec709_offset = 0.099, rec709_exponent = 0.45;

double encode_rec709(double radiance) {
    if (radiance < rec709_break)
        return rec709_slope * radiance;
    return rec709_scale * std::pow(std::min(radiance, 1.0), rec709_exponent) - rec709_offset;
}

double decode_rec709(double code) {
    if (code < rec709_slope * rec709_break)
        return code / rec709_slope;
    const double power = (std::min(code, 1.0) + rec709_offset) / rec709_scale;
    return std::max(rec709_break, std::pow(power, 1.0 / rec709_exponent));
}

// Full scale is 1. Limited so that a signal stays finite at any gain and 0 has no photon noise.
SensorNoise noise_of(const Sensor& sensor, double range_dn) {
    constexpr double most = 1e200;
    const double electrons = sensor.gain_e_per_dn * range_dn;
    const double read = sensor.read_noise_e / electrons;
    return {std::min(1.0 / electrons, most), std::min(read * read, most)};
}

using Point = std::pair<double, double>;

// Straight lines through the points (x, y), x ascending: extended below the first, constant above
// the last.
double interpolate(const std::vector<Point>& table, double Point::*x_of, double Point::*y_of,
                   double x) {
    if (x >= table.back().*x_of)
        return table.back().*y_of;
    const auto after = std::upper_bound(table.begin() + 1, table.end(), x,
                                        [&](double a, const Point& b) { return a < b.*x_of; });
    const Point &a = *(after - 1), &b = *after;
    return a.*y_of + (x - a.*x_of) * (b.*y_of - a.*y_of) / (b.*x_of - a.*x_of);
}

[[noreturn]] void refuse(const char* key, const std::string& message) {
    throw ConfigError({"camera", 0, std::string("sensor.") + key}, message);
}

void check_table(const std::vector<Point>& table) {
    if (table.size() < 2)
        refuse("transfer", "a table needs two points at least");
    for (std::size_t i = 0; i < table.size(); ++i) {
        const auto [radiance, code] = table[i];
        if (!(radiance >= 0.0 && radiance <= 1.0 && code >= 0.0 && code <= 1.0))
            refuse("transfer", fmt::format("table row {} is not within 0..1", i + 1));
        if (i > 0 && !(radiance > table[i - 1].first && code > table[i - 1].second))
            refuse("transfer", fmt::format("table row {} does not rise strictly", i + 1));
    }
    if (table.front().first != 0.0 || table.back().first != 1.0)
        refuse("transfer", "a table must reach from radiance 0 to radiance 1");
}

// Comparisons are written so that NaN fails them.
void check(const Sensor& sensor) {
    if (sensor.bits < 1 || sensor.bits > 16)
        refuse("bits", fmt::format("{} is not within 1..16", sensor.bits));
    const double full_scale = (1 << sensor.bits) - 1;
    if (!(sensor.black_dn >= 0.0 && sensor.black_dn < full_scale))
        refuse("black", fmt::format("{} is not in [0, {})", sensor.black_dn, full_scale));
    if (!(sensor.gain_e_per_dn >= 0.0 && std::isfinite(sensor.gain_e_per_dn)))
        refuse("gain_e_per_dn", fmt::format("{} is not a gain", sensor.gain_e_per_dn));
    if (!(sensor.read_noise_e >= 0.0 && std::isfinite(sensor.read_noise_e)))
        refuse("read_noise_e", fmt::format("{} is not a noise", sensor.read_noise_e));
    if (sensor.read_noise_e > 0.0 && sensor.gain_e_per_dn == 0.0)
        refuse("read_noise_e", "needs gain_e_per_dn: electrons cannot be converted without it");
    if (sensor.transfer.kind == Transfer::Kind::table)
        check_table(sensor.transfer.table);
    for (const double response : sensor.channel_response)
        if (!(response > 0.0 && std::isfinite(response)))
            refuse("channel_response", fmt::format("{} is not a response", response));
}

void check_illumination(const CameraModel& camera) {
    const Illumination& illumination = camera.sensor->illumination;
    if (illumination.kind == Illumination::Kind::cos4)
        require_perspective(camera, "illumination cos4");
    if (illumination.kind != Illumination::Kind::polynomial)
        return;
    const double least = least_polynomial_illumination(camera);
    if (!(least > 0.0))
        refuse("illumination", fmt::format("the polynomial falls to {} within the image", least));
}

template <class Body>
void for_each_row(int rows, Body body) {
    tbb::parallel_for(tbb::blocked_range<int>(0, rows), [&](const tbb::blocked_range<int>& range) {
        for (int y = range.begin(); y < range.end(); ++y)
            body(y);
    });
}

// `value` of the pixel (x, y), by pixel.
template <class Value>
cv::Mat map_of_pixels(const CameraModel& camera, const Value& value) {
    cv::Mat map(camera.height, camera.width, CV_32FC1);
    for_each_row(map.rows, [&](int y) {
        for (int x = 0; x < map.cols; ++x)
            map.at<float>(y, x) = static_cast<float>(value(Eigen::Vector2d(x, y)));
    });
    return map;
}

// The direction (x, y, 1) makes the angle with the axis whose cosine is 1 / sqrt(1 + x^2 + y^2).
cv::Mat cos4_map(const CameraModel& camera) {
    return map_of_pixels(camera, [projector = Projector(camera)](const Eigen::Vector2d& pixel) {
        const auto direction = projector.unproject(pixel);
        return direction ? 1.0 / std::pow(1.0 + direction->squaredNorm(), 2) : 1.0;
    });
}

cv::Mat polynomial_map(const CameraModel& camera) {
    return map_of_pixels(camera, [&](const Eigen::Vector2d& pixel) {
        return polynomial_illumination(camera.sensor->illumination.polynomial,
                                       illumination_radius_squared(camera, pixel));
    });
}

cv::Mat illumination_map(const CameraModel& camera) {
    const Illumination::Kind kind = camera.sensor->illumination.kind;
    return kind == Illumination::Kind::cos4         ? cos4_map(camera)
           : kind == Illumination::Kind::polynomial ? polynomial_map(camera)
                                                    : cv::Mat();
}

// Multiplies the channels' response into the map; an empty one stands for 1.
void apply_mosaic(const Sensor& sensor, cv::Size size, cv::Mat& map) {
    const auto& response = sensor.channel_response;
    if (sensor.mosaic == Mosaic::none || response == std::array{1.0, 1.0, 1.0})
        return;
    if (map.empty())
        map = cv::Mat(size, CV_32FC1, cv::Scalar(1.0));
    for (int y = 0; y < map.rows; ++y)
        for (int x = 0; x < map.cols; ++x)
            map.at<float>(y, x) *= static_cast<float>(
                response[static_cast<std::size_t>(channel_of_pixel(sensor.mosaic, x, y))]);
}

void check_size(const Radiance& radiance, cv::Size size) {
    if (radiance.type() != CV_32FC1 || radiance.size() != size)
        throw NumericalError(
            fmt::format("the sensor of {} x {} px needs a float image of that "
                        "size, not {} x {}",
                        size.width, size.height, radiance.cols, radiance.rows));
}

void check_part(const RenderedPart& part, const cv::Size& size) {
    const cv::Rect& region = part.region;
    if ((region & cv::Rect({0, 0}, size)) != region || part.radiance.size() != region.size())
        throw NumericalError(fmt::format("a part of {} x {} px at ({}, {}) is not in the sensor",
                                         region.width, region.height, region.x, region.y));
}

// Names the first such pixel, whichever thread has found one.
[[noreturn]] void refuse_not_finite(const Radiance& radiance) {
    for (int y = 0; y < radiance.rows; ++y)
        for (int x = 0; x < radiance.cols; ++x)
            if (const float value = radiance.at<float>(y, x); !std::isfinite(value))
                throw NumericalError(
                    fmt::format("the radiance at pixel ({}, {}) is {}", x, y, value));
    throw NumericalError("a pixel's signal is not finite: its response or noise is too large");
}

}  // namespace

double encode(const Transfer& transfer, double radiance) {
    if (transfer.kind == Transfer::Kind::rec709)
        return encode_rec709(radiance);
    if (transfer.kind == Transfer::Kind::table)
        return interpolate(transfer.table, &Point::first, &Point::second, radiance);
    return std::min(radiance, 1.0);
}

double decode(const Transfer& transfer, double code) {
    if (transfer.kind == Transfer::Kind::rec709)
        return decode_rec709(code);
    if (transfer.kind == Transfer::Kind::table)
        return interpolate(transfer.table, &Point::second, &Point::first, code);
    return std::min(code, 1.0);
}

Channel channel_of_pixel(Mosaic mosaic, int x, int y) {
    const bool green_first = mosaic == Mosaic::grbg || mosaic == Mosaic::gbrg;
    if (mosaic == Mosaic::none || ((x + y) % 2 != 0) != green_first)
        return Channel::green;
    const bool red_row_first = mosaic == Mosaic::rggb || mosaic == Mosaic::grbg;
    return (y % 2 == 0) == red_row_first ? Channel::red : Channel::blue;
}

SensorModel::SensorModel(const CameraModel& camera)
    : sensor_(camera.sensor.value_or(Sensor{})), size_(camera.width, camera.height) {
    check(sensor_);
    full_scale_ = (1 << sensor_.bits) - 1;
    range_ = full_scale_ - sensor_.black_dn;
    steps_.emplace(
        sensor_.bits, [&](double radiance) { return code_of(radiance); },
        [&](int code) {
            return decode(sensor_.transfer, (code + 0.5 - sensor_.black_dn) / range_);
        });
    if (!camera.sensor)
        return;
    check_illumination(camera);
    response_ = illumination_map(camera);
    apply_mosaic(sensor_, size_, response_);
}

double SensorModel::code_of(double radiance) const {
    const double code = sensor_.black_dn + range_ * encode(sensor_.transfer, radiance);
    return std::clamp(std::floor(code + 0.5), 0.0, full_scale_);
}

template <class Code>
bool SensorModel::expose_row(const float* radiance, const cv::Point& first, int count,
                             const NoiseKey* noise, Code* codes) const {
    const float* response = response_.empty() ? nullptr : response_.ptr<float>(first.y) + first.x;
    const std::int64_t pixel = std::int64_t{first.y} * size_.width + first.x;
    constexpr int most = QuantizationThresholds::max_at_once;
    bool finite = true;
    for (int x = 0; x < count && finite; x += most) {
        const int n = std::min(most, count - x);
        // The product of two floats is exact in double.
        const auto exposed = [&](int i) {
            return response ? double(radiance[x + i]) * response[x + i] : double(radiance[x + i]);
        };
        float nearest[most];
        if (noise) {
            double signals[most];
            for (int i = 0; i < n; ++i)
                signals[i] = exposed(i);
            add_noise(noise_of(sensor_, range_), *noise, static_cast<std::uint64_t>(pixel + x), n,
                      signals);
            for (int i = 0; i < n; ++i)  // infinite beyond a float's range, and so in doubt
                nearest[i] = static_cast<float>(signals[i]);
            finite = steps_->put_codes(
                nearest, true, n, [&](int i) { return signals[i]; }, codes + x);
        } else if (response) {
            for (int i = 0; i < n; ++i)
                nearest[i] = radiance[x + i] * response[x + i];
            finite = steps_->put_codes(nearest, true, n, exposed, codes + x);
        } else {
            finite = steps_->put_codes(radiance + x, false, n, exposed, codes + x);
        }
    }
    return finite;
}

// Nothing where the sensor has none.
const NoiseKey* SensorModel::used(const std::optional<NoiseKey>& noise) const {
    return noise && sensor_.gain_e_per_dn > 0.0 ? &*noise : nullptr;
}

CodeImage SensorModel::expose(const Radiance& radiance, std::optional<NoiseKey> noise) const {
    check_size(radiance, size_);
    return expose_region({cv::Rect({0, 0}, size_), radiance, 0.0, {}}, noise);
}

CodeImage SensorModel::expose(const RenderedPart& part, std::optional<NoiseKey> noise) const {
    check_part(part, size_);
    if (!response_.empty() || used(noise))
        return expose(part.within(cv::Rect({0, 0}, size_)), noise);
    if (!std::isfinite(part.background))
        throw NumericalError(fmt::format("the background's radiance is {}", part.background));
    const CodeImage seen = expose_region(part);
    const double code = code_of(static_cast<float>(part.background));
    CodeImage image{cv::Mat(size_, seen.pixels.type(), cv::Scalar(code)), seen.bits};
    if (!part.region.empty())
        seen.pixels.copyTo(image.pixels(part.region));
    return image;
}

CodeImage SensorModel::expose_region(const RenderedPart& part,
                                     std::optional<NoiseKey> noise) const {
    check_part(part, size_);
    const cv::Rect& region = part.region;
    CodeImage image{cv::Mat(region.size(), sensor_.bits > 8 ? CV_16UC1 : CV_8UC1), sensor_.bits};
    std::atomic<bool> finite = true;
    for_each_row(region.height, [&](int y) {
        const auto exposed = [&](auto* codes) {
            return expose_row(part.radiance.ptr<float>(y), {region.x, region.y + y}, region.width,
                              used(noise), codes);
        };
        if (!(sensor_.bits > 8 ? exposed(image.pixels.ptr<std::uint16_t>(y))
                               : exposed(image.pixels.ptr<std::uint8_t>(y))))
            finite = false;
    });
    if (!finite)
        refuse_not_finite(part.radiance);
    return image;
}

Radiance SensorModel::linear_radiance(const CodeImage& image) const {
    const int depth = sensor_.bits > 8 ? CV_16UC1 : CV_8UC1;
    if (image.bits != sensor_.bits || image.pixels.type() != depth)
        throw NumericalError(
            fmt::format("an image of {} bits for a sensor of {}", image.bits, sensor_.bits));
    // Every code value once, then a look-up.
    std::vector<float> radiance_of_code(static_cast<std::size_t>(full_scale_) + 1);
    for (std::size_t code = 0; code < radiance_of_code.size(); ++code)
        radiance_of_code[code] = static_cast<float>(
            decode(sensor_.transfer, (double(code) - sensor_.black_dn) / range_));
    Radiance radiance(image.pixels.size(), CV_32FC1);
    for (int y = 0; y < radiance.rows; ++y)
        for (int x = 0; x < radiance.cols; ++x) {
            const unsigned code = sensor_.bits > 8 ? image.pixels.at<std::uint16_t>(y, x)
                                                   : image.pixels.at<std::uint8_t>(y, x);
            if (code >= radiance_of_code.size())
                throw NumericalError(
                    fmt::format("pixel ({}, {}) is {}, above the full scale of {} "
                                "bits",
                                x, y, code, sensor_.bits));
            radiance.at<float>(y, x) = radiance_of_code[code];
        }
    return radiance;
}

}  // namespace etalon
