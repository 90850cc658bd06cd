#include "compare/photometric/photometric_detector.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <opencv2/imgproc.hpp>

#include "compare/detect/detector.h"
#include "core/program/errors.h"
#include "core/statistics/covariance.h"

namespace etalon {
namespace {

// The pose's part of the inverse information times the variance, widened by what the residuals of
// parts of the picture did to the pose: neighbouring pixels may err alike.
Matrix6d pose_covariance(const PhotoEquations& equations, double variance) {
    constexpr double rounding = 1e-13;  // of the largest eigenvalue, which is at most their number
    const Eigen::MatrixXd& information = equations.information;
    const auto inverse = covariance_from_information(
        information, rounding * static_cast<double>(information.rows()));
    if (!inverse)
        throw NumericalError("the photograph does not determine pose and photometric model");
    const Matrix6d root = inverse->topLeftCorner<6, 6>().llt().matrixL();
    const double blocks =
        static_cast<double>((equations.block_scores.colwise().squaredNorm().array() > 0).count());
    const double fitted = static_cast<double>(information.rows());
    if (blocks < 2.0 * fitted)
        return variance * root * root.transpose();
    const Eigen::MatrixXd effects = root.triangularView<Eigen::Lower>().solve(
        Eigen::MatrixXd(inverse->topRows<6>() * equations.block_scores));
    const double left = blocks / (blocks - fitted);  // of what the fit itself took out
    return variance * root * cluster_robust_factor(effects * std::sqrt(left / variance)) *
           root.transpose();
}

constexpr double settled_step = 0.1;  // standard deviations as stated

// The minimum that a start leads to, found as far as it is needed.
struct Solution {
    PhotometricSteps steps;
    PhotoEquations place = {};
    bool converged = false;

    // Sees as many pixels as show the way.
    Solution(const PhotoOfMarker& photo, const PhotoOfMarker& few, const PhotometricCamera& camera,
             const PhotometricTerms& terms, const PhotoState& start)
        : steps(photo, camera, terms, start) {
        steps.look_at(few);
    }

    // Where that leads nowhere, it stays.
    void approach() {
        attempted([&] {
            place = approached(steps, place.state);
            return true;
        });
    }

    // Huber's loss at this noise, to a tenth of a standard deviation, with the gradient of here.
    void find_minimum(double noise_scale) {
        constexpr double enough_gain = 0.005;
        steps.render_gradient(place.state);
        place = steps.at(place.state, noise_scale);
        if (!steps.settle(place, enough_gain))
            steps.descend(place, {.enough_gain = enough_gain, .slack = 1.0});
    }

    // To a hundredth of a standard deviation: a step of that promises half of its square.
    void settle(double noise_scale) {
        constexpr double enough_gain = 5e-5;
        if (is_another(noise_scale))
            place = steps.at(place.state, noise_scale);
        converged = steps.settle(place, enough_gain);
        if (converged)
            return;
        steps.render_gradient(place.state);
        place = steps.at(place.state, noise_scale);
        converged = steps.settle(place, enough_gain);
    }

    // Whether this noise is not that of the equations.
    bool is_another(double noise_scale) const {
        constexpr double same_noise = 0.05;
        return std::abs(noise_scale / place.noise_scale - 1.0) > same_noise;
    }

    double loss() const { return place.loss(); }
    // What a step may leave of the loss; the approach's gradient is wrong by some 10 %.
    double promised_loss() const {
        const auto gain = attempted([&] { return promised_gain(place); }).value;
        return loss() - 1.25 * gain.value_or(0.0);
    }
};

// From the mirrored tilt down to where nine points of the pattern come nearest to their images, if
// that is not the pose itself again.
Rigid other_planar_pose(const Projector& projector, const CellGrid& grid, const Rigid& pose) {
    const Rigid mirrored = tilt_mirrored(pose, grid);
    std::vector<Eigen::Vector3d> points;
    std::vector<Eigen::Vector2d> pixels;
    for (int i = 0; i < 9; ++i) {
        points.push_back(
            grid.point_mm(0.5 * (i % 3) * grid.columns(), 0.5 * (i / 3) * grid.rows()));
        const auto pixel = projector.project(pose * points.back());
        if (!pixel)
            return mirrored;
        pixels.push_back(*pixel);
    }
    const auto other = estimate_pose_near(projector, points, pixels, mirrored);
    const auto turned = [&](const Rigid& to) { return pose.rotation.angularDistance(to.rotation); };
    const bool is_another = other && turned(other->camera_from_marker) > 0.5 * turned(mirrored);
    return is_another ? other->camera_from_marker : mirrored;
}

// At the same noise. Nothing where it cannot be rendered.
std::optional<Solution> mirrored_solution(const PhotoOfMarker& photo, const PhotoOfMarker& few,
                                          const PhotometricCamera& camera,
                                          const PhotometricTerms& terms,
                                          const PhotoEquations& place) {
    const PhotoState start{
        other_planar_pose(camera.projector(), photo.grid, place.state.camera_from_marker),
        place.state.photometry};
    return attempted([&] {
               Solution solution(photo, few, camera, terms, start);
               solution.place = solution.steps.at(start, place.noise_scale);
               return solution;
           })
        .value;
}

// At the same noise; where its loss may come near the other's, down to its minimum.
void compare_with(const Solution& best, Solution& other) {
    constexpr double far = 1.5, doubt = 50.0;
    other.place = other.steps.at(other.place.state, best.place.noise_scale);
    if (other.promised_loss() > far * best.loss() + doubt)
        return;
    other.approach();
    other.find_minimum(best.place.noise_scale);
    if (other.loss() < best.loss() + doubt)
        other.settle(best.place.noise_scale);
}

// In the standard deviations of a pose, all six components together.
double size_of(const Vector6d& step, const Matrix6d& covariance) {
    return std::sqrt(step.dot(covariance.ldlt().solve(step)));
}

PhotometricPose pose_of(const Solution& solution, const PhotometricTerms& terms, bool knows_noise) {
    const PhotoEquations& equations = solution.place;
    PhotometricPose pose;
    pose.camera_from_marker = equations.state.camera_from_marker;
    pose.photometry = equations.state.photometry;
    pose.photometry.pixels = equations.pixels;
    pose.noise_scale = equations.noise_scale;
    pose.reduced_squares = equations.squares / (equations.pixels - 6.0 - terms.count());
    const double variance =
        knows_noise ? std::max(pose.reduced_squares, 1.0) : pose.reduced_squares;
    pose.covariance = pose_covariance(equations, variance);
    pose.loss = equations.loss();
    pose.pixels = equations.pixels;
    const Vector6d next_step = equations.information.ldlt().solve(equations.score).head<6>();
    pose.converged = solution.converged || size_of(next_step, pose.covariance) < settled_step;
    return pose;
}

}  // namespace

Rigid tilt_mirrored(const Rigid& camera_from_marker, const CellGrid& grid) {
    const Eigen::Vector3d middle_mm = grid.point_mm(0.5 * grid.columns(), 0.5 * grid.rows());
    const Eigen::Vector3d middle = camera_from_marker * middle_mm;
    const Eigen::Vector3d sight = middle.normalized();
    // The axes are reflected along the line of sight; the normal is turned back to its side.
    Eigen::Matrix3d axes = (Eigen::Matrix3d::Identity() - 2.0 * sight * sight.transpose()) *
                           camera_from_marker.rotation.toRotationMatrix();
    axes.col(2) = -axes.col(2);
    const Eigen::Quaterniond rotation = Eigen::Quaterniond(axes).normalized();
    return {rotation, middle - rotation * middle_mm};
}

PhotometricPose photometric_pose(const PhotoOfMarker& photo,
                                 std::shared_ptr<const PhotometricCamera> camera,
                                 const PhotoState& start, const PhotometricTerms& terms) {
    constexpr int enough_pixels = 4000;
    const PhotoOfMarker few = with_few_pixels(photo, enough_pixels);
    Solution best(photo, few, *camera, terms, start);
    best.place = approached(best.steps, start);
    std::optional<Solution> other = mirrored_solution(photo, few, *camera, terms, best.place);
    if (other && other->promised_loss() < best.loss()) {
        other->approach();
        other->place = other->steps.at(other->place.state, best.place.noise_scale);
        if (other->loss() < best.loss())
            std::swap(best, *other);
    }
    best.steps.look_at(photo);
    const auto noise_scale = [&] { return noise_scale_of(best.place, camera->knows_noise()); };
    best.find_minimum(noise_scale());
    best.settle(noise_scale());
    if (best.is_another(noise_scale()))
        best.settle(noise_scale());
    if (other) {
        other->steps.look_at(photo);
        compare_with(best, *other);
        if (other->loss() < best.loss())
            std::swap(best, *other);
    }

    PhotometricPose pose = pose_of(best, terms, camera->knows_noise());
    pose.renderings = best.steps.renderings() + (other ? other->steps.renderings() : 0);
    constexpr double same_pose = 3.0;  // standard deviations
    if (!other)
        return pose;
    const Rigid& there = other->place.state.camera_from_marker;
    if (size_of(left_difference(pose.camera_from_marker, there), pose.covariance) > same_pose)
        pose.other = OtherPose{there, other->loss(), other->loss() - best.loss()};
    return pose;
}

namespace {

// Least squares until it no longer helps.
PhotoState all_the_way(PhotometricSteps& steps, PhotoState state) {
    constexpr int max_rounds = 6;
    constexpr double no_gain = 0.97;
    double before = std::numeric_limits<double>::infinity();
    for (int round = 0; round < max_rounds; ++round) {
        const PhotoEquations place = approached(steps, state);
        state = place.state;
        const double left = place.noise_scale * std::sqrt(place.squares / place.pixels);
        if (left > no_gain * before)
            break;
        before = left;
    }
    return state;
}

// Of two images over the pixels that count.
double correlation(const cv::Mat& a, const cv::Mat& b, const cv::Mat& counted) {
    cv::Scalar mean_a, mean_b, deviation_a, deviation_b;
    cv::meanStdDev(a, mean_a, deviation_a, counted);
    cv::meanStdDev(b, mean_b, deviation_b, counted);
    const double both = cv::mean(a.mul(b), counted)[0] - mean_a[0] * mean_b[0];
    return both / (deviation_a[0] * deviation_b[0]);
}

// By how many px the rendering must be moved to correlate best with the photograph, up to `reach`
// each way. Both are blurred: the marker may be turned and scaled a little.
Eigen::Vector2d best_shift(const cv::Mat& gray, const Radiance& expected, const cv::Rect& region,
                           int reach) {
    constexpr double sigma_px = 2.0;
    const cv::Rect inner(region.x + reach, region.y + reach, region.width - 2 * reach,
                         region.height - 2 * reach);
    if (inner.width < reach || inner.height < reach)
        return {0.0, 0.0};
    cv::Mat score;
    cv::matchTemplate(blurred(gray(region), sigma_px),
                      blurred(expected, sigma_px)(inner - region.tl()), score,
                      cv::TM_CCOEFF_NORMED);
    cv::Point best;
    cv::minMaxLoc(score, nullptr, nullptr, nullptr, &best);
    return {best.x - reach, best.y - reach};
}

// The marker moved across the line of sight to its middle, so that its image moves by so much.
Rigid moved_in_image(const Projector& projector, const Rigid& camera_from_marker,
                     const CellGrid& grid, const Eigen::Vector2d& shift_px) {
    const Eigen::Vector3d middle =
        camera_from_marker * grid.point_mm(0.5 * grid.columns(), 0.5 * grid.rows());
    const auto pixel = projector.project(middle);
    const auto there = pixel ? projector.ray(*pixel + shift_px) : std::nullopt;
    if (!there)
        throw NumericalError("the start does not put the marker's middle into the image");
    Rigid moved = camera_from_marker;
    moved.translation += middle.norm() * there->normalized() - middle;
    return moved;
}

}  // namespace

PhotometricTerms detector_terms(const CameraModel& camera) {
    return {.level_terms = 3, .psf = !camera.lens, .tone = !camera.sensor};
}

ComparedArea detector_area(const Marker& marker, const std::string& place) {
    ComparedArea area = compared_area(marker, {}, place);
    if (marker.kind != Marker::Kind::chessboard) {
        area.low_mm += 0.5 * area.cell_mm;
        area.high_mm -= 0.5 * area.cell_mm;
    }
    return area;
}

PhotometricDetector::PhotometricDetector(const CameraModel& camera, const Marker& marker,
                                         const std::string& place, double background)
    : camera_(std::make_shared<const PhotometricCamera>(camera)),
      grid_(marker.grid),
      area_(detector_area(marker, place)),
      background_(background) {
    require_point_of_view(camera, "the photometric pose");
}

PhotoOfMarker PhotometricDetector::photo_at(const cv::Mat& gray,
                                            const Rigid& camera_from_marker) const {
    constexpr uchar yes = 255;
    const cv::Mat use = pixel_uses(camera_->projector(), camera_from_marker, area_);
    PhotoOfMarker photo{gray, grid_, use != pixel_outside, yes, background_};
    if (cv::countNonZero(use) == 0)
        throw NumericalError("the start does not put the marker into the image");
    return photo;
}

Rigid PhotometricDetector::from_afar(const cv::Mat& gray, const Rigid& start,
                                     double start_error_px) const {
    const PhotoOfMarker at_start = photo_at(gray, start);
    const cv::Rect around = fitted_region(at_start, *camera_);
    const Radiance expected =
        camera_->at_sensor({{{grid_, start}}, at_start.background}, around, 1.0);
    const Eigen::Vector2d shift_px =
        best_shift(gray, expected, around, static_cast<int>(std::ceil(start_error_px)) + 1);
    Rigid pose = moved_in_image(camera_->projector(), start, grid_, shift_px);
    constexpr PhotometricTerms terms{.level_terms = 1, .psf = false};
    for (const double sigma_px : {max_psf_sigma_px, 0.5 * max_psf_sigma_px}) {
        PhotoOfMarker photo = photo_at(gray, pose);
        const cv::Rect region = fitted_region(photo, *camera_);
        photo.gray = gray.clone();
        blurred(gray(region), sigma_px).copyTo(photo.gray(region));
        PhotoState state = starting_state(photo, *camera_, pose, terms);
        state.photometry.psf_sigma_px = sigma_px;
        PhotometricSteps steps(photo, *camera_, terms, state);
        pose = all_the_way(steps, state).camera_from_marker;
    }
    return pose;
}

void PhotometricDetector::require_shown(const PhotoOfMarker& photo,
                                        const Rigid& camera_from_marker) const {
    constexpr double least = 0.7;
    const cv::Rect region = fitted_region(photo, *camera_, 0);
    const Radiance expected = camera_->at_sensor({{{grid_, camera_from_marker}}, photo.background},
                                                 region, PhotometricCamera::rough_tolerance_gray);
    const double found = correlation(photo.gray(region), expected, photo.use(region));
    if (!(found >= least))
        throw NumericalError(
            fmt::format("the marker is not there: correlation of photograph and rendering {:.2f}, "
                        "of which {:.1f} is the least",
                        found, least));
}

PhotometricPose PhotometricDetector::find(const CodeImage& image, const Rigid& start,
                                          double start_error_px) const {
    constexpr double blur_width_px = 1.0;
    const cv::Mat gray = gray_of(image);
    const Rigid near =
        start_error_px > blur_width_px ? from_afar(gray, start, start_error_px) : start;
    const PhotoOfMarker photo = photo_at(gray, near);
    const PhotometricTerms terms = detector_terms(camera_->model());
    const PhotometricPose pose =
        photometric_pose(photo, camera_, starting_state(photo, *camera_, near, terms), terms);
    require_shown(photo, pose.camera_from_marker);
    return pose;
}

}  // namespace etalon
