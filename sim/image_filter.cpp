#include "sim/image_filter.h"

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <numbers>
#include <opencv2/core.hpp>

#include "core/errors.h"

namespace etalon {
namespace {

using Response = std::function<double(double)>;

double smooth_step(double t) {
    t = std::clamp(t, 0.0, 1.0);
    return t * t * t * (10.0 + t * (6.0 * t - 15.0));
}

// The 6-point Lagrange kernel: weight of a sample at distance t (in sample steps) in the quintic
// interpolant. Symmetric, 1 at 0, 0 at all other integers and beyond 3.
double lagrange6(double t) {
    t = std::abs(t);
    if (t < 1.0)
        return (1 - t * t) * (4 - t * t) * (3 - t) / 12;
    if (t < 2.0)
        return (t * t - 1) * (t - 2) * (3 - t) * (4 - t) / 24;
    if (t < 3.0)
        return (t - 1) * (t - 2) * (3 - t) * (4 - t) * (5 - t) / 120;
    return 0.0;
}

// Integral of lagrange6 from a to b: 3-point Gauss is exact for its quintic pieces.
double lagrange6_integral(double a, double b) {
    a = std::clamp(a, -3.0, 3.0);
    b = std::clamp(b, -3.0, 3.0);
    double sum = 0.0;
    for (double from = a; from < b;) {
        const double to = std::min(b, std::floor(from) + 1.0);
        const double centre = 0.5 * (from + to), half = 0.5 * (to - from);
        const double node = half * std::sqrt(0.6);
        sum += half / 9.0 *
               (5.0 * lagrange6(centre - node) + 8.0 * lagrange6(centre) +
                5.0 * lagrange6(centre + node));
        from = to;
    }
    return sum;
}

// What a sample at 0 contributes to a pixel box centred at x, in the interpolant of the samples.
Response pixel_response(int k, SampleKind kind) {
    if (kind == SampleKind::point)
        return [k](double x) { return lagrange6_integral(k * (x - 0.5), k * (x + 0.5)) / k; };
    // The pixel's average is the mean of k box averages, each interpolated between the boxes.
    return [k](double x) {
        double sum = 0.0;
        for (int i = 0; i < k; ++i)
            sum += lagrange6(k * x - (i - (k - 1) * 0.5));
        return sum / k;
    };
}

// Equally spaced samples along one axis, symmetric about the output pixel; lengths in that axis'
// pixels.
struct SampleAxis {
    int count;
    double step;

    double position(int i) const { return (i - 0.5 * (count - 1)) * step; }
};

// Fine midpoint nodes from -half to half, and each sample's response there.
struct FineAxis {
    Eigen::VectorXd position;  // in units of the pixel pitch along x
    Eigen::MatrixXd response;  // fine nodes x samples
    double step;
};

FineAxis fine_axis(double half, double step, double pitch, const SampleAxis& samples,
                   const Response& response) {
    const int n = 2 * static_cast<int>(std::ceil(half / step));
    FineAxis axis{Eigen::VectorXd(n), Eigen::MatrixXd(n, samples.count), step};
    for (int i = 0; i < n; ++i) {
        axis.position[i] = (i + 0.5 - 0.5 * n) * step;
        for (int j = 0; j < samples.count; ++j)
            axis.response(i, j) = response(axis.position[i] / pitch - samples.position(j));
    }
    return axis;
}

// weights(j, i) = integral of density(r) response_x(x - x_i) response_y(y - y_j) over the plane.
// The density is a function of the radius; a quarter of its values gives all of them.
Eigen::MatrixXd product_weights(const Response& density, const FineAxis& x, const FineAxis& y) {
    const auto nx = x.position.size(), ny = y.position.size();
    Eigen::MatrixXd values(ny, nx);
    for (Eigen::Index j = 0; j < ny / 2; ++j)
        for (Eigen::Index i = 0; i < nx / 2; ++i) {
            const double value = density(std::hypot(x.position[i], y.position[j]));
            values(j, i) = values(ny - 1 - j, i) = values(j, nx - 1 - i) =
                values(ny - 1 - j, nx - 1 - i) = value;
        }
    return y.response.transpose() * (values * x.response) * (x.step * y.step);
}

// Energy that the window lets through: the integral of window(r) dE(r), summed over rings so thin
// that the window hardly changes across one; E is known in closed form.
double windowed_energy(const PointSpreadFunction& psf, const RadialWindow& window) {
    constexpr int rings = 20000;
    double sum = 0.0, within = 0.0;
    for (int i = 1; i <= rings; ++i) {
        const double next = psf.energy_within(window.fall_to * i / rings);
        sum += window(window.fall_to * (i - 0.5) / rings) * (next - within);
        within = next;
    }
    return sum;
}

cv::Mat to_float(const Eigen::MatrixXd& m, double scale) {
    cv::Mat result(static_cast<int>(m.rows()), static_cast<int>(m.cols()), CV_32FC1);
    for (int j = 0; j < result.rows; ++j)
        for (int i = 0; i < result.cols; ++i)
            result.at<float>(j, i) = static_cast<float>(m(j, i) * scale);
    return result;
}

}  // namespace

double RadialWindow::operator()(double r) const {
    const double rise = rise_to > 0.0 ? smooth_step((r - rise_from) / (rise_to - rise_from)) : 1.0;
    return rise * (1.0 - smooth_step((r - fall_from) / (fall_to - fall_from)));
}

// Where the levels meet. The core must hold the rings that a 1-px grid cannot follow, so it grows
// with lambda N; beyond 6 px the pattern is smooth from pixel to pixel and needs no core.
ImageFilter::ImageFilter(const CameraModel& camera) {
    if (!camera.lens)
        return;
    psf_ = PointSpreadFunction::of(camera);
    pitch_y_ = camera.intrinsics.fx / camera.intrinsics.fy;
    const double scale = psf_->scale_px();
    if (!psf_->is_airy()) {  // no tail: a Gaussian holds 1e-8 beyond 6 sigma
        const RadialWindow whole{-1, -1, 6.0 * scale, 6.5 * scale};
        (scale < 4.0 ? core_ : near_) = whole;
        return;
    }
    const double split = std::max(1.0, 2.0 * scale);
    const double far = 24.0 * std::max(1.0, 0.5 * scale);
    near_ = RadialWindow{-1, -1, far, 2.0 * far};
    far_ = RadialWindow{far, 2.0 * far, 1e300, 2e300};
    if (scale > 6.0)
        return;
    core_ = RadialWindow{-1, -1, 1.5 * split, 3.0 * split};
    near_->rise_from = 1.5 * split;
    near_->rise_to = 3.0 * split;
}

int ImageFilter::near_reach_px() const {
    if (!near_)
        return 0;
    return static_cast<int>(std::ceil(near_->fall_to / std::min(1.0, pitch_y_))) + 3;
}

int ImageFilter::reach_px() const {
    const double core = core_ ? core_->fall_to / std::min(1.0, pitch_y_) + 5.0 : 0.0;
    return std::max(near_reach_px(), static_cast<int>(std::ceil(core)));
}

const CoreKernel& ImageFilter::core(int k, SampleKind kind) const {
    const std::lock_guard lock(mutex_);
    auto& slot = cores_[{k, kind}];
    if (slot)
        return *slot;
    CoreKernel kernel{k, 0, 0, {}};
    if (!core_) {  // the box alone, or nothing at all when the near tail has everything
        const float weight = psf_ ? 0.0f : 1.0f / static_cast<float>(k * k);
        kernel.weights = cv::Mat(k, k, CV_32FC1, cv::Scalar(weight));
    } else {
        const double radius = core_->fall_to;
        kernel.reach_x = static_cast<int>(std::ceil((radius + 0.5) * k)) + 3;
        kernel.reach_y = static_cast<int>(std::ceil((radius / pitch_y_ + 0.5) * k)) + 3;
        const Response response = pixel_response(k, kind);
        // A pattern too narrow to be resolved may shrink into its central four nodes.
        const double step =
            std::min(std::max(psf_->scale_px() / 8.0, 1.0 / 256.0), 1.0 / (8.0 * k));
        const FineAxis x =
            fine_axis(radius, step, 1.0, {2 * kernel.reach_x + k, 1.0 / k}, response);
        const FineAxis y =
            fine_axis(radius, step, pitch_y_, {2 * kernel.reach_y + k, 1.0 / k}, response);
        const Eigen::MatrixXd weights =
            product_weights([&](double r) { return psf_->density(r) * (*core_)(r); }, x, y);
        const double energy = windowed_energy(*psf_, *core_);
        kernel.weights = to_float(weights, energy / weights.sum());
    }
    slot = std::make_unique<const CoreKernel>(std::move(kernel));
    return *slot;
}

// The rings near the core are integrated as they are; farther out, where many of them fall into a
// pixel, by their average.
const cv::Mat& ImageFilter::near_kernel() const {
    const std::lock_guard lock(mutex_);
    if (!near_kernel_.empty())
        return near_kernel_;
    const double radius = near_->fall_to, scale = psf_->scale_px();
    const bool average_rings = psf_->is_airy() && scale < 1.0;
    const double exact_radius = average_rings ? 4.0 * near_->rise_to : radius;
    const RadialWindow inner{-1, -1, 0.5 * exact_radius, exact_radius};
    const auto share = [&](double r) { return average_rings ? inner(r) : 1.0; };
    const SampleAxis columns{2 * (static_cast<int>(std::ceil(radius)) + 3) + 1, 1.0};
    const SampleAxis rows{2 * (static_cast<int>(std::ceil(radius / pitch_y_)) + 3) + 1, 1.0};
    const auto weights = [&](double reach, double step, const Response& density) {
        return product_weights(density, fine_axis(reach, step, 1.0, columns, lagrange6),
                               fine_axis(reach, step, pitch_y_, rows, lagrange6));
    };
    Eigen::MatrixXd sum =
        weights(exact_radius, std::clamp(scale / 12.0, 1.0 / 32.0, 0.5),
                [&](double r) { return psf_->density(r) * (*near_)(r)*share(r); });
    if (average_rings)
        sum += weights(radius, 0.25, [&](double r) {
            return (1.0 - share(r)) == 0.0
                       ? 0.0
                       : psf_->ring_average_density(r) * (*near_)(r) * (1.0 - share(r));
        });
    const double energy = windowed_energy(*psf_, *near_);
    near_kernel_ = to_float(sum, energy / sum.sum());
    return near_kernel_;
}

// Blocks are small against the radii here: the kernel is averaged over 4 x 4 points of each.
cv::Mat ImageFilter::far_kernel(double reach_px) const {
    const int half_x = static_cast<int>(std::ceil(reach_px / block_px));
    const int half_y = static_cast<int>(std::ceil(reach_px / pitch_y_ / block_px));
    cv::Mat kernel(2 * half_y + 1, 2 * half_x + 1, CV_32FC1);
    const auto block_energy = [&](int i, int j) {
        double sum = 0.0;
        for (int q = 0; q < 16; ++q) {
            const double x = (i + (q % 4 - 1.5) / 4.0) * block_px;
            const double y = (j + (q / 4 - 1.5) / 4.0) * block_px * pitch_y_;
            const double r = std::hypot(x, y);
            if (r > far_->rise_from && r <= reach_px)
                sum += psf_->ring_average_density(r) * (*far_)(r);
        }
        return sum / 16.0 * block_px * block_px * pitch_y_;
    };
    for (int j = 0; j <= half_y; ++j)
        for (int i = 0; i <= half_x; ++i) {
            const auto energy = static_cast<float>(block_energy(i, j));
            for (const auto& [x, y] : {std::pair{i, j}, {-i, j}, {i, -j}, {-i, -j}})
                kernel.at<float>(half_y + y, half_x + x) = energy;
        }
    return kernel;
}

cv::Mat convolve(const cv::Mat& image, const cv::Mat& kernel) {
    const cv::Size size(cv::getOptimalDFTSize(image.cols + kernel.cols - 1),
                        cv::getOptimalDFTSize(image.rows + kernel.rows - 1));
    cv::Mat a = cv::Mat::zeros(size, CV_32FC1), b = cv::Mat::zeros(size, CV_32FC1);
    image.copyTo(a(cv::Rect({0, 0}, image.size())));
    kernel.copyTo(b(cv::Rect({0, 0}, kernel.size())));
    cv::dft(a, a, 0, image.rows);
    cv::dft(b, b, 0, kernel.rows);
    cv::mulSpectrums(a, b, a, 0);
    cv::dft(a, a, cv::DFT_INVERSE | cv::DFT_SCALE, kernel.rows / 2 + image.rows);
    return a(cv::Rect({kernel.cols / 2, kernel.rows / 2}, image.size())).clone();
}

}  // namespace etalon
