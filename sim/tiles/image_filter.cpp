#include "sim/tiles/image_filter.h"

#include <fmt/format.h>

#include <Eigen/SparseCore>
#include <cmath>
#include <opencv2/core/eigen.hpp>

#include "core/program/errors.h"

namespace etalon {
namespace {

using Response = std::function<double(double)>;

double smooth_step(double t) {
    t = std::clamp(t, 0.0, 1.0);
    return t * t * t * (10.0 + t * (6.0 * t - 15.0));
}

// What a sample at 0 contributes to a pixel box centred at x, in the interpolant of the samples.
Response pixel_response(int k, SampleKind kind) {
    if (kind != SampleKind::box)
        return [k](double x) { return lagrange6_integral(k * (x - 0.5), k * (x + 0.5)) / k; };
    // The pixel's average is the mean of k box averages, each interpolated between the boxes.
    return [k](double x) {
        double sum = 0.0;
        for (int i = 0; i < k; ++i)
            sum += lagrange6(k * x - (i - (k - 1) * 0.5));
        return sum / k;
    };
}

// What an average over g px contributes to a pixel box centred at x: the interpolant, less the
// second moment that the wider box has put into it.
Response square_response(double g) {
    const double a = (1.0 - 1.0 / (g * g)) / 24.0;
    return [g, a](double x) {
        const double t = x / g;
        return (1.0 + 2.0 * a) * lagrange6(t) - a * (lagrange6(t - 1.0) + lagrange6(t + 1.0));
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
    constexpr double table_steps = 8.0;  // a fine node: 3e-7 of an Airy pattern's ring
    const auto nx = x.position.size(), ny = y.position.size();
    const double step = x.step / table_steps, end = std::hypot(x.position[0], y.position[0]);
    std::vector<double> table;  // from -1 step on, joined by cubics
    for (int i = -1; i < std::ceil(end / step) + 3.0; ++i)
        table.push_back(density(std::abs(i * step)));
    const auto tabulated = [&](double r) {
        const double place = r / step, whole = std::floor(place), t = place - whole;
        const double* v = &table[static_cast<std::size_t>(whole)];
        const double bend =
            (v[0] - 2.0 * v[1] + v[2]) * (2.0 - t) + (v[1] - 2.0 * v[2] + v[3]) * (1.0 + t);
        return v[1] + t * (v[2] - v[1]) - t * (1.0 - t) / 6.0 * bend;
    };
    Eigen::MatrixXd values(ny, nx);
    for (Eigen::Index j = 0; j < ny / 2; ++j)
        for (Eigen::Index i = 0; i < nx / 2; ++i) {
            const double value = tabulated(std::hypot(x.position[i], y.position[j]));
            values(j, i) = values(ny - 1 - j, i) = values(j, nx - 1 - i) =
                values(ny - 1 - j, nx - 1 - i) = value;
        }
    // Each node responds to a few samples only.
    const Eigen::SparseMatrix<double> to_columns = x.response.sparseView();
    const Eigen::SparseMatrix<double> to_rows = y.response.transpose().sparseView();
    const Eigen::MatrixXd by_column = values * to_columns;
    return to_rows * by_column * (x.step * y.step);
}

// The weights where all energy stays in the middle; they add up to 1.
Eigen::MatrixXd unspread_weights(const SampleAxis& columns, const SampleAxis& rows,
                                 const Response& response) {
    Eigen::VectorXd x(columns.count), y(rows.count);
    for (int i = 0; i < columns.count; ++i)
        x[i] = response(-columns.position(i));
    for (int j = 0; j < rows.count; ++j)
        y[j] = response(-rows.position(j));
    return y * x.transpose();
}

// The mean of E over a smooth step from a to b, by its slope 30 t^2 (1 - t)^2. E oscillates with
// half of lambda N.
double mean_energy(const PointSpreadFunction& psf, double a, double b) {
    constexpr double least = 512.0, most = 2048.0, nodes_per_period = 16.0;
    const auto n =
        static_cast<int>(std::clamp(nodes_per_period * (b - a) / psf.scale_px(), least, most));
    double sum = 0.0;
    for (int i = 0; i < n; ++i) {
        const double t = (i + 0.5) / n;
        sum += 30.0 * t * t * (1.0 - t) * (1.0 - t) * psf.energy_within(a + t * (b - a));
    }
    return sum / n;
}

// Energy that the window lets through, the integral of window(r) dE(r), by parts.
double windowed_energy(const PointSpreadFunction& psf, const RadialWindow& window) {
    const double up_to = mean_energy(psf, window.fall_from, window.fall_to);
    return window.rise_to > 0.0 ? up_to - mean_energy(psf, window.rise_from, window.rise_to)
                                : up_to;
}

// Without the outermost rows and columns that together hold no more than this part.
Eigen::MatrixXd trimmed(const Eigen::MatrixXd& weights, double part) {
    const double allowed = part * weights.cwiseAbs().sum();
    const auto inner = [&](Eigen::Index x, Eigen::Index y) {
        return weights.block(y, x, weights.rows() - 2 * y, weights.cols() - 2 * x);
    };
    const auto lost = [&](Eigen::Index x, Eigen::Index y) {
        return weights.cwiseAbs().sum() - inner(x, y).cwiseAbs().sum();
    };
    Eigen::Index x = 0, y = 0;
    while (lost(x + 1, 0) < 0.5 * allowed)
        ++x;
    while (lost(x, y + 1) < allowed)
        ++y;
    return inner(x, y);
}

FilterKernel scaled_kernel(int k, const Eigen::MatrixXd& weights, double energy) {
    const double scale = energy / weights.sum();
    cv::Mat result;
    cv::eigen2cv(Eigen::MatrixXd(weights * scale), result);
    return FilterKernel(k, result);
}

}  // namespace

double RadialWindow::operator()(double r) const {
    const double rise = rise_to > 0.0 ? smooth_step((r - rise_from) / (rise_to - rise_from)) : 1.0;
    return rise * (1.0 - smooth_step((r - fall_from) / (fall_to - fall_from)));
}

// Where the levels meet. The core must hold the rings that the tail's grids cannot follow. The
// factors keep the error beside the edge of a half-plane below 0.02 gray.
ImageFilter::ImageFilter(const CameraModel& camera) {
    if (!camera.lens)
        return;
    psf_ = PointSpreadFunction::of(camera);
    pitch_y_ = camera.intrinsics.fx / camera.intrinsics.fy;
    if (psf_->is_airy()) {
        const double grid = 1.1 * std::max(1.0, pitch_y_);
        split_px_ = std::max(grid, 2.2 * psf_->scale_px());
        first_shift_ = std::ilogb(split_px_ / grid);
        core_ = {-1, -1, 1.5 * split_px_, 3.0 * split_px_};
    } else {
        const double radius = psf_->radius_of_tail(2e-8);
        core_ = {-1, -1, radius, 1.08 * radius};
    }
}

int ImageFilter::reach_px() const {
    if (!psf_)
        return 0;
    const double radius = has_tail() && first_shift_ == 0 ? 6.0 * split_px_ : core_.fall_to;
    return static_cast<int>(std::ceil(radius / std::min(1.0, pitch_y_))) + 5;
}

const DeconvolvedPsf* ImageFilter::sharpened() const {
    const std::optional<DeconvolvedPsf>& made = sharpened_.get(
        [this] { return psf_ ? DeconvolvedPsf::of(*psf_, core_, core_.fall_to) : std::nullopt; });
    return made ? &*made : nullptr;
}

bool ImageFilter::has_square_pixels() const {
    constexpr double oblong = 0.005;
    return std::abs(pitch_y_ - 1.0) < oblong;
}

const EdgeTable* ImageFilter::edges() const {
    constexpr double wide_px = 8.0;
    const auto make = [this]() -> std::unique_ptr<const EdgeTable> {
        if (!has_tail() || !has_square_pixels() || core_.fall_to >= wide_px)
            return nullptr;
        return std::make_unique<EdgeTable>([this](double r) { return core_(r) * psf_->density(r); },
                                           core_.fall_to, windowed_energy(*psf_, core_));
    };
    return edges_.get(make).get();
}

const WedgeTable* ImageFilter::wedges() const {
    const auto make = [this]() -> std::unique_ptr<const WedgeTable> {
        const double reach = core_.fall_to;
        if (!psf_ || !has_square_pixels() || !WedgeTable::suits(*psf_, reach))
            return nullptr;
        return std::make_unique<WedgeTable>(
            radial_transfer(*psf_, core_, reach, WedgeTable::end_px(reach)), reach);
    };
    return wedges_.get(make).get();
}

// Renders that need another kernel do not wait while one is made.
const Lazy<FilterKernel>& ImageFilter::slot(Kernels& kernels, std::pair<int, int> key) const {
    const std::lock_guard lock(mutex_);
    return kernels[key];
}

const FilterKernel& ImageFilter::core(int k, SampleKind kind) const {
    return slot(cores_, {k, static_cast<int>(kind)}).get([&] { return make_core(k, kind); });
}

const FilterKernel& ImageFilter::ring(int shift, bool and_finer) const {
    return slot(rings_, {shift, and_finer}).get([&] { return make_ring(shift, and_finer); });
}

FilterKernel ImageFilter::make_core(int k, SampleKind kind) const {
    if (!psf_ && kind == SampleKind::box)  // the pixel's boxes alone
        return scaled_kernel(k, Eigen::MatrixXd::Ones(k, k), 1.0);
    if (!psf_) {
        const SampleAxis samples{k + 6, 1.0 / k};
        return scaled_kernel(k, unspread_weights(samples, samples, pixel_response(k, kind)), 1.0);
    }
    if (kind == SampleKind::pixel)
        return scaled_kernel(1, Eigen::MatrixXd::Ones(1, 1), windowed_energy(*psf_, core_));
    const double radius = kind == SampleKind::disk ? sharpened()->reach_px() : core_.fall_to;
    const int reach_x = static_cast<int>(std::ceil((radius + 0.5) * k)) + 3;
    const int reach_y = static_cast<int>(std::ceil((radius / pitch_y_ + 0.5) * k)) + 3;
    const Response response = pixel_response(k, kind);
    const double step = std::min(std::max(psf_->scale_px() / 8.0, 1.0 / 256.0), 1.0 / (8.0 * k));
    const SampleAxis columns{2 * reach_x + k, 1.0 / k}, rows{2 * reach_y + k, 1.0 / k};
    constexpr double most_responses = 6e7;  // half a gigabyte, some minutes
    if (!(2.0 * radius / step * std::max(columns.count, rows.count) <= most_responses))
        throw NumericalError(fmt::format(
            "the point spread is too wide to be filtered at {} samples a pixel side", k));
    const FineAxis x = fine_axis(radius, step, 1.0, columns, response);
    const FineAxis y = fine_axis(radius, step, pitch_y_, rows, response);
    const double energy = windowed_energy(*psf_, core_);
    // Of a pattern too narrow for the nodes only the outskirts are spread out; the rest stays put.
    const bool narrow = psf_->is_airy() && step > 0.2 * psf_->scale_px();
    const auto density = [&](double r) {
        if (kind == SampleKind::disk)
            return sharpened()->density(r);
        if (narrow)
            return r > 4.0 * step ? psf_->ring_average_density(r) * core_(r) : 0.0;
        return psf_->density(r) * core_(r);
    };
    Eigen::MatrixXd weights = product_weights(density, x, y);
    if (narrow && kind != SampleKind::disk)
        weights += (energy - weights.sum()) * unspread_weights(columns, rows, response);
    return scaled_kernel(k, trimmed(weights, 1e-5), energy);
}

// The first ring is integrated as it is, unless many of the pattern's rings fall into a pixel;
// farther out their average stands for them.
FilterKernel ImageFilter::make_ring(int shift, bool and_finer) const {
    const double outer = radius_held(shift), inner = and_finer ? radius_held(first_shift_) : outer;
    const double g = std::ldexp(1.0, shift);
    const RadialWindow window{inner, 2.0 * inner, 2.0 * outer, 4.0 * outer};
    const bool average = shift > first_shift_ || psf_->scale_px() < 0.15;
    const double step = average ? g / 8.0 : psf_->scale_px() / 8.0;
    const Response response = square_response(g);
    const auto samples = [&](double radius) {
        return SampleAxis{2 * (static_cast<int>(std::ceil(radius / g)) + 4) + 1, g};
    };
    const FineAxis x = fine_axis(window.fall_to, step, 1.0, samples(window.fall_to), response);
    const FineAxis y =
        fine_axis(window.fall_to, step, pitch_y_, samples(window.fall_to / pitch_y_), response);
    const auto density = [&](double r) {
        const double share = window(r);
        if (share == 0.0)
            return 0.0;
        return share * (average ? psf_->ring_average_density(r) : psf_->density(r));
    };
    return scaled_kernel(1, trimmed(product_weights(density, x, y), 1e-4),
                         windowed_energy(*psf_, window));
}

// The rings' energy goes with lambda N / s, what the grid misses of an edge blurred by R >> s with
// (s / R)^2; factors above the largest difference found (tests/sim/tiles/tail_pyramid_test.cpp).
double ImageFilter::gray_of_coarser_ring(int shift, double blur_px) const {
    if (shift <= first_shift_)
        return 0.0;
    const double factor = shift == first_shift_ + 1 ? 0.37 : 2.8, relative = blur_px / split_px_;
    return factor * psf_->scale_px() / split_px_ / (relative * relative);
}

// With x = pi r / (lambda N): the energy beyond r is J0^2 + J1^2 <= 2/(pi x) (1 + 1/(2 x)), and
// J1^2 <= 2/(pi x) (1 + 3/(8 x^2)) for x >= 1.
double ImageFilter::tail_reach_px(double contrast, double area_px, double allowed_gray) const {
    if (!has_tail())
        return 0.0;
    using std::numbers::pi;
    const double scale = psf_->scale_px(), area = area_px * pitch_y_;
    const auto bound = [&](double r) {
        const double x = pi * r / scale, envelope = 2.0 / (pi * x);
        const double energy = envelope * (1.0 + 0.5 / x);
        const double density = envelope * (1.0 + 0.375 / (x * x)) / (pi * r * r);
        return 255.0 * contrast * std::min(energy, area * density);
    };
    double low = std::log(radius_held(first_shift_)), high = std::log(1e12);
    if (!(bound(std::exp(low)) > allowed_gray))
        return 0.0;
    for (int i = 0; i < 60; ++i) {
        const double middle = 0.5 * (low + high);
        (bound(std::exp(middle)) > allowed_gray ? low : high) = middle;
    }
    return std::exp(high);
}

}  // namespace etalon
