#include "compare/photometric/photometric_equations.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "calib/intrinsics/camera_fit.h"
#include "compare/photometric/photo_match.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

constexpr double huber_threshold = 3.0;
constexpr double flat = 1e-5;  // of full scale per px: nothing moves there
constexpr int min_pixels = 50, blocks_a_side = 10;

Scene scene_of(const PhotoOfMarker& photo, const Rigid& camera_from_marker) {
    return {{{photo.grid, camera_from_marker}}, photo.background};
}

// The rendering behind the model's Gaussian, within a region.
struct BlurredRendering {
    cv::Mat radiance, by_x, by_y;

    BlurredRendering(const RenderedGradient& rendered, const Eigen::Vector2d& sigmas_px)
        : radiance(behind_gaussian(rendered.radiance, sigmas_px)) {
        if (rendered.by_x.empty())
            return;
        by_x = behind_gaussian(rendered.by_x, sigmas_px);
        by_y = behind_gaussian(rendered.by_y, sigmas_px);
    }

    double at(int x, int y) const {
        return radiance.at<float>(std::clamp(y, 0, radiance.rows - 1),
                                  std::clamp(x, 0, radiance.cols - 1));
    }

    Eigen::RowVector2d slope(int x, int y) const {
        if (!by_x.empty())
            return {by_x.at<float>(y, x), by_y.at<float>(y, x)};
        return {0.5 * (at(x + 1, y) - at(x - 1, y)), 0.5 * (at(x, y + 1) - at(x, y - 1))};
    }

    // By the Gaussian's variances along x and y: the discrete kernel of blurred() solves the
    // diffusion equation with second differences exactly.
    Eigen::Vector2d by_variances(int x, int y) const {
        const auto half_second_difference = [&](int u, int v) {
            return (16.0 * (at(x - u, y - v) + at(x + u, y + v)) - 30.0 * at(x, y) -
                    at(x - 2 * u, y - 2 * v) - at(x + 2 * u, y + 2 * v)) /
                   24.0;
        };
        return {half_second_difference(1, 0), half_second_difference(0, 1)};
    }

    static cv::Mat behind_gaussian(const cv::Mat& image, const Eigen::Vector2d& sigmas_px) {
        return sigmas_px.isZero() ? image : blurred(image, sigmas_px);
    }
};

// One pixel's prediction with its derivatives by the photometric parameters and by the radiance.
struct PixelEquation {
    double gray = 0.0;
    double by_radiance = 0.0;
    bool clips = false;  // its noise is clipped too, and says little of the noise elsewhere

    PixelEquation(const PhotometricModel& model, const PhotometricTerms& terms,
                  const MeanCode& mean_code, double black, double white,
                  const Vector6d& level_terms, const LightCurve::Point& curve,
                  const Eigen::Vector2d& by_variances, double* derivatives) {
        const double s = curve.value, toned = s * (1.0 + model.tone * (1.0 - s));
        const double level = black + (white - black) * toned;
        const Saturation::Point point =
            model.saturation ? model.saturation->at(level) : Saturation::Point{level, 1.0, 0, 0};
        const MeanCode::Point code = mean_code.at(point.gray);
        gray = code.gray;
        clips = point.slope < 0.5;
        const double contrast = point.slope * (white - black);
        by_radiance = contrast * (1.0 + model.tone * (1.0 - 2.0 * s)) * curve.slope;
        const int n = terms.level_terms;
        for (int i = 0; i < n; ++i) {
            derivatives[i] = point.slope * (1.0 - toned) * level_terms[i];
            derivatives[n + i] = point.slope * toned * level_terms[i];
        }
        int next = 2 * n;
        if (terms.psf)
            derivatives[next++] = by_radiance * by_variances.sum();
        if (terms.psf_anisotropy)
            derivatives[next++] = by_radiance * (by_variances.x() - by_variances.y());
        if (terms.tone)
            derivatives[next++] = contrast * s * (1.0 - s);
        if (terms.saturation) {
            derivatives[next++] = point.by_level;
            derivatives[next++] = point.by_knee;
        }
        for (int i = 0; i < next; ++i)
            derivatives[i] *= code.slope;
        by_radiance *= code.slope;
        if (terms.noise)
            derivatives[next] = code.by_log_noise;
    }
};

// Rows of the equations' last columns, added to the normal equations many at a time.
class RowBlock {
public:
    RowBlock(Eigen::Index columns, PhotoEquations& equations)
        : equations_(equations), rows_(columns, rows_at_a_time) {}

    double* next() { return rows_.col(count_).data(); }

    // Takes the row that was written to next(), of a pixel in this block of the image. Beyond its
    // threshold Huber's loss has no curvature, and the row no information.
    void add(double noise, double residual, int image_block) {
        const double limited = std::clamp(residual, -huber_threshold, huber_threshold);
        const double size = std::abs(residual);
        equations_.huber_sum += size <= huber_threshold
                                    ? 0.5 * size * size
                                    : huber_threshold * (size - 0.5 * huber_threshold);
        equations_.squares += limited * limited;
        ++equations_.pixels;
        const double weight = 1.0 / noise, weighted = weight * limited;
        double* row = rows_.col(count_).data();
        double* score = equations_.block_scores.col(image_block).tail(rows_.rows()).data();
        for (Eigen::Index i = 0; i < rows_.rows(); ++i) {
            score[i] += weighted * row[i];
            row[i] *= weight;
        }
        if (limited == residual && ++count_ == rows_at_a_time)
            flush();
    }

    void flush() {
        const auto rows = rows_.leftCols(count_);
        const Eigen::Index n = rows.rows();
        equations_.information.bottomRightCorner(n, n)
            .template selfadjointView<Eigen::Lower>()
            .rankUpdate(rows);
        count_ = 0;
    }

private:
    static constexpr int rows_at_a_time = 256;

    PhotoEquations& equations_;
    Eigen::MatrixXd rows_;  // one column per pixel
    int count_ = 0;
};

// What is known of a saturation before the photograph is seen, as two more observations.
void add_known_saturation(const Saturation& saturation, const PhotometricTerms& terms,
                          PhotoEquations& equations) {
    constexpr Saturation known;
    constexpr double level_deviation_gray = 10.0, knee_deviation_gray = 15.0;
    const Eigen::Index at = equations.score.size() - (terms.noise ? 3 : 2);
    const auto observe = [&](Eigen::Index i, double missing, double deviation) {
        equations.information(i, i) += 1.0 / (deviation * deviation);
        equations.score[i] += missing / (deviation * deviation);
        equations.huber_sum += 0.5 * missing * missing / (deviation * deviation);
    };
    observe(at, known.level_gray - saturation.level_gray, level_deviation_gray);
    observe(at + 1, known.knee_gray - saturation.knee_gray, knee_deviation_gray);
}

// A held pose is no unknown, nor is a parameter that would leave its range.
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
    const Eigen::Index first = equations.score.size() - terms.count();
    if (!terms.pose)
        for (Eigen::Index i = 0; i < 6; ++i)
            fix(first - 6 + i);
    Eigen::Index next = first + 2 * terms.level_terms;
    const double variance = model.psf_sigma_px * model.psf_sigma_px;
    if (terms.psf)
        hold(next++, model.psf_sigma_px, 0.0, max_psf_sigma_px);
    if (terms.psf_anisotropy)
        hold(next++, model.psf_anisotropy_px2, -variance, variance);
    if (terms.tone)
        hold(next++, model.tone, -1.0, 1.0);
    if (terms.saturation) {
        const Saturation& saturation = *model.saturation;
        hold(next++, saturation.level_gray, min_saturation_gray, max_saturation_gray);
        hold(next, saturation.knee_gray, min_knee_gray, max_knee_gray);
    }
}

// Black and white by the straight line through all pixels used of gray against what the camera's
// curve makes of the radiance. (Blurred cells may be neither black nor white anywhere.)
std::pair<double, double> levels_of(const cv::Mat& gray, const Radiance& radiance,
                                    const cv::Mat& used, const LightCurve& curve) {
    constexpr double min_deviation = 0.01;  // of full scale: without contrast there is no line
    double count = 0.0, seen_sum = 0.0, gray_sum = 0.0, squares = 0.0, products = 0.0;
    for (int y = 0; y < gray.rows; ++y)
        for (int x = 0; x < gray.cols; ++x) {
            if (!used.at<uchar>(y, x))
                continue;
            const double seen = curve.value(radiance.at<float>(y, x));
            const double value = gray.at<float>(y, x);
            count += 1.0;
            seen_sum += seen;
            gray_sum += value;
            squares += seen * seen;
            products += seen * value;
        }
    const double variance = squares / count - std::pow(seen_sum / count, 2);
    if (!(variance > min_deviation * min_deviation))
        throw NumericalError("the marker's rendering has no contrast at this pose");
    const double slope = (products / count - seen_sum / count * gray_sum / count) / variance;
    const double black = (gray_sum - slope * seen_sum) / count;
    return {black, black + slope};
}

int image_block(const cv::Point& pixel, const cv::Rect& box) {
    const cv::Point at = pixel - box.tl();
    return at.y * blocks_a_side / box.height * blocks_a_side + at.x * blocks_a_side / box.width;
}

// ImageMotion at a pixel; no columns where there is none.
Eigen::Matrix2Xd motion_of(const Projector& projector, const Rigid& camera_from_marker,
                           const CalibrationModel& parameters, const Eigen::Vector2d& pixel) {
    const auto ray = projector.ray(pixel);
    const Eigen::Vector3d normal = camera_from_marker.rotation * Eigen::Vector3d::UnitZ();
    const double depth = ray ? normal.dot(camera_from_marker.translation) / normal.dot(*ray) : 0.0;
    if (!(depth > 0) || !std::isfinite(depth))
        return {};
    const Eigen::Vector3d point = depth * *ray;  // where the ray meets the marker's plane
    const auto projected = projector.project_with_jacobian(point);
    if (!projected)
        return {};
    const auto count = static_cast<Eigen::Index>(parameters.parameters.size());
    Eigen::Matrix2Xd motion(2, count + 6);
    if (count > 0)
        motion.leftCols(count) = parameter_jacobian(projector.camera(), *ray, parameters);
    Eigen::Matrix<double, 3, 6> moved;
    moved << -cross_matrix(point - camera_from_marker.translation), Eigen::Matrix3d::Identity();
    motion.rightCols<6>() = projected->jacobian * moved;
    return motion.allFinite() ? motion : Eigen::Matrix2Xd();
}

}  // namespace

ImageMotion::ImageMotion(const Projector& projector, const Rigid& camera_from_marker,
                         const CalibrationModel& parameters, const cv::Rect& region)
    : region_(region),
      columns_(static_cast<int>(parameters.parameters.size()) + 6),
      nodes_per_row_((region.width - 1) / spacing_px_ + 2) {
    require_point_of_view(projector.camera(), "deriving a rendering");
    for (int y = 0; y < (region.height - 1) / spacing_px_ + 2; ++y)
        for (int x = 0; x < nodes_per_row_; ++x)
            nodes_.push_back(motion_of(projector, camera_from_marker, parameters,
                                       {region.x + x * spacing_px_, region.y + y * spacing_px_}));
}

bool ImageMotion::at(int x, int y, Eigen::Ref<Eigen::Matrix2Xd> motion) const {
    const int i = (x - region_.x) / spacing_px_, j = (y - region_.y) / spacing_px_;
    const Eigen::Matrix2Xd *upper = &nodes_[static_cast<std::size_t>(j * nodes_per_row_ + i)],
                           *lower = upper + nodes_per_row_;
    if (upper[0].cols() == 0 || upper[1].cols() == 0 || lower[0].cols() == 0 ||
        lower[1].cols() == 0)
        return false;
    const double s = static_cast<double>(x - region_.x - i * spacing_px_) / spacing_px_;
    const double t = static_cast<double>(y - region_.y - j * spacing_px_) / spacing_px_;
    motion.noalias() = (1 - t) * (1 - s) * upper[0] + (1 - t) * s * upper[1] +
                       t * (1 - s) * lower[0] + t * s * lower[1];
    return true;
}

PhotometricCamera::PhotometricCamera(const CameraModel& camera, Predicts predicts)
    : projector_(camera), renderer_(camera), response_(SensorModel(camera).relative_response()) {
    if (!camera.sensor || !etalon::noise_gray(*camera.sensor, 0.0))
        return;
    for (int gray = 0; gray <= 255; ++gray)
        noise_.push_back(*etalon::noise_gray(*camera.sensor, gray));
    if (predicts == Predicts::mean_codes)
        mean_code_ = MeanCode(*camera.sensor);
}

double PhotometricCamera::noise_gray(double gray) const {
    if (noise_.empty())
        return 1.0;
    const double place = std::clamp(gray, 0.0, 255.0);
    const auto below = std::min<std::size_t>(static_cast<std::size_t>(place), 254);
    return std::lerp(noise_[below], noise_[below + 1], place - static_cast<double>(below));
}

Radiance PhotometricCamera::at_sensor(const Scene& scene, const cv::Rect& region,
                                      double tolerance_gray) const {
    const cv::Mat image =
        renderer_.render_part(scene, {.tolerance_gray = tolerance_gray, .region = region})
            .within(region);
    return response_.empty() ? image : cv::Mat(image.mul(response_(region)));
}

RenderedGradient PhotometricCamera::gradient_at_sensor(const PlacedMarker& marker,
                                                       double background, const ImageMotion& motion,
                                                       Differences differences,
                                                       double tolerance_gray) const {
    constexpr double shift_px = 0.1;
    const cv::Rect& region = motion.region();
    // Displacement in the image by mm along the marker's x and y.
    const Eigen::Matrix<double, 3, 2> axes =
        marker.camera_from_marker.rotation.toRotationMatrix().leftCols<2>();
    Eigen::Matrix2Xd moved(2, motion.columns());
    const auto px_per_mm = [&]() -> Eigen::Matrix2d { return moved.rightCols<3>() * axes; };
    if (!motion.at(region.x + region.width / 2, region.y + region.height / 2, moved))
        throw NumericalError("the middle of the marker's image sees nothing of its plane");
    const Eigen::Array2d shift_mm = shift_px / px_per_mm().colwise().norm().transpose().array();
    const auto rendered = [&](const Eigen::Vector3d& shift) {
        PlacedMarker there = marker;
        there.camera_from_marker.translation += marker.camera_from_marker.rotation * shift;
        return renderer_
            .render_part({{there}, background},
                         {.tolerance_gray = tolerance_gray, .region = region})
            .within(region);
    };
    RenderedGradient gradient{rendered(Eigen::Vector3d::Zero()), {}, {}};
    const auto slope = [&](const Eigen::Vector3d& shift) -> cv::Mat {  // per mm
        const cv::Mat ahead = rendered(shift);
        if (differences == Differences::forward)
            return (ahead - gradient.radiance) / shift.norm();
        return (ahead - rendered(-shift)) / (2.0 * shift.norm());
    };
    gradient.by_x = slope({shift_mm.x(), 0, 0});
    gradient.by_y = slope({0, shift_mm.y(), 0});
    for (int y = 0; y < region.height; ++y)
        for (int x = 0; x < region.width; ++x) {
            float &along_x = gradient.by_x.at<float>(y, x),
                  &along_y = gradient.by_y.at<float>(y, x);
            if (along_x == 0.0F && along_y == 0.0F)
                continue;
            Eigen::RowVector2d in_image = Eigen::RowVector2d::Zero();
            // The marker moved to the right shows at each pixel what was to the left of it.
            if (motion.at(region.x + x, region.y + y, moved))
                in_image = -Eigen::RowVector2d(along_x, along_y) * px_per_mm().inverse();
            if (!in_image.allFinite())
                in_image.setZero();
            along_x = static_cast<float>(in_image.x());
            along_y = static_cast<float>(in_image.y());
        }
    for (cv::Mat* image : {&gradient.radiance, &gradient.by_x, &gradient.by_y})
        if (!response_.empty())
            *image = image->mul(response_(region));
    return gradient;
}

void require_fitting(const PhotoOfMarker& photo, const PhotometricCamera& camera) {
    const cv::Size size(camera.model().width, camera.model().height);
    if (photo.gray.type() != CV_32FC1 || photo.use.type() != CV_8UC1 || photo.gray.size() != size ||
        photo.use.size() != size)
        throw NumericalError(
            fmt::format("photograph {} x {} and mask {} x {} px do not fit the camera's {} x {}",
                        photo.gray.cols, photo.gray.rows, photo.use.cols, photo.use.rows,
                        size.width, size.height));
}

cv::Rect fitted_region(const PhotoOfMarker& photo, const PhotometricCamera& camera, int room_px) {
    require_fitting(photo, camera);
    const cv::Mat fitted = photo.use == photo.fitted;
    if (cv::countNonZero(fitted) < min_pixels)
        throw NumericalError(
            fmt::format("fewer than {} pixels of the marker can be fitted", min_pixels));
    return padded(cv::boundingRect(fitted), room_px, fitted.size());
}

PhotoOfMarker with_few_flats(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                             const Rigid& camera_from_marker) {
    constexpr int many_pixels = 100'000, reach_px = 8, step_px = 7;
    constexpr double min_change_gray = 2.0;
    const cv::Rect region = fitted_region(photo, camera);
    if (cv::countNonZero(photo.use == photo.fitted) <= many_pixels)
        return photo;
    cv::Mat rendered, brightest, darkest;
    camera
        .at_sensor(scene_of(photo, camera_from_marker), region,
                   PhotometricCamera::rough_tolerance_gray)
        .convertTo(rendered, CV_8U, 255.0);
    const cv::Mat window = cv::Mat::ones(2 * reach_px + 1, 2 * reach_px + 1, CV_8U);
    cv::dilate(rendered, brightest, window);
    cv::erode(rendered, darkest, window);
    PhotoOfMarker few = photo;
    few.stands_for = step_px * step_px;
    few.use = photo.use.clone();
    cv::Mat flat = brightest - darkest <= min_change_gray;
    for (int y = 0; y < flat.rows; y += step_px)
        for (int x = 0; x < flat.cols; x += step_px)
            flat.at<uchar>(y, x) = 0;
    few.use(region).setTo(pixel_outside, flat);
    return few;
}

PhotoOfMarker with_few_pixels(const PhotoOfMarker& photo, int enough_pixels) {
    constexpr double golden = 0.382;
    const int fitted = cv::countNonZero(photo.use == photo.fitted);
    if (fitted <= 2 * enough_pixels)
        return photo;
    const int one_in = (fitted + enough_pixels - 1) / enough_pixels;
    int by_row = std::max(1, static_cast<int>(std::lround(golden * one_in)));
    while (std::gcd(by_row, one_in) != 1)
        ++by_row;
    PhotoOfMarker few = photo;
    few.use = cv::Mat(photo.use.size(), CV_8UC1, cv::Scalar(pixel_outside));
    for (int y = 0; y < few.use.rows; ++y)
        for (int x = by_row * y % one_in; x < few.use.cols; x += one_in)
            few.use.at<uchar>(y, x) = photo.use.at<uchar>(y, x);
    return few;
}

PhotoEquations photo_equations(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                               const PhotoState& state, const PhotometricTerms& terms,
                               const CalibrationModel& parameters, double noise_scale) {
    const ImageMotion motion(camera.projector(), state.camera_from_marker, parameters,
                             fitted_region(photo, camera));
    const RenderedGradient rendered =
        camera.gradient_at_sensor({photo.grid, state.camera_from_marker}, photo.background, motion);
    return photo_equations(photo, camera, state, terms, rendered, motion, noise_scale);
}

PhotoEquations photo_equations(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                               const PhotoState& state, const PhotometricTerms& terms,
                               const RenderedGradient& rendered, const ImageMotion& motion,
                               double noise_scale, std::vector<cv::Mat> changes) {
    const Eigen::Vector2d sigmas_px = state.photometry.psf_sigmas_px();
    const BlurredRendering seen(rendered, sigmas_px);
    for (cv::Mat& image : changes)
        image = BlurredRendering::behind_gaussian(image, sigmas_px);
    const LightCurve curve = camera.curve(state.photometry);
    const cv::Rect& region = motion.region();
    const int further = static_cast<int>(changes.size()), geometric = motion.columns(),
              photometric = terms.count(), all = further + geometric + photometric;

    std::vector<cv::Point> places;
    cv::findNonZero(photo.use(region) == photo.fitted, places);
    const cv::Rect fitted = cv::boundingRect(places);
    const cv::Rect box(fitted.tl() - cv::Point(gaussian_reach_px, gaussian_reach_px),
                       fitted.br() + cv::Point(gaussian_reach_px, gaussian_reach_px));
    PhotoEquations equations{
        .state = state,
        .noise_scale = noise_scale,
        .information = Eigen::MatrixXd::Zero(all, all),
        .block_scores = Eigen::MatrixXd::Zero(all, blocks_a_side * blocks_a_side)};
    RowBlock edges(all, equations), flats(photometric, equations);
    const bool by_width = terms.psf || terms.psf_anisotropy;
    Eigen::Matrix2Xd moved(2, geometric);
    std::vector<double> sizes;
    int beside_edges = 0;
    std::vector<LevelRow> levels;
    for (int y = 0; y < region.height; ++y)
        levels.emplace_back(state.photometry, region.y + y, photo.use.size());
    for (const cv::Point& at : places) {
        const cv::Point pixel = region.tl() + at;
        const Eigen::RowVector2d slope = seen.slope(at.x, at.y);
        const bool is_flat = slope.lpNorm<1>() < flat;
        if (!is_flat && !motion.at(pixel.x, pixel.y, moved))
            continue;
        RowBlock& block = is_flat ? flats : edges;
        double* row = block.next();
        const LevelRow& level = levels[static_cast<std::size_t>(at.y)];
        const PixelEquation model(
            state.photometry, terms, camera.mean_code(), level.black(pixel.x), level.white(pixel.x),
            level_terms(pixel.x, pixel.y, photo.use.size()), curve.at(seen.radiance.at<float>(at)),
            by_width ? seen.by_variances(at.x, at.y) : Eigen::Vector2d::Zero(),
            is_flat ? row : row + further + geometric);
        for (std::size_t i = 0; !is_flat && i < changes.size(); ++i)
            *row++ = model.by_radiance * changes[i].at<float>(at);
        for (Eigen::Index i = 0; !is_flat && i < geometric; ++i)
            *row++ = -model.by_radiance * (slope.x() * moved(0, i) + slope.y() * moved(1, i));
        const double noise = noise_scale * camera.noise_gray(model.gray);
        const double residual = (photo.gray.at<float>(pixel) - model.gray) / noise;
        if (!model.clips && (is_flat || ++beside_edges % photo.stands_for == 0))
            sizes.push_back(std::abs(residual));
        block.add(noise, residual, image_block(at, box));
    }
    edges.flush();
    flats.flush();
    equations.score = equations.block_scores.rowwise().sum();
    equations.information = Eigen::MatrixXd(equations.information.selfadjointView<Eigen::Lower>());
    if (terms.saturation)
        add_known_saturation(*state.photometry.saturation, terms, equations);
    hold_what_is_fixed(state.photometry, terms, equations);
    if (equations.pixels < min_pixels || sizes.empty() || !std::isfinite(equations.huber_sum))
        throw NumericalError(fmt::format("{} pixels of the marker can be fitted, with a loss of {}",
                                         equations.pixels, equations.huber_sum));
    equations.median_size = median(std::move(sizes));
    return equations;
}

cv::Mat predicted_at(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                     const PhotoState& state) {
    require_fitting(photo, camera);
    const cv::Rect region =
        padded(cv::boundingRect(photo.use != pixel_outside), gaussian_reach_px, photo.use.size());
    Radiance lit(photo.gray.size(), CV_32FC1, cv::Scalar(0));
    camera.at_sensor(scene_of(photo, state.camera_from_marker), region).copyTo(lit(region));
    return predicted_gray(state.photometry, lit, camera.curve(state.photometry));
}

PhotoState stepped(const PhotoState& state, const PhotometricTerms& terms,
                   const Eigen::VectorXd& step) {
    PhotoState next = state;
    next.camera_from_marker = left_perturbed(state.camera_from_marker, Vector6d(step.head<6>()));
    const int n = terms.level_terms;
    next.photometry.black.head(n) += step.segment(6, n);
    next.photometry.white.head(n) += step.segment(6 + n, n);
    int at = 6 + 2 * n;
    PhotometricModel& model = next.photometry;
    if (terms.psf)
        model.psf_sigma_px =
            std::sqrt(std::clamp(model.psf_sigma_px * model.psf_sigma_px + step[at++], 0.0,
                                 max_psf_sigma_px * max_psf_sigma_px));
    const double variance = model.psf_sigma_px * model.psf_sigma_px;
    if (terms.psf_anisotropy)
        model.psf_anisotropy_px2 += step[at++];
    model.psf_anisotropy_px2 = std::clamp(model.psf_anisotropy_px2, -variance, variance);
    if (terms.tone)
        model.tone = std::clamp(model.tone + step[at++], -1.0, 1.0);
    if (terms.saturation) {
        model.saturation->level_gray = std::clamp(model.saturation->level_gray + step[at],
                                                  min_saturation_gray, max_saturation_gray);
        model.saturation->knee_gray =
            std::clamp(model.saturation->knee_gray + step[at + 1], min_knee_gray, max_knee_gray);
    }
    return next;
}

PhotoState starting_state(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                          const Rigid& camera_from_marker, const PhotometricTerms& terms) {
    constexpr double typical_sigma_px = 0.75, min_gray = 0.0, full_gray = 255.0;
    constexpr int curve_rounds = 2;  // the levels say between which light the curve is taken
    const cv::Rect region = fitted_region(photo, camera, 0);
    const Radiance radiance = camera.at_sensor(scene_of(photo, camera_from_marker), region,
                                               PhotometricCamera::rough_tolerance_gray);
    PhotoState state{camera_from_marker, {}};
    state.photometry.black[0] = min_gray;
    state.photometry.white[0] = full_gray;
    for (int round = 0; round < curve_rounds; ++round) {
        const auto [black, white] =
            levels_of(photo.gray(region), radiance, photo.use(region) == photo.fitted,
                      camera.curve(state.photometry));
        state.photometry.black[0] = black;
        state.photometry.white[0] = white;
    }
    state.photometry.psf_sigma_px = terms.psf ? typical_sigma_px : 0.0;
    if (terms.saturation)
        state.photometry.saturation.emplace();
    return state;
}

namespace {

// Scaled to a unit diagonal, so that rad, mm and gray compare.
DampedStep step_of(const PhotoEquations& equations, double damping) {
    const Eigen::VectorXd scale =
        equations.information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    Eigen::MatrixXd scaled = scale.asDiagonal() * equations.information * scale.asDiagonal();
    scaled.diagonal() *= 1.0 + damping;
    const Eigen::LLT<Eigen::MatrixXd> solver(scaled);
    const Eigen::VectorXd delta =
        scale.cwiseProduct(Eigen::VectorXd(solver.solve(scale.cwiseProduct(equations.score))));
    const double gain = 0.5 * equations.score.dot(delta);
    if (solver.info() != Eigen::Success || !std::isfinite(gain))
        throw NumericalError("the photograph does not determine pose and photometric model");
    return {delta, gain};
}

}  // namespace

PhotometricSteps::PhotometricSteps(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                                   const PhotometricTerms& terms, const PhotoState& near)
    : photo_(&photo),
      camera_(&camera),
      terms_(terms),
      motion_(camera.projector(), near.camera_from_marker, {},
              fitted_region(
                  photo, camera,
                  terms.psf || !near.photometry.psf_sigmas_px().isZero() ? gaussian_reach_px : 1)) {
}  // what central differences reach

void PhotometricSteps::render(const Rigid& camera_from_marker) {
    if (rendered_ && rendered_->rotation.coeffs() == camera_from_marker.rotation.coeffs() &&
        rendered_->translation == camera_from_marker.translation)
        return;
    ++renderings_;
    gradient_.radiance = camera_->at_sensor(
        {{{photo_->grid, camera_from_marker}}, photo_->background}, motion_.region(),
        gradient_.by_x.empty() ? PhotometricCamera::rough_tolerance_gray
                               : PhotometricCamera::fine_tolerance_gray);
    rendered_ = camera_from_marker;
}

PhotoEquations PhotometricSteps::at(const PhotoState& state, double noise_scale) {
    render(state.camera_from_marker);
    return photo_equations(*photo_, *camera_, state, terms_, gradient_, motion_, noise_scale);
}

void PhotometricSteps::render_gradient(const PhotoState& state) {
    renderings_ += 3;
    motion_ = ImageMotion(camera_->projector(), state.camera_from_marker, {}, motion_.region());
    gradient_ = camera_->gradient_at_sensor({photo_->grid, state.camera_from_marker},
                                            photo_->background, motion_, Differences::forward);
    rendered_ = state.camera_from_marker;
}

// Where nothing can be rendered it is no better than where the loss is higher.
std::optional<PhotoEquations> PhotometricSteps::after(const PhotoEquations& place,
                                                      const Eigen::VectorXd& step) {
    return attempted([&] { return at(stepped(place.state, terms_, step), place.noise_scale); })
        .value;
}

bool PhotometricSteps::descend(PhotoEquations& place, DescentRule rule) {
    rule.max_tries = std::min(rule.max_tries, 25);
    rule.max_damping = std::min(rule.max_damping, 1e3);
    const auto tried = [&](const PhotoEquations& from, const DampedStep& step) {
        return after(from, step.step);
    };
    const auto step_at = [](const PhotoEquations& from, double damping) {
        return step_of(from, damping);
    };
    auto descent = levenberg_marquardt(std::move(place), rule, step_at, tried);
    place = std::move(descent.place);
    return descent.converged || promised_gain(place) < rule.enough_gain;
}

bool PhotometricSteps::settle(PhotoEquations& place, double enough_gain) {
    constexpr double slow = 0.5;
    DampedStep step = step_of(place, 0.0);
    while (step.predicted_gain > enough_gain) {
        auto next = after(place, step.step);
        if (!next)
            return false;
        DampedStep next_step = step_of(*next, 0.0);
        if (!(next_step.predicted_gain < slow * step.predicted_gain))
            return false;
        place = std::move(*next);
        step = std::move(next_step);
    }
    return true;
}

double promised_gain(const PhotoEquations& equations) {
    return step_of(equations, 0.0).predicted_gain;
}

double noise_scale_of(const PhotoEquations& place, bool knows_noise) {
    constexpr double min_gray = 0.2;  // rounding to 8 bits: 1 / sqrt(12), and a little less
    const double found = 1.4826 * place.median_size * place.noise_scale;
    if (!knows_noise)
        return std::max(found, min_gray);
    const double median_error = 1.17 / std::sqrt(place.pixels);
    return found < 1.0 + 3.0 * median_error ? 1.0 : found;
}

PhotoEquations approached(PhotometricSteps& steps, const PhotoState& start) {
    constexpr double above_all = 1e4, least = 0.2;
    constexpr double largest = 2.0;  // edges, few pixels of all, are off by some ten times the rms
    const PhotoEquations first = steps.at(start, above_all);
    const double rms = above_all * std::sqrt(first.squares / first.pixels);
    PhotoEquations place = steps.at(start, std::max(largest * rms, least));
    const double enough = std::max(1.0, 0.02 * place.loss());
    steps.descend(place, {.first_damping = 1e-3, .max_damping = 1.0, .enough_gain = enough});
    return place;
}

}  // namespace etalon
