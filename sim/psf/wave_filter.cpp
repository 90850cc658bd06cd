#include "sim/psf/wave_filter.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/psf/diffraction.h"
#include "sim/psf/lagrange.h"

namespace etalon {
namespace {

using std::numbers::pi;

// The core ends smoothly between these distances from the geometrical disk, in units of ring_px_.
constexpr double fall_from = 3.0, fall_to = 6.0;

// What a box average at 0 contributes to a pixel centred at x: the pixel is the mean of k averages,
// each interpolated between the boxes.
double pixel_response(int k, double x) {
    double sum = 0.0;
    for (int i = 0; i < k; ++i)
        sum += lagrange6(k * x - (i - (k - 1) * 0.5));
    return sum / k;
}

// Midpoint nodes from -half to half (px along x) against `count` samples at steps of 1/k pixels of
// this pitch.
struct Nodes {
    Eigen::VectorXd position;
    Eigen::MatrixXd response;  // nodes x samples
};

Nodes nodes(double half, double step, double pitch, int k, int count) {
    const int n = 2 * static_cast<int>(std::ceil(half / step));
    Nodes result{Eigen::VectorXd(n), Eigen::MatrixXd(n, count)};
    for (int i = 0; i < n; ++i) {
        result.position[i] = (i + 0.5 - 0.5 * n) * step;
        for (int j = 0; j < count; ++j)
            result.response(i, j) =
                pixel_response(k, result.position[i] / pitch - (j - 0.5 * (count - 1)) / k);
    }
    return result;
}

}  // namespace

WaveFilter::WaveFilter(const CameraModel& camera)
    : lambda_n_px_(etalon::lambda_n_px(camera)),
      pitch_y_(camera.intrinsics.fx / camera.intrinsics.fy),
      ring_px_(std::max(1.0, 2.0 * lambda_n_px_)) {
    WavePointSpread(lambda_n_px_, max_wave_blur_px);  // refuses what is none
}

double WaveFilter::blur_step_px() const {
    return 0.25 * lambda_n_px_ / pi;  // of u: 0.25
}

double WaveFilter::core_radius_px(int index) const {
    return index * blur_step_px() + fall_to * ring_px_;
}

double WaveFilter::window(double blur_radius_px, double r) const {
    const double from = blur_radius_px + fall_from * ring_px_;
    const double t = std::clamp((r - from) / ((fall_to - fall_from) * ring_px_), 0.0, 1.0);
    return 1.0 - t * t * t * (10.0 + t * (6.0 * t - 15.0));
}

double WaveFilter::core_energy(const WavePointSpread& psf) const {
    constexpr int rings = 8000;
    const double end = psf.blur_radius_px() + fall_to * ring_px_;
    double sum = 0.0, within = 0.0;
    for (int i = 0; i < rings; ++i) {
        const double next = psf.energy_within(end * (i + 1) / rings);
        sum += window(psf.blur_radius_px(), end * (i + 0.5) / rings) * (next - within);
        within = next;
    }
    return sum;
}

const cv::Mat& WaveFilter::core(int k, int index) const {
    const std::lock_guard lock(mutex_);
    auto& slot = cores_[{k, index}];
    if (!slot)
        slot = std::make_unique<const cv::Mat>(make_core(k, index));
    return *slot;
}

cv::Size WaveFilter::core_reach(int k, int index) const {
    const auto reach = [&](double pitch) {
        return static_cast<int>(std::ceil((core_radius_px(index) / pitch + 0.5) * k)) + 3;
    };
    return {reach(1.0), reach(pitch_y_)};
}

cv::Mat WaveFilter::make_core(int k, int index) const {
    const WavePointSpread psf(lambda_n_px_, index * blur_step_px());
    const cv::Size reach = core_reach(k, index);
    const double half = core_radius_px(index);
    const double step = std::min(std::max(lambda_n_px_ / 8.0, 1.0 / 256.0), 1.0 / (8.0 * k));
    const Nodes x = nodes(half, step, 1.0, k, 2 * reach.width + k);
    const Nodes y = nodes(half, step, pitch_y_, k, 2 * reach.height + k);
    const Eigen::Index n = x.position.size();
    Eigen::MatrixXd values(n, n);
    for (Eigen::Index j = 0; j < n / 2; ++j)
        for (Eigen::Index i = 0; i <= j; ++i) {
            const double r = std::hypot(x.position[i], x.position[j]);
            const double value = psf.density(r) * window(psf.blur_radius_px(), r);
            for (const auto& [a, b] : {std::pair{i, j}, {j, i}})
                values(a, b) = values(n - 1 - a, b) = values(a, n - 1 - b) =
                    values(n - 1 - a, n - 1 - b) = value;
        }
    const Eigen::MatrixXd weights = y.response.transpose() * (values * x.response);
    const double scale = core_energy(psf) / weights.sum();
    cv::Mat result(static_cast<int>(weights.rows()), static_cast<int>(weights.cols()), CV_32FC1);
    for (int row = 0; row < result.rows; ++row)
        for (int column = 0; column < result.cols; ++column)
            result.at<float>(row, column) = static_cast<float>(weights(row, column) * scale);
    return result;
}

// The mean over the rings misses a little of the rings' energy where the tail begins: made up by
// the factor.
cv::Mat WaveFilter::tail(double blur_radius_px, const cv::Size& half) const {
    const double begin = blur_radius_px + fall_from * ring_px_;
    const auto density = [&](double r) {
        return r <= begin ? 0.0
                          : wave_ring_average_density(lambda_n_px_, blur_radius_px, r) *
                                (1.0 - window(blur_radius_px, r));
    };
    const double end = blur_radius_px + fall_to * ring_px_;
    constexpr int rings = 2000;
    double energy = 2.0 * lambda_n_px_ * end /
                    (pi * pi * (end * end - blur_radius_px * blur_radius_px));  // beyond `end`
    for (int i = 0; i < rings; ++i) {
        const double r = begin + (end - begin) * (i + 0.5) / rings;
        energy += density(r) * 2.0 * pi * r * (end - begin) / rings;
    }
    const WavePointSpread psf(lambda_n_px_, blur_radius_px);
    const double factor = (1.0 - core_energy(psf)) / energy * pitch_y_;
    cv::Mat kernel(2 * half.height + 1, 2 * half.width + 1, CV_32FC1);
    for (int y = -half.height; y <= half.height; ++y)
        for (int x = -half.width; x <= half.width; ++x)
            kernel.at<float>(y + half.height, x + half.width) =
                static_cast<float>(factor * density(std::hypot(x, y * pitch_y_)));
    return kernel;
}

}  // namespace etalon
