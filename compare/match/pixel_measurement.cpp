#include "compare/match/pixel_measurement.h"

#include <Eigen/Cholesky>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

bool has_aperture(const CameraModel& camera) {
    return camera.lens && camera.lens->psf.kind != PointSpread::Kind::measured;
}

// So much that the blur disk's radius changes by about 0.1 px.
double focus_step(const CameraModel& camera) {
    constexpr double change_px = 0.1;
    return change_px / (0.5 * camera.intrinsics.fx * thin_lens(camera).aperture_diameter_mm);
}

// By a further Gaussian's variance: half of the second differences along x and y, of fourth order.
cv::Mat by_blur(const cv::Mat& radiance) {
    const cv::Mat along =
        (cv::Mat_<float>(1, 5) << -1.0f / 24, 16.0f / 24, -30.0f / 24, 16.0f / 24, -1.0f / 24);
    cv::Mat by_x, by_y;
    cv::filter2D(radiance, by_x, CV_32F, along, {-1, -1}, 0, cv::BORDER_REPLICATE);
    cv::filter2D(radiance, by_y, CV_32F, along.t(), {-1, -1}, 0, cv::BORDER_REPLICATE);
    return by_x + by_y;
}

// Levels (and the width of a blur that no file tells) at a fixed pose and tone, by Gauss and
// Newton's method; residuals beyond three times `noise_scale` are limited.
PhotoState with_fitted_levels(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                              const RenderedGradient& rendered, const ImageMotion& motion,
                              PhotoState state, double noise_scale) {
    constexpr int most_rounds = 6;
    constexpr double settled_gray = 0.01;
    const PhotometricTerms terms = detector_terms(camera.model());
    for (int round = 0; round < most_rounds; ++round) {
        const PhotoEquations equations =
            photo_equations(photo, camera, state, terms, rendered, motion, noise_scale);
        const Eigen::Index n = terms.count();
        const Eigen::MatrixXd information = equations.information.bottomRightCorner(n, n);
        Eigen::VectorXd step = Eigen::VectorXd::Zero(6 + n);
        step.tail(n) = information.ldlt().solve(Eigen::VectorXd(equations.score.tail(n)));
        if (!step.allFinite())
            throw NumericalError("the pixels do not determine black and white");
        state = stepped(state, terms, step);
        if (step.tail(n).cwiseAbs().maxCoeff() < settled_gray)
            break;
    }
    return state;
}

// The deviations that a render is changed by, in the order of DeviatingCamera::changes().
std::vector<int> changed_in_renders(const std::array<bool, deviation::count>& asked) {
    std::vector<int> all;
    for (const int i :
         {deviation::f_number, deviation::inverse_focus, deviation::blur, deviation::print_gain})
        if (asked[static_cast<std::size_t>(i)])
            all.push_back(i);
    return all;
}

// Of normal equations, each unknown in its own unit.
Eigen::MatrixXd scaled_solution(const Eigen::MatrixXd& information, const Eigen::MatrixXd& right) {
    const Eigen::VectorXd scale = information.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
    const Eigen::LDLT<Eigen::MatrixXd> solver(
        Eigen::MatrixXd(scale.asDiagonal() * information * scale.asDiagonal()));
    return scale.asDiagonal() * solver.solve(Eigen::MatrixXd(scale.asDiagonal() * right));
}

// The deviations' part of normal equations in which all others are solved. Order: renders' changes
// first, the tone last but one, the noise last.
void reduce(const PhotoEquations& equations, const std::array<bool, deviation::count>& asked,
            PhotoEvidence& pixels) {
    std::vector<Eigen::Index> wanted;
    std::vector<int> as = changed_in_renders(asked);
    for (Eigen::Index i = 0; i < std::ssize(as); ++i)
        wanted.push_back(i);
    if (asked[deviation::tone]) {
        wanted.push_back(equations.score.size() - 2);
        as.push_back(deviation::tone);
    }
    wanted.push_back(equations.score.size() - 1);
    std::vector<Eigen::Index> others;
    for (Eigen::Index i = 0; i < equations.score.size(); ++i)
        if (std::ranges::find(wanted, i) == wanted.end())
            others.push_back(i);
    const Eigen::MatrixXd among = equations.information(others, others),
                          across = equations.information(others, wanted);
    const Eigen::MatrixXd solved = scaled_solution(among, across);
    const Eigen::VectorXd other_score = equations.score(others);
    const Eigen::MatrixXd information =
        Eigen::MatrixXd(equations.information(wanted, wanted)) - across.transpose() * solved;
    const Eigen::VectorXd score =
        Eigen::VectorXd(equations.score(wanted)) - solved.transpose() * other_score;
    if (!information.allFinite() || !score.allFinite())
        throw NumericalError("the pixels do not determine pose and levels");
    const auto n = std::ssize(as);
    pixels.score(as) = score.head(n);
    pixels.score_by_log_noise(as) = information.col(n).head(n);
    pixels.information(as, as) = information.topLeftCorner(n, n);
}

// Residuals over their stated noise, in all places, and in flat ones for the noise itself. Pixels
// of whose noise rounding is a large part are left out.
void add_noise(const PhotoOfMarker& photo, const PhotometricCamera& camera, const PhotoState& state,
               const RenderedGradient& rendered, const cv::Rect& region, PhotoEvidence& pixels) {
    constexpr double least_roundings = 2.0, limit = 10.0, flat_part = 0.1;
    constexpr int enough = 50;
    const LightCurve curve = camera.curve(state.photometry);
    double least_noise = 0.0;
    if (camera.knows_noise())
        least_noise =
            least_roundings * (255.0 / ((1 << camera.model().sensor->bits) - 1) / std::sqrt(12.0));
    const cv::Mat seen = blurred(rendered.radiance, state.photometry.psf_sigma_px);
    double noise_squares = 0.0, flat_squares = 0.0;
    int flats = 0;
    for (int y = 0; y < region.height; ++y)
        for (int x = 0; x < region.width; ++x) {
            const cv::Point at = region.tl() + cv::Point(x, y);
            if (photo.use.at<uchar>(at) != photo.fitted)
                continue;
            const double expected = state.photometry
                                        .at(level_terms(at.x, at.y, photo.use.size()),
                                            curve.value(seen.at<float>(y, x)))
                                        .gray;
            const double noise = camera.noise_gray(expected);
            if (noise < least_noise)
                continue;
            const double square =
                std::pow(std::min(std::abs(photo.gray.at<float>(at) - expected) / noise, limit), 2);
            noise_squares += noise * noise;
            pixels.squares += square;
            ++pixels.pixels;
            const double steepness =
                255.0 * std::hypot(rendered.by_x.at<float>(y, x), rendered.by_y.at<float>(y, x));
            if (steepness < flat_part * noise) {
                flat_squares += square;
                ++flats;
            }
        }
    if (pixels.pixels > 0)
        pixels.noise_gray = std::sqrt(noise_squares / pixels.pixels);
    if (camera.knows_noise() && flats >= enough)
        pixels.noise_ratio = std::sqrt(flat_squares / flats);
}

// Mean of a ring beside the printed area, clear of what is blurred into it, of what lies about its
// median; nothing where it is not in the image.
std::optional<double> ring_mean(const cv::Mat& gray, const cv::Mat& printed, double blur_px) {
    constexpr int width = 8, enough = 100;
    constexpr double about_gray = 10.0;
    const double clear = 3.0 * blur_px + 2.0;
    cv::Mat distance;
    cv::distanceTransform(~printed, distance, cv::DIST_L2, 3);
    const cv::Mat ring = (distance > clear) & (distance <= clear + width);
    std::vector<double> seen;
    for (int y = 0; y < ring.rows; ++y)
        for (int x = 0; x < ring.cols; ++x)
            if (ring.at<uchar>(y, x))
                seen.push_back(gray.at<float>(y, x));
    if (seen.size() < enough)
        return std::nullopt;
    const double middle = median(seen);
    std::erase_if(seen, [&](double each) { return std::abs(each - middle) > about_gray; });
    return std::accumulate(seen.begin(), seen.end(), 0.0) / static_cast<double>(seen.size());
}

void add_background(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                    const PhotoState& state, const ComparedArea& whole, PhotoEvidence& pixels) {
    constexpr int reach = 40;
    const cv::Mat printed =
        pixel_uses(camera.projector(), state.camera_from_marker, whole) != pixel_outside;
    const cv::Rect region = padded(cv::boundingRect(printed), reach, printed.size());
    const double blur_px =
        std::min(blur_sigma_px(camera.model(), state.camera_from_marker.translation.z()), 9.0);
    const auto seen = ring_mean(photo.gray(region), printed(region), blur_px);
    if (!seen)
        return;
    const cv::Point middle = (region.tl() + region.br()) / 2;
    const Vector6d terms = level_terms(middle.x, middle.y, printed.size());
    const double expected = camera.curve(state.photometry).value(photo.background);
    pixels.background_gray = *seen - state.photometry.at(terms, expected).gray;
    pixels.background_by_tone_gray = expected * (1.0 - expected) * pixels.contrast_gray;
}

void add_levels(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                const PhotoState& state, const std::optional<ComparedArea>& whole,
                PhotoEvidence& pixels) {
    const cv::Rect region = fitted_region(photo, camera);
    const cv::Point middle = (region.tl() + region.br()) / 2;
    const Vector6d terms = level_terms(middle.x, middle.y, photo.use.size());
    const double black = state.photometry.black.dot(terms),
                 white = state.photometry.white.dot(terms);
    if (!(white > black))
        throw NumericalError("white is not brighter than black");
    pixels.contrast_gray = white - black;
    if (const auto& sensor = camera.model().sensor)
        pixels.black_gray = black - sensor->black_dn * 255.0 / ((1 << sensor->bits) - 1);
    pixels.shading = state.photometry.white.segment<2>(1) / white;
    if (whole)
        add_background(photo, camera, state, *whole, pixels);
}

}  // namespace

DeviatingCamera::DeviatingCamera(const CameraModel& calibration, const PixelDeviation& deviating)
    : asked_(asked_of(calibration)),
      deviating_(deviating),
      steps_(PixelDeviation::Zero()),
      camera_(with_lens(calibration, deviating), PhotometricCamera::Predicts::mean_codes) {
    constexpr double f_number_step = 0.03;
    const auto stepped_lens = [&](int which, double step) {
        steps_[which] = step;
        PixelDeviation more = deviating;
        more[which] += step;
        return with_lens(calibration, more);
    };
    if (asked_[deviation::f_number])
        other_f_number_.emplace(stepped_lens(deviation::f_number, f_number_step));
    if (asked_[deviation::inverse_focus])
        other_focus_.emplace(stepped_lens(deviation::inverse_focus, focus_step(camera_.model())));
}

std::array<bool, deviation::count> DeviatingCamera::asked_of(const CameraModel& calibration) {
    const bool aperture = has_aperture(calibration);
    return {aperture, aperture, calibration.lens.has_value(), calibration.sensor.has_value(), true};
}

// In the order of the deviations, without the tone, which follows from the light itself.
std::vector<cv::Mat> DeviatingCamera::changes(const PhotoOfMarker& photo,
                                              const Rigid& camera_from_marker,
                                              const RenderedGradient& rendered,
                                              const cv::Rect& region) const {
    const Scene scene{{{photo.grid, camera_from_marker}}, photo.background};
    std::vector<cv::Mat> all;
    if (other_f_number_)
        all.push_back((other_f_number_->at_sensor(scene, region) - rendered.radiance) /
                      steps_[deviation::f_number]);
    if (other_focus_)
        all.push_back((other_focus_->at_sensor(scene, region) - rendered.radiance) /
                      steps_[deviation::inverse_focus]);
    if (asked_[deviation::blur])
        all.push_back(by_blur(rendered.radiance));
    cv::Mat steepness;
    cv::magnitude(rendered.by_x, rendered.by_y, steepness);
    all.push_back(-steepness);  // every edge moved into the light
    return all;
}

PhotoEvidence DeviatingCamera::measure(const PhotoOfMarker& all_of_it,
                                       const Rigid& camera_from_marker,
                                       const std::optional<ComparedArea>& whole,
                                       std::optional<double> noise_scale) const {
    constexpr double no_limit = 1e3;
    const PhotoOfMarker photo = with_few_flats(all_of_it, camera_, camera_from_marker);
    const ImageMotion motion(camera_.projector(), camera_from_marker, {},
                             fitted_region(photo, camera_));
    const RenderedGradient rendered =
        camera_.gradient_at_sensor({photo.grid, camera_from_marker}, photo.background, motion);
    PhotometricTerms terms = detector_terms(camera_.model());
    terms.tone = terms.noise = true;
    PhotoState state = starting_state(photo, camera_, camera_from_marker, terms);
    if (camera_.model().lens)
        state.photometry.psf_sigma_px = std::sqrt(std::max(deviating_[deviation::blur], 0.0));
    state.photometry.tone = deviating_[deviation::tone];
    PhotoEvidence pixels;
    state = with_fitted_levels(photo, camera_, rendered, motion, state, no_limit);
    pixels.residual_scale =
        std::max(1.0, 1.4826 * no_limit *
                          photo_equations(photo, camera_, state, detector_terms(camera_.model()),
                                          rendered, motion, no_limit)
                              .median_size);
    state = with_fitted_levels(photo, camera_, rendered, motion, state, pixels.residual_scale);
    const std::vector<cv::Mat> by_deviations =
        changes(photo, camera_from_marker, rendered, motion.region());
    const PhotoEquations equations =
        photo_equations(photo, camera_, state, terms, rendered, motion,
                        noise_scale.value_or(pixels.residual_scale), by_deviations);

    pixels.depth_mm = depth_mm(camera_.model().projection, camera_from_marker.translation);
    reduce(equations, asked_, pixels);
    const cv::Mat counted = photo.use(motion.region()) == photo.fitted;
    const std::vector<int> changed = changed_in_renders(asked_);
    for (std::size_t i = 0; i < changed.size(); ++i)
        pixels.largest_change[changed[i]] = cv::norm(by_deviations[i], cv::NORM_INF, counted);
    pixels.loss = equations.loss();
    add_noise(photo, camera_, state, rendered, motion.region(), pixels);
    add_levels(photo, camera_, state, whole, pixels);
    return pixels;
}

namespace {

// Deviations at one place with the sum of their photographs' equations.
struct DeviationPlace {
    PixelDeviation at;
    std::vector<PhotoEvidence> photos;
    PixelInformation information = deviation_prior();
    PixelDeviation score;
    double sum;

    DeviationPlace(const PixelDeviation& where, std::vector<PhotoEvidence> measured)
        : at(where),
          photos(std::move(measured)),
          score(-information * where),
          sum(-0.5 * score.dot(where)) {
        for (const PhotoEvidence& photo : photos) {
            information += photo.information;
            score += photo.score;
            sum += photo.loss;
        }
    }
    double loss() const { return sum; }
};

// By deviation: whether it is fitted.
using Free = std::array<bool, deviation::count>;

DampedStep newton_step(const DeviationPlace& place, double damping, const Free& free) {
    std::vector<int> at;
    for (int i = 0; i < deviation::count; ++i)
        if (free[static_cast<std::size_t>(i)])
            at.push_back(i);
    Eigen::MatrixXd information = place.information(at, at);
    const Eigen::VectorXd score = place.score(at);
    information.diagonal() *= 1.0 + damping;
    const Eigen::VectorXd solved = scaled_solution(information, score);
    PixelDeviation step = PixelDeviation::Zero();
    step(at) = solved;
    return {step, 0.5 * solved.dot(score)};
}

// Into the range in which a rendering has a meaning.
PixelDeviation limited(PixelDeviation deviating, const CameraModel& calibration) {
    constexpr double most_f_number = 2.1, most_tone = 0.95, most_blur = 4.0, least_blur = 0.0,
                     most_print_gain = 0.5, nearest_lens = 0.2;  // of 1 / image distance
    const auto limit = [&](int i, double low, double high) {
        deviating[i] = std::clamp(deviating[i], low, high);
    };
    limit(deviation::f_number, -most_f_number, most_f_number);
    limit(deviation::tone, -most_tone, most_tone);
    limit(deviation::blur, least_blur, most_blur);
    limit(deviation::print_gain, -most_print_gain, most_print_gain);
    if (has_aperture(calibration)) {
        const ThinLens lens = thin_lens(calibration);
        limit(deviation::inverse_focus, -lens.inverse_focus_per_mm,
              nearest_lens / lens.image_distance_mm - lens.inverse_focus_per_mm);
    }
    return deviating;
}

// Whether first order is enough from one place to another.
bool is_near(const PixelDeviation& step, const CameraModel& calibration) {
    PixelDeviation near = PixelDeviation::Constant(0.03);  // of f-number, blur and tone
    near[deviation::print_gain] = 0.05;
    near[deviation::inverse_focus] = has_aperture(calibration) ? focus_step(calibration) : 1.0;
    return (step.array().abs() < near.array()).all();
}

// Some photographs from all depths.
std::vector<std::size_t> some_of(const std::vector<PhotoEvidence>& photos) {
    constexpr std::size_t enough = 12;
    std::vector<std::size_t> order(photos.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::ranges::sort(order, {}, [&](std::size_t i) { return photos[i].depth_mm; });
    if (order.size() <= enough)
        return order;
    std::vector<std::size_t> some;
    for (std::size_t i = 0; i < enough; ++i)
        some.push_back(order[i * (order.size() - 1) / (enough - 1)]);
    return some;
}

// The best place for a few photographs, by renders that are made again; growth stays linear.
DeviationPlace descended(const CameraModel& calibration, const DeviationPlace& start,
                         std::span<const std::size_t> which, const Free& free, double noise_scale,
                         const MeasurePhotos& measure) {
    const auto step_at = [&](const DeviationPlace& place, double damping) {
        return newton_step(place, damping, free);
    };
    const auto tried = [&](const DeviationPlace& place, const DampedStep& step) {
        const PixelDeviation there = limited(place.at + step.step, calibration);
        return attempted([&] { return DeviationPlace(there, measure(there, which, noise_scale)); })
            .value;
    };
    return levenberg_marquardt(
               start,
               {.max_damping = 1e4, .max_tries = 20, .enough_gain = 2.0, .enough_part = 1e-3},
               step_at, tried)
        .place;
}

// Light first or lens first, whichever leads lower, then both: a wrong tone curve drives a lens
// that is free with it to where blur ends, and the other way round.
DeviationPlace best_of_all(const CameraModel& calibration, const DeviationPlace& start,
                           std::span<const std::size_t> which, const Free& asked,
                           double noise_scale, const MeasurePhotos& measure) {
    Free light{}, lens = asked, both = asked;
    light[deviation::tone] = asked[deviation::tone];
    lens[deviation::tone] = lens[deviation::print_gain] = both[deviation::print_gain] = false;
    DeviationPlace best = descended(calibration, start, which, light, noise_scale, measure);
    DeviationPlace other = descended(calibration, start, which, lens, noise_scale, measure);
    if (other.loss() < best.loss())
        best = std::move(other);
    return descended(calibration, best, which, both, noise_scale, measure);
}

}  // namespace

RunEvidence settled_pixels(const CameraModel& calibration, std::vector<PhotoEvidence> at_zero,
                           const MeasurePhotos& measure) {
    constexpr int most_rounds = 3;
    constexpr double no_gain = 0.99;
    RunEvidence result;
    result.asked = DeviatingCamera::asked_of(calibration);
    std::vector<std::size_t> all(at_zero.size());
    std::iota(all.begin(), all.end(), std::size_t{0});
    DeviationPlace place(PixelDeviation::Zero(), std::move(at_zero));
    for (int round = 0; round < most_rounds && !all.empty(); ++round) {
        if (is_near(newton_step(place, 0.0, result.asked).step, calibration))
            break;
        const std::vector<std::size_t> some = some_of(place.photos);
        std::vector<double> scales;
        for (const std::size_t i : some)
            scales.push_back(place.photos[i].residual_scale);
        const double scale = median(scales);
        const DeviationPlace start(place.at, measure(place.at, some, scale));
        const DeviationPlace there =
            best_of_all(calibration, start, some, result.asked, scale, measure);
        if (there.loss() > no_gain * start.loss())
            break;
        auto everywhere = attempted(
            [&] { return DeviationPlace(there.at, measure(there.at, all, std::nullopt)); });
        if (!everywhere)
            break;
        place = std::move(*everywhere);
    }
    result.at = place.at;
    result.photos = std::move(place.photos);
    return result;
}

}  // namespace etalon
