#include "compare/characterise/photon_transfer.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "compare/characterise/code_statistics.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"
#include "sim/sensor/sensor_model.h"

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

// Least squares of `difference` on the regressors: relative brightness, minus the shift in x and y.
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

// The noise of every pixel, from photographs in linear signal.
struct ViewNoise {
    cv::Mat mean;                   // CV_32FC1, over the photographs
    cv::Mat variance;               // CV_32FC1, sample variance over them; unbiased
    std::vector<cv::Mat> residual;  // CV_32FC1 of each photograph, brightness and shift taken out
    double brightness_drift = 0.0;  // largest relative difference between two photographs
    double shift_px = 0.0;          // largest displacement of one from their mean
};

// `signals`: CV_32FC1, linear, 0 without light. Each photograph's brightness and shift against the
// mean are taken out. `step`: distance of neighbours of the same colour.
ViewNoise view_noise(std::span<const cv::Mat> signals, const cv::Mat& use, int step) {
    if (cv::countNonZero(use) == 0)
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

// Pixels whose mean differs from that of each of the four neighbours at distance `step` by less
// than `most`. The image's border is never smooth.
cv::Mat smooth_pixels(const cv::Mat& mean, const cv::Mat& most, int step) {
    cv::Mat smooth = cv::Mat::zeros(mean.size(), CV_8UC1);
    if (std::min(mean.cols, mean.rows) <= 2 * step)
        return smooth;
    const cv::Rect inside(step, step, mean.cols - 2 * step, mean.rows - 2 * step);
    smooth(inside) = 255;
    for (const cv::Point& to :
         {cv::Point(-step, 0), cv::Point(step, 0), cv::Point(0, -step), cv::Point(0, step)})
        smooth(inside) &= cv::abs(mean(inside + to) - mean(inside)) < most(inside);
    return smooth;
}

// Mean over the 5 x 5 used pixels around, at distances of `step`; 0 where no pixel is used. A
// pixel's own mean is noisy: pixels sorted by it would seem brighter at the end of a tone's range.
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

// Correlation of a residual between used pixels (x, y) and (x + dx, y + dy); 0 without pairs.
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

// Noise before rounding, of codes with this variance: at least.
double least_noise(double code_variance) {
    const double square = std::max(code_variance - rounding_variance, 0.0);
    const double doubt = rounding_uncertainty_of_variance(std::sqrt(square));
    return std::sqrt(std::max(square - doubt, 0.0));
}

void refuse_light_and_drift(const BlackLevel& black, double max_pattern_dn) {
    if (black.fixed_pattern_dn > max_pattern_dn)
        throw NumericalError(fmt::format(
            "black level: the dark photos show a picture (pixels' means differ by {:.3g} "
            "DN RMS): is the lens covered?",
            black.fixed_pattern_dn));
    const double noise = std::sqrt(black.temporal_variance_dn2);
    if (black.drift_dn > 0.5 * std::max(noise, 1.0))
        throw NumericalError(
            fmt::format("black level: the dark photos' means drift by {:.3g} DN (noise of a pixel "
                        "{:.3g} DN): let the camera warm up",
                        black.drift_dn, noise));
}

}  // namespace

BlackLevel measure_black_level(std::span<const CodeImage> frames) {
    constexpr double max_at_floor = 1e-3, max_fixed_pattern = 0.03;  // of full scale
    if (frames.empty())
        throw NumericalError("black level: no dark photos");
    require_alike(frames, "black level");
    const CodeImage& first = frames.front();
    const double n = static_cast<double>(frames.size());
    const double pixels = static_cast<double>(first.pixels.total());
    // Differences from the first frame, so that nothing cancels.
    cv::Mat sum = cv::Mat::zeros(first.pixels.size(), CV_64FC1), squares = sum.clone(), difference;
    cv::Mat means(1, static_cast<int>(n), CV_64FC1);
    for (int i = 0; i < means.cols; ++i) {
        const CodeImage& frame = frames[static_cast<std::size_t>(i)];
        if (const double share = share_at_floor(frame); share > max_at_floor)
            throw NumericalError(fmt::format(
                "black level: {:.3g} % of a dark photo's pixels are at code 0, where it is cut "
                "off: raise the camera's black level",
                100.0 * share));
        cv::subtract(frame.pixels, first.pixels, difference, cv::noArray(), CV_64F);
        sum += difference;
        squares += difference.mul(difference);
        means.at<double>(i) = cv::mean(frame.pixels)[0];
    }
    cv::Scalar mean, deviation, level, pattern;
    cv::meanStdDev(means, mean, deviation);
    const auto [lowest, highest] = std::minmax_element(means.begin<double>(), means.end<double>());

    BlackLevel black;
    black.frames = means.cols;
    black.dn = mean[0];
    black.drift_dn = *highest - *lowest;
    if (n > 1.0) {
        const cv::Mat deviations = squares - sum.mul(sum) / n;
        black.temporal_variance_dn2 = std::max(cv::mean(deviations)[0] / (n - 1.0), 0.0);
        black.temporal_variance_standard_uncertainty =
            black.temporal_variance_dn2 * std::sqrt(2.0 / ((n - 1.0) * pixels));
    }
    cv::Mat own;
    first.pixels.convertTo(own, CV_64F);
    cv::meanStdDev(cv::Mat(own + sum / n), level, pattern);
    black.fixed_pattern_dn =
        std::sqrt(std::max(pattern[0] * pattern[0] - black.temporal_variance_dn2 / n, 0.0));
    refuse_light_and_drift(black, max_fixed_pattern * first.full_scale());

    // With one frame the noise is not told from the fixed pattern: their sum is an upper bound.
    const double variance =
        n > 1.0 ? black.temporal_variance_dn2 : black.fixed_pattern_dn * black.fixed_pattern_dn;
    const double scatter = n > 1.0 ? deviation[0] * deviation[0] / (n - 1.0) : 0.0;
    const double rounding = rounding_uncertainty_of_mean(least_noise(variance));
    black.standard_uncertainty_dn =
        std::sqrt(std::max(variance / (n * pixels), scatter) + rounding * rounding);
    return black;
}

namespace {

constexpr int bins = 64;
constexpr double min_pixels_of_a_level = 100.0;
constexpr double max_clipped_of_a_level = 1e-4;  // of a level's pixels
constexpr double min_code_variance = 0.24;       // DN^2, EMVA 1288: below, rounding rules
constexpr double max_drift_of_a_level = 0.02, max_shift_px = 0.25;
constexpr double max_changed = 1e-3;  // share of pixels
constexpr double max_noise = 0.15;    // of full scale
constexpr double max_correlation = 0.05;
constexpr double max_gain_uncertainty = 0.2;  // relative
constexpr double max_misfit = 0.1;            // relative

struct Bin {
    double pixels = 0.0, clipped = 0.0, signal = 0.0, variance = 0.0, degrees_of_freedom = 0.0;
};

class LevelScale {
public:
    explicit LevelScale(const Sensor& sensor)
        : transfer_(sensor.transfer), range_((1 << sensor.bits) - 1 - sensor.black_dn) {}

    // Finer where the signal and its noise are small.
    int bin(double signal_dn) const {
        const double root = std::sqrt(std::clamp(signal_dn / range_, 0.0, 1.0));
        return std::min(static_cast<int>(bins * root), bins - 1);
    }
    // Code values per DN of linear signal.
    double slope(double signal_dn) const {
        constexpr double step = 1e-3;
        const double radiance = std::clamp(signal_dn / range_, 0.0, 1.0 - step);
        return (encode(transfer_, radiance + step) - encode(transfer_, radiance - step)) /
               (2.0 * step);
    }
    double range() const { return range_; }

private:
    Transfer transfer_;
    double range_;
};

// Variance by level as the median over its pixels: what outliers are told from.
std::vector<double> median_variances(const ViewNoise& noise, const cv::Mat& use,
                                     const LevelScale& scale, double degrees_of_freedom) {
    std::vector<std::vector<double>> variances(bins);
    for (int y = 0; y < use.rows; ++y)
        for (int x = 0; x < use.cols; ++x)
            if (use.at<uchar>(y, x))
                variances[scale.bin(noise.mean.at<float>(y, x))].push_back(
                    noise.variance.at<float>(y, x));
    std::vector<double> medians(bins, 0.0);
    const double share = 0.005 * static_cast<double>(use.total());
    for (int i = 0; i < bins; ++i) {
        if (variances[i].empty())
            continue;
        const double many = static_cast<double>(variances[i].size());
        medians[i] = median(std::move(variances[i])) / reduced_chi_square(0.0, degrees_of_freedom);
        if (many > share && std::sqrt(medians[i]) > max_noise * scale.range())
            throw NumericalError(fmt::format(
                "repeats: pixels differ by {:.3g} DN RMS where the signal is about {:.3g} DN: more "
                "than any noise; they do not show the same view",
                std::sqrt(medians[i]), scale.range() * std::pow((i + 0.5) / bins, 2)));
    }
    return medians;
}

cv::Mat by_level(const cv::Mat& mean, const LevelScale& scale, const std::vector<double>& values,
                 double factor) {
    cv::Mat result(mean.size(), CV_32FC1);
    for (int y = 0; y < mean.rows; ++y)
        for (int x = 0; x < mean.cols; ++x)
            result.at<float>(y, x) =
                static_cast<float>(factor * values[scale.bin(mean.at<float>(y, x))]);
    return result;
}

// Pixels that changed by more than noise does in one of a million.
cv::Mat changed_pixels(const ViewNoise& noise, const cv::Mat& use, const LevelScale& scale,
                       const std::vector<double>& variances, double degrees_of_freedom) {
    constexpr double one_in_a_million = 4.75;
    // Of codes that hardly vary the median may be 0; rounding's own variance is the least.
    std::vector<double> limits(bins);
    for (int i = 0; i < bins; ++i) {
        const double slope = scale.slope(scale.range() * std::pow((i + 0.5) / bins, 2));
        limits[i] = std::max(variances[i], 0.25 / (slope * slope));
    }
    const cv::Mat limit = by_level(noise.mean, scale, limits,
                                   reduced_chi_square(one_in_a_million, degrees_of_freedom));
    cv::Mat changed = noise.variance > limit;
    changed &= use;
    return changed;
}

void refuse_change(const ViewNoise& noise) {
    if (noise.brightness_drift > max_drift_of_a_level)
        throw NumericalError(fmt::format(
            "repeats: brightness drifts by {:.2g} %: the light is not steady (over {:.0f} %)",
            100.0 * noise.brightness_drift, 100.0 * max_drift_of_a_level));
    if (noise.shift_px > max_shift_px)
        throw NumericalError(
            fmt::format("repeats: the view moved by {:.2g} px between them", noise.shift_px));
}

void add_view(const RepeatedView& view, const SensorModel& sensor, const LevelScale& scale,
              const CameraModel& camera, PhotonTransfer& result, std::vector<Bin>& levels) {
    std::vector<cv::Mat> signals;
    cv::Mat clipped = cv::Mat::zeros(view.front().pixels.size(), CV_8UC1);
    for (const CodeImage& image : view) {
        signals.push_back(sensor.linear_radiance(image) * scale.range());
        clipped |= (image.pixels == 0) | (image.pixels >= result.saturation_code);
    }
    const cv::Mat use = ~clipped;
    const int step = camera.sensor->mosaic == Mosaic::none ? 1 : 2;
    const double degrees_of_freedom = static_cast<double>(view.size()) - 1.0;
    const ViewNoise noise = view_noise(signals, use, step);
    refuse_change(noise);
    const std::vector<double> medians = median_variances(noise, use, scale, degrees_of_freedom);
    cv::Mat deviation = by_level(noise.mean, scale, medians, 1.0);
    cv::sqrt(deviation, deviation);
    const cv::Mat smooth = smooth_pixels(noise.mean, 2.0 * deviation + 1e-3, step);
    cv::Mat even = use & smooth;
    const cv::Mat changed = changed_pixels(noise, even, scale, medians, degrees_of_freedom);
    const double share = cv::countNonZero(changed) / std::max(1.0, double(cv::countNonZero(even)));
    if (share > max_changed)
        throw NumericalError(fmt::format(
            "repeats: {:.3g} % of the pixels changed by more than noise: they do not show the same "
            "view",
            100.0 * share));
    even &= ~changed;
    result.brightness_drift = std::max(result.brightness_drift, noise.brightness_drift);
    result.shift_px = std::max(result.shift_px, noise.shift_px);
    for (const auto& [dx, dy] : {std::pair{1, 0}, std::pair{0, 1}}) {
        const double correlation = neighbour_correlation(noise.residual, even, dx, dy);
        if (std::abs(correlation) > std::abs(result.noise_correlation))
            result.noise_correlation = correlation;
    }
    const cv::Mat level = local_level(noise.mean, even, step);
    for (int y = 0; y < even.rows; ++y)
        for (int x = 0; x < even.cols; ++x) {
            if (clipped.at<uchar>(y, x))
                levels[scale.bin(noise.mean.at<float>(y, x))].clipped += 1.0;
            if (!even.at<uchar>(y, x))
                continue;
            Bin& bin = levels[scale.bin(level.at<float>(y, x))];
            bin.pixels += 1.0;
            bin.signal += noise.mean.at<float>(y, x);
            bin.variance += noise.variance.at<float>(y, x);
            bin.degrees_of_freedom += degrees_of_freedom;
        }
}

// A level before the fit, with what rounding did to it.
struct Measured {
    NoiseLevel level;
    double rounding_dn2 = 0.0;          // variance that rounding added, taken out of the level's
    double rounding_uncertainty = 0.0;  // of that
    double degrees_of_freedom = 0.0;

    // Squared standard uncertainty of the variance when the true one is `variance`.
    double weight_variance(double variance) const {
        const double total = variance + rounding_dn2;
        return 2.0 * total * total / degrees_of_freedom +
               rounding_uncertainty * rounding_uncertainty;
    }
};

Measured measured(double signal, double variance, double pixels, double degrees_of_freedom,
                  double slope) {
    Measured result;
    result.rounding_dn2 = rounding_variance / (slope * slope);
    const double code_variance = variance * slope * slope;
    const double code_sigma = std::sqrt(std::max(code_variance - rounding_variance, 0.0));
    result.rounding_uncertainty = rounding_uncertainty_of_variance(code_sigma) / (slope * slope);
    result.degrees_of_freedom = degrees_of_freedom;
    result.level = {signal, variance - result.rounding_dn2, 0.0, 0.0, pixels, false};
    result.level.standard_uncertainty_dn2 =
        std::sqrt(result.weight_variance(result.level.variance_dn2));
    result.level.is_used = code_variance >= min_code_variance;
    return result;
}

std::vector<Measured> measured_levels(const std::vector<Bin>& levels, const LevelScale& scale,
                                      const std::optional<BlackLevel>& dark) {
    std::vector<Measured> result;
    if (dark && dark->frames > 1) {
        const double slope = scale.slope(0.0), variance = dark->temporal_variance_dn2;
        const double relative =
            dark->temporal_variance_standard_uncertainty / std::max(variance, 1e-30);
        result.push_back(measured(0.0, variance / (slope * slope), 0.0,
                                  2.0 / std::max(relative * relative, 1e-12), slope));
    }
    for (const Bin& bin : levels) {
        if (bin.pixels < min_pixels_of_a_level)
            continue;
        const double signal = bin.signal / bin.pixels;
        result.push_back(measured(signal, bin.variance / bin.pixels, bin.pixels,
                                  bin.degrees_of_freedom, scale.slope(signal)));
        if (bin.clipped > max_clipped_of_a_level * bin.pixels)
            result.back().level.is_used = false;
    }
    return result;
}

struct StraightLine {
    Eigen::Vector2d value = Eigen::Vector2d::Zero();  // at signal 0, and slope
    Eigen::Matrix2d covariance;
    double chi_square;
};

// Weights from the fitted line: those of the scattering values would favour low ones.
StraightLine fit_line(const std::vector<Measured>& levels) {
    StraightLine line;
    for (int round = 0; round < 6; ++round) {
        Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
        Eigen::Vector2d right = Eigen::Vector2d::Zero();
        line.chi_square = 0.0;
        for (const Measured& m : levels) {
            if (!m.level.is_used)
                continue;
            const Eigen::Vector2d row(1.0, m.level.signal_dn);
            const double model = round == 0 ? m.level.variance_dn2 : line.value.dot(row);
            const double weight = 1.0 / m.weight_variance(std::max(model, 0.0));
            normal += weight * row * row.transpose();
            right += weight * m.level.variance_dn2 * row;
            const double residual = m.level.variance_dn2 - line.value.dot(row);
            line.chi_square += weight * residual * residual;
        }
        line.covariance = normal.inverse();
        line.value = line.covariance * right;
    }
    return line;
}

void refuse_misfit(const std::vector<NoiseLevel>& levels) {
    for (const NoiseLevel& level : levels) {
        const double off = std::abs(level.variance_dn2 - level.model_dn2);
        if (level.is_used &&
            off > max_misfit * level.model_dn2 + 4.0 * level.standard_uncertainty_dn2)
            throw NumericalError(fmt::format(
                "photon transfer: the noise at a signal of {:.4g} DN has the variance {:.4g} DN^2, "
                "not the {:.4g} of read and photon noise: transfer curve or black level are not "
                "what the camera file says, or the camera filters its pictures",
                level.signal_dn, level.variance_dn2, level.model_dn2));
    }
}

// Gain g = 1/b and read noise sqrt(a)/b from the line a + b s.
void take_gain(const StraightLine& line, PhotonTransfer& result) {
    const double b = line.value(1), u_b = std::sqrt(line.covariance(1, 1));
    if (!(b > 0.0) || !(u_b < max_gain_uncertainty * b))
        throw NumericalError(fmt::format(
            "photon transfer: the variance rises by {:.3g} +- {:.3g} DN^2 per DN of signal "
            "(k = 1), which determines no gain: more photos, or darker and brighter parts",
            b, u_b));
    result.gain_e_per_dn = 1.0 / b;
    result.gain_standard_uncertainty = u_b / (b * b);
    result.covariance(0, 0) = std::pow(result.gain_standard_uncertainty, 2);
}

void take_read_noise(const StraightLine& line, double u_black, PhotonTransfer& result) {
    const double a = line.value(0), b = line.value(1);
    Eigen::Matrix2d covariance = line.covariance;
    covariance(0, 0) += std::pow(b * u_black, 2);
    const double u_a = std::sqrt(covariance(0, 0));
    if (!(a > 2.0 * u_a)) {
        result.read_noise_remark =
            fmt::format("below {:.2g} e: not told from the photon noise and rounding",
                        std::sqrt(std::max(a, 0.0) + 2.0 * u_a) / b);
        return;
    }
    Eigen::Matrix2d jacobian;
    jacobian << 0.0, -1.0 / (b * b), 0.5 / (std::sqrt(a) * b), -std::sqrt(a) / (b * b);
    result.covariance = jacobian * covariance * jacobian.transpose();
    result.read_noise_e = std::sqrt(a) / b;
    result.read_noise_standard_uncertainty_e = std::sqrt(result.covariance(1, 1));
}

}  // namespace

PhotonTransfer measure_photon_transfer(std::span<const RepeatedView> views,
                                       const CameraModel& camera,
                                       const std::optional<BlackLevel>& dark) {
    if (!camera.sensor)
        throw NumericalError("photon transfer needs the sensor section of the camera");
    const SensorModel sensor(camera);
    const LevelScale scale(*camera.sensor);
    std::vector<CodeImage> all;
    for (const RepeatedView& view : views) {
        if (view.size() < 2)
            throw NumericalError("repeats: two photos at least of the same view are needed");
        all.insert(all.end(), view.begin(), view.end());
    }
    require_alike(all, "repeats");
    PhotonTransfer result;
    result.saturation_code = saturation_code(all);
    std::vector<Bin> sums(bins);
    for (const RepeatedView& view : views)
        add_view(view, sensor, scale, camera, result, sums);
    if (std::abs(result.noise_correlation) > max_correlation)
        throw NumericalError(
            fmt::format("repeats: the noise of neighbouring pixels is correlated ({:.2f}): these "
                        "are not raw pixels (JPEG, interpolated colours, denoising or sharpening)",
                        result.noise_correlation));

    std::vector<Measured> levels = measured_levels(sums, scale, dark);
    const auto used = static_cast<int>(
        std::ranges::count_if(levels, [](const Measured& m) { return m.level.is_used; }));
    if (used < 4)
        throw NumericalError(fmt::format(
            "photon transfer: {} levels are neither clipped nor lost in the rounding; 4 are needed",
            used));
    StraightLine line = fit_line(levels);
    result.degrees_of_freedom = used - 2;
    result.reduced_chi_square = line.chi_square / result.degrees_of_freedom;
    line.covariance *= std::max(result.reduced_chi_square, 1.0);
    for (Measured& m : levels) {
        m.level.model_dn2 = line.value(0) + line.value(1) * m.level.signal_dn;
        result.levels.push_back(m.level);
    }
    take_gain(line, result);
    refuse_misfit(result.levels);
    if (dark)
        take_read_noise(line, dark->standard_uncertainty_dn, result);
    else
        result.read_noise_remark = "no dark photos: the signal's zero is not known";
    return result;
}

}  // namespace etalon
