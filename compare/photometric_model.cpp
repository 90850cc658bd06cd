#include "compare/photometric_model.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <limits>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "core/errors.h"
#include "sim/sensor_model.h"

namespace etalon {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Levels = Eigen::Matrix<double, 6, 1>;  // black 0..2, white 3..5

// What a pixel sees of the six levels.
Levels level_basis(const Eigen::Vector3d& plane, double seen) {
    Levels basis;
    basis << (1.0 - seen) * plane, seen * plane;
    return basis;
}

// What the sensor's curve makes of a blurred rendering, 0..1.
cv::Mat seen_by_sensor(const Radiance& radiance, const Eigen::Vector2d& sigmas_px,
                       const Transfer& transfer) {
    cv::Mat seen = blurred(radiance, sigmas_px);
    if (transfer.kind != Transfer::Kind::linear)
        for (int y = 0; y < seen.rows; ++y)
            for (float& value : cv::Mat_<float>(seen.row(y)))
                value = static_cast<float>(encode(transfer, value));
    return seen;
}

// The fitted pixels, in a region that holds them and what blurs into them.
struct Samples {
    cv::Rect region;
    cv::Mat radiance;  // of the region
    Transfer transfer;
    std::vector<cv::Point> places;    // within the region
    std::vector<Eigen::Vector3d> at;  // plane's terms in the whole image
    std::vector<double> gray;
};

Samples gather(const cv::Mat& photo_gray, const Radiance& radiance, const Transfer& transfer,
               const cv::Mat& use, uchar fitted) {
    const cv::Mat chosen = use == fitted;
    const int room = static_cast<int>(std::ceil(5.0 * max_psf_sigma_px));
    cv::Rect region = cv::boundingRect(chosen);
    region -= cv::Point(room, room);
    region += cv::Size(2 * room, 2 * room);
    region &= cv::Rect({0, 0}, use.size());
    Samples samples{region, radiance(region), transfer, {}, {}, {}};
    for (int y = region.y; y < region.br().y; ++y)
        for (int x = region.x; x < region.br().x; ++x) {
            if (!chosen.at<uchar>(y, x))
                continue;
            samples.places.emplace_back(x - region.x, y - region.y);
            samples.at.emplace_back(level_terms(x, y, use.size()).head<3>());
            samples.gray.push_back(photo_gray.at<float>(y, x));
        }
    return samples;
}

struct LevelFit {
    Levels levels = Levels::Zero();
    std::vector<double> residuals;  // gray, one per sample
    double loss = std::numeric_limits<double>::infinity();
};

double huber_weight(double residual, double threshold) {
    const double size = std::abs(residual);
    return size <= threshold ? 1.0 : threshold / size;
}

double huber_loss(double residual, double threshold) {
    const double size = std::abs(residual);
    return size <= threshold ? 0.5 * size * size : threshold * (size - 0.5 * threshold);
}

// Solves the normal equations; NumericalError when they do not determine all six levels. The bound
// on the condition leaves half of a double's digits and is far below what any usable tag gives.
Levels solve_levels(const Matrix6& normal, const Levels& right) {
    const Eigen::SelfAdjointEigenSolver<Matrix6> solver(normal);
    const Levels values = solver.eigenvalues();
    if (!normal.allFinite() || !right.allFinite() || !(values[0] > 1e-9 * values[5]))
        throw NumericalError(
            fmt::format("the pixels do not determine black and white planes (eigenvalues {:.3g} "
                        "to {:.3g})",
                        values[0], values[5]));
    return solver.eigenvectors() * values.cwiseInverse().asDiagonal() *
           solver.eigenvectors().transpose() * right;
}

// One weighted least squares fit on the basis rows.
Levels weighted_levels(const std::vector<Levels>& rows, const std::vector<double>& gray,
                       const std::vector<double>& residuals, double threshold) {
    Matrix6 normal = Matrix6::Zero();
    Levels right = Levels::Zero();
    for (std::size_t i = 0; i < rows.size(); ++i) {
        const double weight = residuals.empty() ? 1.0 : huber_weight(residuals[i], threshold);
        normal.noalias() += weight * rows[i] * rows[i].transpose();
        right += weight * gray[i] * rows[i];
    }
    return solve_levels(normal, right);
}

// The levels for one PSF width. With an infinite threshold this is plain least squares.
LevelFit fit_levels(const Samples& samples, double sigma_px, double threshold) {
    constexpr int max_reweightings = 8;
    const cv::Mat seen =
        seen_by_sensor(samples.radiance, Eigen::Vector2d::Constant(sigma_px), samples.transfer);
    std::vector<Levels> rows;
    rows.reserve(samples.places.size());
    for (std::size_t i = 0; i < samples.places.size(); ++i)
        rows.push_back(level_basis(samples.at[i], seen.at<float>(samples.places[i])));

    LevelFit fit;
    const int rounds = std::isinf(threshold) ? 1 : max_reweightings;
    for (int round = 0; round < rounds; ++round) {
        const Levels before = fit.levels;
        fit.levels = weighted_levels(rows, samples.gray, fit.residuals, threshold);
        fit.residuals.resize(rows.size());
        fit.loss = 0.0;
        for (std::size_t i = 0; i < rows.size(); ++i) {
            fit.residuals[i] = samples.gray[i] - rows[i].dot(fit.levels);
            fit.loss += huber_loss(fit.residuals[i], threshold);
        }
        if ((fit.levels - before).lpNorm<Eigen::Infinity>() < 1e-3)
            break;
    }
    return fit;
}

// Three robust standard deviations: edges that the model does not quite reach count in full, a
// finger on the board or a lamp's reflection does not. Never below half a code value of an 8-bit
// camera, so that perfect renderings fit. (1.4826 * median of |x| estimates a normal sigma.)
double huber_threshold(std::vector<double> residuals) {
    for (double& residual : residuals)
        residual = std::abs(residual);
    const auto middle = residuals.begin() + static_cast<std::ptrdiff_t>(residuals.size() / 2);
    std::nth_element(residuals.begin(), middle, residuals.end());
    return std::max(3.0 * 1.4826 * *middle, 0.5);
}

// Minimum of a function of one variable with a single minimum in [low, high].
double golden_section(double low, double high, double tolerance,
                      const std::function<double(double)>& loss) {
    constexpr double ratio = 0.6180339887498949;
    double a = high - ratio * (high - low), b = low + ratio * (high - low);
    double loss_a = loss(a), loss_b = loss(b);
    while (high - low > tolerance) {
        if (loss_a < loss_b) {
            high = b;
            b = a;
            loss_b = loss_a;
            a = high - ratio * (high - low);
            loss_a = loss(a);
        } else {
            low = a;
            a = b;
            loss_a = loss_b;
            b = low + ratio * (high - low);
            loss_b = loss(b);
        }
    }
    return 0.5 * (low + high);
}

// The width of least loss: a grid first, as the loss need not be convex far from its minimum.
double best_sigma(const std::function<double(double)>& loss) {
    constexpr double step = 0.25;
    double best = 0.0, least = std::numeric_limits<double>::infinity();
    for (double sigma = 0.0; sigma <= max_psf_sigma_px; sigma += step) {
        const double value = loss(sigma);
        if (value < least) {
            least = value;
            best = sigma;
        }
    }
    const double refined = golden_section(std::max(best - step, 0.0),
                                          std::min(best + step, max_psf_sigma_px), 0.002, loss);
    return loss(refined) < least ? refined : best;  // at the ends of the range the grid is right
}

void require_usable(const cv::Mat& photo_gray, const Radiance& radiance, const cv::Mat& use) {
    if (photo_gray.type() != CV_32FC1 || radiance.type() != CV_32FC1 || use.type() != CV_8UC1 ||
        photo_gray.size() != radiance.size() || photo_gray.size() != use.size())
        throw NumericalError(fmt::format(
            "photograph {} x {}, rendering {} x {} and mask {} x {} px cannot be compared",
            photo_gray.cols, photo_gray.rows, radiance.cols, radiance.rows, use.cols, use.rows));
}

// Half of the second difference of fourth order, (-1 16 -30 16 -1) / 24, at a frequency.
double half_second_difference(double frequency) {
    return (-15.0 + 16.0 * std::cos(frequency) - std::cos(2.0 * frequency)) / 12.0;
}

// exp(variance * half_second_difference) as a kernel: the inverse Fourier transform by the
// trapezoidal rule, which for a periodic function is exact but for what wraps around.
cv::Mat discrete_gaussian(double sigma_px) {
    const int radius = static_cast<int>(std::ceil(5.0 * sigma_px)) + 4;
    const int steps = 4 * radius;
    cv::Mat kernel(1, 2 * radius + 1, CV_64F, cv::Scalar(0.0));
    for (int k = 0; k < steps; ++k) {
        const double frequency = 2.0 * std::numbers::pi * k / steps;
        const double gain = std::exp(sigma_px * sigma_px * half_second_difference(frequency));
        for (int n = -radius; n <= radius; ++n)
            kernel.at<double>(n + radius) += gain * std::cos(n * frequency) / steps;
    }
    return kernel / cv::sum(kernel)[0];
}

}  // namespace

Vector6d level_terms(double x, double y, cv::Size size) {
    const double u = (x - 0.5 * (size.width - 1)) / size.width;
    const double v = (y - 0.5 * (size.height - 1)) / size.height;
    Vector6d terms;
    terms << 1.0, u, v, u * u, u * v, v * v;
    return terms;
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
    const double below = 0.5 * std::erfc(-z / std::numbers::sqrt2);
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
    const double dark = black.dot(level_terms), contrast = white.dot(level_terms) - dark;
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

PhotometricModel fit_photometric_model(const cv::Mat& photo_gray, const Radiance& radiance,
                                       const Transfer& transfer, const cv::Mat& use, uchar fitted) {
    constexpr double typical_sigma_px = 0.75;
    constexpr std::size_t least_pixels = 50;  // a few for each of the seven parameters
    require_usable(photo_gray, radiance, use);
    const Samples samples = gather(photo_gray, radiance, transfer, use, fitted);
    if (samples.places.size() < least_pixels)
        throw NumericalError(
            fmt::format("only {} pixels of the marker can be fitted", samples.places.size()));
    const LevelFit plain =
        fit_levels(samples, typical_sigma_px, std::numeric_limits<double>::infinity());
    const double threshold = huber_threshold(plain.residuals);
    const double sigma = best_sigma(
        [&](double candidate) { return fit_levels(samples, candidate, threshold).loss; });
    const Levels levels = fit_levels(samples, sigma, threshold).levels;
    PhotometricModel model;
    model.black.head<3>() = levels.head<3>();
    model.white.head<3>() = levels.tail<3>();
    model.psf_sigma_px = sigma;
    model.pixels = static_cast<int>(samples.places.size());
    return model;
}

cv::Mat predicted_gray(const PhotometricModel& model, const Radiance& radiance,
                       const Transfer& transfer) {
    cv::Mat gray = seen_by_sensor(radiance, model.psf_sigmas_px(), transfer);
    for (int y = 0; y < gray.rows; ++y)
        for (int x = 0; x < gray.cols; ++x) {
            float& value = gray.at<float>(y, x);
            value = static_cast<float>(model.at(level_terms(x, y, gray.size()), value).gray);
        }
    return gray;
}

}  // namespace etalon
