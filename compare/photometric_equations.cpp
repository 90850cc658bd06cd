#include "compare/photometric_equations.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "compare/compared_area.h"
#include "compare/pixel_difference.h"
#include "core/errors.h"
#include "sim/sensor_model.h"

namespace etalon {
namespace {

constexpr double huber_threshold = 3.0;

// The region with these pixels and what is blurred into them.
cv::Rect rendered_region(const cv::Mat& pixels) {
    constexpr int room = 16;  // five times max_psf_sigma_px, and one
    cv::Rect region = cv::boundingRect(pixels);
    region -= cv::Point(room, room);
    region += cv::Size(2 * room, 2 * room);
    return region & cv::Rect({0, 0}, pixels.size());
}

void require_usable(const PhotoOfMarker& photo, const PhotometricCamera& camera) {
    const cv::Size size(camera.model().width, camera.model().height);
    if (photo.gray.type() != CV_32FC1 || photo.use.type() != CV_8UC1 || photo.gray.size() != size ||
        photo.use.size() != size)
        throw NumericalError(
            fmt::format("photograph {} x {} and mask {} x {} px do not fit the camera's {} x {}",
                        photo.gray.cols, photo.gray.rows, photo.use.cols, photo.use.rows,
                        size.width, size.height));
}

Scene scene_of(const PhotoOfMarker& photo, const Rigid& camera_from_marker) {
    return {{{photo.grid, camera_from_marker}}, photo.background};
}

// The rendering behind the model's Gaussian, within a region.
struct BlurredRendering {
    cv::Mat radiance, by_x, by_y;
    // By the Gaussian's variance: the discrete kernel of blurred() solves the diffusion equation
    // with second differences along x and along y exactly.
    cv::Mat by_variance;

    BlurredRendering(const RenderedGradient& rendered, double sigma_px)
        : radiance(blurred(rendered.radiance, sigma_px)),
          by_x(blurred(rendered.by_x, sigma_px)),
          by_y(blurred(rendered.by_y, sigma_px)) {
        const cv::Matx33d laplacian(0, 0.5, 0, 0.5, -2, 0.5, 0, 0.5, 0);
        cv::filter2D(radiance, by_variance, -1, laplacian, {-1, -1}, 0, cv::BORDER_REPLICATE);
    }
};

// What the camera's curve makes of a radiance, and its slope there.
struct CurvePoint {
    double value, slope;
};

CurvePoint on_curve(const Transfer& transfer, double radiance) {
    if (transfer.kind == Transfer::Kind::linear)
        return {radiance, 1.0};
    constexpr double step = 1e-4;
    return {encode(transfer, radiance),
            (encode(transfer, radiance + step) - encode(transfer, radiance - step)) / (2 * step)};
}

// One pixel's prediction with its derivatives by the photometric parameters and by the radiance.
struct PixelModel {
    double gray = 0.0;
    double by_radiance = 0.0;

    PixelModel(const PhotometricModel& model, const PhotometricTerms& terms,
               const Vector6d& level_terms, const CurvePoint& curve, double by_variance,
               Eigen::Ref<Eigen::VectorXd> derivatives) {
        const double black = model.black.dot(level_terms), white = model.white.dot(level_terms);
        const double s = curve.value, toned = s * (1.0 + model.tone * (1.0 - s));
        gray = black + (white - black) * toned;
        by_radiance = (white - black) * (1.0 + model.tone * (1.0 - 2.0 * s)) * curve.slope;
        const int n = terms.level_terms;
        derivatives.head(n) = (1.0 - toned) * level_terms.head(n);
        derivatives.segment(n, n) = toned * level_terms.head(n);
        int next = 2 * n;
        if (terms.psf)
            derivatives[next++] = by_radiance * by_variance;
        if (terms.tone)
            derivatives[next] = (white - black) * s * (1.0 - s);
    }
};

double huber_loss(double size) {
    return size <= huber_threshold ? 0.5 * size * size
                                   : huber_threshold * (size - 0.5 * huber_threshold);
}

// Adds rows to normal equations, many at a time. The information is Newton's: Huber's loss is
// straight beyond its threshold and has no curvature there.
class RowSum {
public:
    RowSum(int columns, PhotoEquations& equations)
        : equations_(equations), rows_(columns, rows_at_a_time), residuals_(rows_at_a_time) {
        equations_.information = Eigen::MatrixXd::Zero(columns, columns);
        equations_.score = Eigen::VectorXd::Zero(columns);
    }

    void add(const Eigen::VectorXd& row, double residual) {
        const double limited = std::clamp(residual, -huber_threshold, huber_threshold);
        equations_.loss += huber_loss(std::abs(residual));
        equations_.squares += limited * limited;
        ++equations_.pixels;
        if (limited != residual) {
            equations_.score += limited * row;
            return;
        }
        rows_.col(count_) = row;
        residuals_[count_] = residual;
        if (++count_ == rows_at_a_time)
            flush();
    }

    void flush() {
        const auto rows = rows_.leftCols(count_);
        equations_.information.selfadjointView<Eigen::Lower>().rankUpdate(rows);
        equations_.score += rows * residuals_.head(count_);
        count_ = 0;
    }

    void finish() {
        flush();
        equations_.information =
            Eigen::MatrixXd(equations_.information.selfadjointView<Eigen::Lower>());
    }

private:
    static constexpr int rows_at_a_time = 256;

    PhotoEquations& equations_;
    Eigen::MatrixXd rows_;  // one column per pixel
    Eigen::VectorXd residuals_;
    int count_ = 0;
};

// A pose that is held is no unknown, nor is a parameter that stands at the end of its range and
// would leave it.
void hold_what_is_fixed(const PhotometricModel& model, const PhotometricTerms& terms,
                        PhotoEquations& equations) {
    const auto fix = [&](Eigen::Index at) {
        equations.score[at] = 0.0;
        equations.information.row(at).setZero();
        equations.information.col(at).setZero();
        equations.information(at, at) = 1.0;
    };
    const auto hold = [&](Eigen::Index at, double value, double low, double high) {
        const double score = equations.score[at];
        if ((value <= low && score < 0) || (value >= high && score > 0))
            fix(at);
    };
    if (!terms.pose)
        for (Eigen::Index i = 0; i < 6; ++i)
            fix(equations.score.size() - terms.count() - 6 + i);
    Eigen::Index next = equations.score.size() - (terms.psf ? 1 : 0) - (terms.tone ? 1 : 0);
    if (terms.psf)
        hold(next++, model.psf_sigma_px, 0.0, max_psf_sigma_px);
    if (terms.tone)
        hold(next, model.tone, -1.0, 1.0);
}

double median(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

}  // namespace

PhotometricCamera::PhotometricCamera(const CameraModel& camera)
    : projector_(camera), renderer_(camera), response_(SensorModel(camera).relative_response()) {
    if (!camera.sensor || !etalon::noise_gray(*camera.sensor, 0.0))
        return;
    for (int gray = 0; gray <= 255; ++gray)
        noise_.push_back(*etalon::noise_gray(*camera.sensor, gray));
}

double PhotometricCamera::noise_gray(double gray) const {
    if (noise_.empty())
        return 1.0;
    const double place = std::clamp(gray, 0.0, 255.0);
    const auto below = std::min<std::size_t>(static_cast<std::size_t>(place), 254);
    return std::lerp(noise_[below], noise_[below + 1], place - static_cast<double>(below));
}

RenderedGradient PhotometricCamera::at_sensor(const Scene& scene, const cv::Rect& region) const {
    RenderOptions options;
    options.region = region;
    RenderedGradient rendered = renderer_.render(scene, options);
    for (cv::Mat* image : {&rendered.radiance, &rendered.by_x, &rendered.by_y})
        *image =
            response_.empty() ? (*image)(region) : cv::Mat((*image)(region).mul(response_(region)));
    return rendered;
}

PhotoEquations photo_equations(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                               const PhotoState& state, const PhotometricTerms& terms,
                               const CalibrationModel& parameters, double noise_scale) {
    constexpr int least_pixels = 50;
    constexpr double flat = 1e-5;  // of full scale per px: nothing moves there
    require_usable(photo, camera);
    const cv::Rect region = rendered_region(photo.use == photo.fitted);
    if (cv::countNonZero(photo.use == photo.fitted) < least_pixels)
        throw NumericalError(
            fmt::format("fewer than {} pixels of the marker can be fitted", least_pixels));
    const BlurredRendering seen(camera.at_sensor(scene_of(photo, state.camera_from_marker), region),
                                state.photometry.psf_sigma_px);
    const ImageMotion motion(camera.projector(), state.camera_from_marker, parameters, region);
    const Transfer transfer = camera.transfer();

    PhotoEquations equations;
    const int geometric = motion.columns();
    Eigen::VectorXd row(geometric + terms.count());
    Eigen::Matrix2Xd moved(2, geometric);
    RowSum sum(static_cast<int>(row.size()), equations);
    std::vector<double> sizes;
    for (int y = 0; y < region.height; ++y)
        for (int x = 0; x < region.width; ++x) {
            const cv::Point pixel = region.tl() + cv::Point(x, y);
            if (photo.use.at<uchar>(pixel) != photo.fitted)
                continue;
            const PixelModel model(state.photometry, terms,
                                   level_terms(pixel.x, pixel.y, photo.use.size()),
                                   on_curve(transfer, seen.radiance.at<float>(y, x)),
                                   seen.by_variance.at<float>(y, x), row.tail(terms.count()));
            const Eigen::RowVector2d slope(seen.by_x.at<float>(y, x), seen.by_y.at<float>(y, x));
            if (slope.lpNorm<1>() < flat)
                row.head(geometric).setZero();
            else if (motion.at(pixel.x, pixel.y, moved))
                row.head(geometric) = -model.by_radiance * (slope * moved).transpose();
            else
                continue;
            const double noise = noise_scale * camera.noise_gray(model.gray);
            const double residual = (photo.gray.at<float>(pixel) - model.gray) / noise;
            sizes.push_back(std::abs(residual));
            sum.add(row / noise, residual);
        }
    sum.finish();
    hold_what_is_fixed(state.photometry, terms, equations);
    if (equations.pixels < least_pixels || !std::isfinite(equations.loss))
        throw NumericalError(fmt::format("{} pixels of the marker can be fitted, with a loss of {}",
                                         equations.pixels, equations.loss));
    equations.median_size = median(std::move(sizes));
    return equations;
}

cv::Mat predicted_at(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                     const PhotoState& state) {
    require_usable(photo, camera);
    const cv::Rect region = rendered_region(photo.use != pixel_outside);
    Radiance lit(photo.gray.size(), CV_32FC1, cv::Scalar(0));
    camera.at_sensor(scene_of(photo, state.camera_from_marker), region)
        .radiance.copyTo(lit(region));
    return predicted_gray(state.photometry, lit, camera.transfer());
}

double residual_rms_gray(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                         const PhotoState& state) {
    const cv::Mat counted = photo.use == photo.fitted;
    return cv::norm(photo.gray, predicted_at(photo, camera, state), cv::NORM_L2, counted) /
           std::sqrt(cv::countNonZero(counted));
}

PhotoState stepped(const PhotoState& state, const PhotometricTerms& terms,
                   const Eigen::VectorXd& step) {
    PhotoState next = state;
    next.camera_from_marker = left_perturbed(state.camera_from_marker, Vector6d(step.head<6>()));
    const int n = terms.level_terms;
    next.photometry.black.head(n) += step.segment(6, n);
    next.photometry.white.head(n) += step.segment(6 + n, n);
    int at = 6 + 2 * n;
    if (terms.psf) {
        const double variance = state.photometry.psf_sigma_px * state.photometry.psf_sigma_px;
        next.photometry.psf_sigma_px =
            std::sqrt(std::clamp(variance + step[at++], 0.0, max_psf_sigma_px * max_psf_sigma_px));
    }
    if (terms.tone)
        next.photometry.tone = std::clamp(state.photometry.tone + step[at], -1.0, 1.0);
    return next;
}

PhotoState starting_state(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                          const Rigid& camera_from_marker, const PhotometricTerms& terms) {
    constexpr double typical_sigma_px = 0.75;
    require_usable(photo, camera);
    const cv::Rect region = rendered_region(photo.use == photo.fitted);
    const Radiance radiance =
        camera.at_sensor(scene_of(photo, camera_from_marker), region).radiance;
    const cv::Mat used = photo.use(region) == photo.fitted;
    const cv::Mat dark = (radiance < 0.25) & used, light = (radiance > 0.5) & used;
    if (cv::countNonZero(dark) == 0 || cv::countNonZero(light) == 0)
        throw NumericalError("the marker shows no dark or no light pixels at this pose");
    PhotoState state{camera_from_marker, {}};
    state.photometry.black[0] = cv::mean(photo.gray(region), dark)[0];
    state.photometry.white[0] = cv::mean(photo.gray(region), light)[0];
    state.photometry.psf_sigma_px = terms.psf ? typical_sigma_px : 0.0;
    return state;
}

}  // namespace etalon
