#include "compare/photometric/photo_match.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double limit = 3.0;  // of significance, standard deviations

ResidualStatistics statistics(const PhotoFit& fit, PixelUse use) {
    std::vector<double> sizes;
    double sum = 0.0, squares = 0.0;
    int significant = 0;
    for (int y = 0; y < fit.use.rows; ++y)
        for (int x = 0; x < fit.use.cols; ++x) {
            if (fit.use.at<uchar>(y, x) != use)
                continue;
            const double residual = fit.residual.at<float>(y, x);
            sizes.push_back(std::abs(residual));
            sum += residual;
            squares += residual * residual;
            significant += std::abs(fit.significance.at<float>(y, x)) > limit ? 1 : 0;
        }
    if (sizes.empty())
        throw NumericalError("no pixel of the marker is left to be scored");
    const double count = static_cast<double>(sizes.size());
    const auto rank = sizes.begin() + static_cast<std::ptrdiff_t>(std::ceil(0.99 * count)) - 1;
    std::nth_element(sizes.begin(), rank, sizes.end());
    return {.pixels = static_cast<int>(sizes.size()),
            .mean_gray = sum / count,
            .rms_gray = std::sqrt(squares / count),
            .p99_gray = *rank,
            .worst_gray = *std::ranges::max_element(sizes),
            .significant = significant / count};
}

// 1.4826 times the median size of the fitted residuals of pixels that do not clip: their standard
// deviation if they are normal, whatever a tenth of them is. Not below rounding to 8 bits.
double deviation_of_residuals(const PhotoFit& fit) {
    constexpr double min_gray = 0.289;
    const auto& saturation = fit.state.photometry.saturation;
    const double clipping = saturation ? saturation->at(saturation->level_gray).gray
                                       : std::numeric_limits<double>::infinity();
    std::vector<float> sizes;
    for (int y = 0; y < fit.use.rows; ++y)
        for (int x = 0; x < fit.use.cols; ++x)
            if (fit.use.at<uchar>(y, x) == pixel_fitted && fit.predicted.at<float>(y, x) < clipping)
                sizes.push_back(std::abs(fit.residual.at<float>(y, x)));
    if (sizes.empty())
        throw NumericalError("no pixel of the marker was fitted");
    const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
    std::nth_element(sizes.begin(), middle, sizes.end());
    return std::max(1.4826 * static_cast<double>(*middle), min_gray);
}

}  // namespace

std::optional<double> noise_gray(const Sensor& sensor, double gray) {
    if (!(sensor.gain_e_per_dn > 0))
        return std::nullopt;
    const double full_scale = (1 << sensor.bits) - 1;
    const double range = full_scale - sensor.black_dn;
    const double code = (gray / 255.0 * full_scale - sensor.black_dn) / range;
    const double linear = decode(sensor.transfer, code);
    constexpr double step = 1e-4;  // of full scale
    const double slope =
        (encode(sensor.transfer, linear + step) - encode(sensor.transfer, linear - step)) /
        (2.0 * step);
    const double read_dn = sensor.read_noise_e / sensor.gain_e_per_dn;
    const double linear_variance =
        std::max(linear * range, 0.0) / sensor.gain_e_per_dn + read_dn * read_dn;
    const double rounding = 1.0 / 12.0;  // variance of a rounding error, DN^2
    return std::sqrt(slope * slope * linear_variance + rounding) * 255.0 / full_scale;
}

namespace {

// Variances of the photometric parameters, all others marginalised.
Eigen::VectorXd photometric_variances(const PhotoEquations& equations,
                                      const PhotometricTerms& terms) {
    const Eigen::VectorXd scale = equations.information.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd inverse =
        (scale.asDiagonal() * equations.information * scale.asDiagonal())
            .ldlt()
            .solve(Eigen::MatrixXd(scale.asDiagonal()));
    const double freedom = equations.pixels - static_cast<double>(equations.score.size());
    return (scale.asDiagonal() * inverse).diagonal().tail(terms.count()) * equations.squares /
           freedom;
}

// In the equations' order.
std::vector<MatchParameter> fitted_parameters(const PhotometricModel& model,
                                              const PhotometricTerms& terms,
                                              const PhotoEquations& equations) {
    const Eigen::VectorXd variances = photometric_variances(equations, terms);
    std::vector<MatchParameter> parameters;
    int at = 0;
    const auto add = [&](const std::string& what, double value, double by_parameter,
                         const std::string& unit) {
        parameters.push_back(
            {what, value, by_parameter * std::sqrt(variances[at++]), unit, "this image"});
    };
    constexpr const char* shape[] = {"",         ", along x", ", along y",
                                     ", by x^2", ", by x y",  ", by y^2"};
    for (int i = 0; i < terms.level_terms; ++i)
        add(std::string("black level") + shape[i], model.black[i], 1.0, "gray");
    for (int i = 0; i < terms.level_terms; ++i)
        add(std::string("white level") + shape[i], model.white[i], 1.0, "gray");
    const double sigma = model.psf_sigma_px;
    if (terms.psf)  // from that of the variance: d sigma = d variance / (2 sigma)
        add("width of the blur", sigma, 0.5 / sigma, "px");
    if (terms.psf_anisotropy)
        add("variance of the blur, along x minus along y", 2.0 * model.psf_anisotropy_px2, 2.0,
            "px^2");
    if (terms.tone)
        add("tone", model.tone, 1.0, "");
    if (terms.saturation) {
        add("saturation level", model.saturation->level_gray, 1.0, "gray");
        add("saturation knee", model.saturation->knee_gray, 1.0, "gray");
    }
    return parameters;
}

std::optional<double> stated_deviation(const CameraModel& camera, const std::string& parameter) {
    if (!camera.covariance)
        return std::nullopt;
    const auto& order = camera.covariance->order;
    const auto found = std::find(order.begin(), order.end(), parameter);
    if (found == order.end())
        return std::nullopt;
    const Eigen::Index i = found - order.begin();
    return std::sqrt(camera.covariance->matrix(i, i));
}

// At the state of equations that were fitted. `photo.use` is that of pixel_uses().
PhotoFit fit_of(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                const PhotometricTerms& terms, const PhotoEquations& equations) {
    PhotoFit fit;
    fit.state = equations.state;
    fit.use = photo.use;
    fit.predicted = predicted_at(photo, camera, equations.state);
    fit.residual = photo.gray - fit.predicted;
    const bool known = camera.knows_noise();
    fit.noise_source = known ? NoiseSource::camera : NoiseSource::residuals;
    cv::Mat noise(fit.use.size(), CV_32FC1, cv::Scalar(known ? 0.0 : deviation_of_residuals(fit)));
    for (int y = 0; known && y < noise.rows; ++y)
        for (int x = 0; x < noise.cols; ++x)
            noise.at<float>(y, x) =
                static_cast<float>(camera.noise_gray(fit.predicted.at<float>(y, x)));
    fit.significance = fit.residual / noise;
    const cv::Mat scored = photo.use == pixel_scored;
    fit.noise_gray =
        cv::norm(noise, cv::NORM_L2, scored) / std::sqrt(std::max(cv::countNonZero(scored), 1));
    fit.fitted = statistics(fit, pixel_fitted);
    fit.scored = statistics(fit, pixel_scored);
    fit.parameters = fitted_parameters(fit.state.photometry, terms, equations);
    fit.state.photometry.pixels = equations.pixels;
    return fit;
}

// Levels, blur and saturation at the noise that their own residuals show.
PhotoEquations fitted_levels(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                             const PhotometricTerms& terms, const PhotoState& start) {
    constexpr int max_rounds = 3;
    constexpr double settled = 0.05;
    PhotometricSteps steps(photo, camera, terms, start);
    PhotoEquations place = approached(steps, start);
    for (int round = 0; round < max_rounds; ++round) {
        const double scale = noise_scale_of(place, camera.knows_noise());
        if (round > 0 && std::abs(scale / place.noise_scale - 1.0) < settled)
            break;
        place = steps.at(place.state, scale);
        steps.descend(place, {.first_damping = 1e-3, .enough_gain = 1e-3});
    }
    return place;
}

}  // namespace

std::vector<MatchParameter> calibration_parameters(const CameraModel& camera) {
    std::vector<MatchParameter> parameters;
    const auto add = [&](const std::string& what, double value, const std::string& unit,
                         std::optional<double> deviation = {}) {
        parameters.push_back({what, value, deviation, unit, "calibration"});
    };
    const auto add_intrinsic = [&](const std::string& what, double value, const char* unit) {
        add(what, value, unit, stated_deviation(camera, what));
    };
    constexpr std::pair<const char*, double Intrinsics::*> intrinsics[] = {
        {"fx", &Intrinsics::fx},
        {"fy", &Intrinsics::fy},
        {"cx", &Intrinsics::cx},
        {"cy", &Intrinsics::cy},
        {"skew", &Intrinsics::skew}};
    for (const auto& [name, value] : intrinsics)
        if (value != &Intrinsics::skew || camera.intrinsics.skew != 0.0)
            add_intrinsic(name, camera.intrinsics.*value, "px");
    const auto coefficients = camera.distortion.coefficients();
    for (std::size_t i = 0; i < coefficients.size(); ++i)
        if (coefficients[i] != 0.0)
            add_intrinsic(distortion_names[i], coefficients[i], "");
    const CameraUncertainty known = camera.standard_uncertainty.value_or(CameraUncertainty{});
    if (camera.lens) {
        add("f-number", camera.lens->f_number, "", known.f_number);
        add("focus distance", camera.lens->focus_distance_mm, "mm", known.focus_distance_mm);
        if (camera.lens->psf.kind == PointSpread::Kind::gaussian)
            add("width of the lens's blur", camera.lens->psf.sigma_px, "px", known.psf_sigma_px);
    }
    if (camera.sensor && camera.sensor->gain_e_per_dn > 0) {
        add("gain", camera.sensor->gain_e_per_dn, "e/DN", known.gain_e_per_dn);
        add("read noise", camera.sensor->read_noise_e, "e", known.read_noise_e);
    }
    return parameters;
}

PhotometricTerms match_terms(const PhotoOfMarker& photo, const CameraModel& camera) {
    constexpr double bright_gray = 230.0, min_share = 0.05;
    const cv::Mat fitted = photo.use == photo.fitted;
    const int bright = cv::countNonZero((photo.gray > bright_gray) & fitted);
    return {.level_terms = 6,
            .psf = !camera.lens,
            .psf_anisotropy = !camera.lens,
            .saturation = bright > min_share * cv::countNonZero(fitted)};
}

PhotoFit fit_photometry(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                        const Rigid& camera_from_marker) {
    PhotometricTerms terms = match_terms(photo, camera.model());
    terms.pose = false;
    constexpr int enough_pixels = 50'000;  // for levels and blur
    const PhotoOfMarker few = with_few_pixels(photo, enough_pixels);
    return fit_of(
        photo, camera, terms,
        fitted_levels(few, camera, terms, starting_state(few, camera, camera_from_marker, terms)));
}

PhotoMatch match_photo(const CodeImage& image, const CellGrid& marker, const ComparedArea& area,
                       const std::shared_ptr<const PhotometricCamera>& camera,
                       const Rigid& camera_from_marker, double background) {
    if (image.pixels.size() != cv::Size(camera->model().width, camera->model().height))
        throw NumericalError(fmt::format("a photograph of {} x {} px, a camera of {} x {}",
                                         image.pixels.cols, image.pixels.rows,
                                         camera->model().width, camera->model().height));
    const cv::Mat use = pixel_uses(camera->projector(), camera_from_marker, area);
    if (cv::countNonZero(use) == 0)
        throw NumericalError("no part of the marker is inside the image");
    const PhotoOfMarker photo{gray_of(image), marker, use, pixel_fitted, background};

    PhotoMatch match;
    match.calibration = calibration_parameters(camera->model());
    match.calibrated = fit_photometry(photo, *camera, camera_from_marker);
    const PhotometricTerms terms = match_terms(photo, camera->model());
    const PhotoOfMarker few = with_few_flats(photo, *camera, camera_from_marker);
    match.pose = photometric_pose(few, camera, match.calibrated.state, terms);
    const PhotoState refined{match.pose.camera_from_marker, match.pose.photometry};
    match.refined =
        fit_of(photo, *camera, terms,
               photo_equations(few, *camera, refined, terms, {}, match.pose.noise_scale));
    return match;
}

}  // namespace etalon
