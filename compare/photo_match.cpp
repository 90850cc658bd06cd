#include "compare/photo_match.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>

#include "compare/photometric_adjustment.h"
#include "core/errors.h"

namespace etalon {
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

void add_levels(const std::string& what, const Vector6d& values, const Eigen::VectorXd& variances,
                std::vector<MatchParameter>& parameters) {
    constexpr const char* shape[] = {"",         ", along x", ", along y",
                                     ", by x^2", ", by x y",  ", by y^2"};
    for (Eigen::Index i = 0; i < variances.size(); ++i)
        parameters.push_back({what + shape[i], values[i], std::sqrt(variances[i]), "gray", {}});
}

// In the equations' order.
std::vector<MatchParameter> fitted_parameters(const PhotometricModel& model,
                                              const PhotometricTerms& terms,
                                              const PhotoEquations& equations) {
    const Eigen::VectorXd variances = photometric_variances(equations, terms);
    std::vector<MatchParameter> parameters;
    const int n = terms.level_terms;
    add_levels("black level", model.black, variances.head(n), parameters);
    add_levels("white level", model.white, variances.segment(n, n), parameters);
    for (MatchParameter& parameter : parameters)
        parameter.source = ParameterSource::this_image;
    int at = 2 * n;
    const auto add = [&](const std::string& what, double value, double by_parameter,
                         const std::string& unit) {
        parameters.push_back({what, value, by_parameter * std::sqrt(variances[at++]), unit,
                              ParameterSource::this_image});
    };
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

PhotoFit fit_at(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                const PhotoState& state, const PhotometricTerms& terms, double noise_scale) {
    const PhotoEquations equations = photo_equations(photo, camera, state, terms, {}, noise_scale);
    return {state, difference_at(photo, camera, state),
            fitted_parameters(state.photometry, terms, equations)};
}

}  // namespace

const char* name(ParameterSource source) {
    return source == ParameterSource::calibration ? "calibration" : "this image";
}

PhotometricTerms match_terms(const CameraModel& camera) {
    return {
        .level_terms = 6, .psf = !camera.lens, .psf_anisotropy = !camera.lens, .saturation = true};
}

PhotoMatch match_photo(const CodeImage& image, const CellGrid& marker, const ComparedArea& area,
                       const std::shared_ptr<const PhotometricCamera>& camera,
                       const Rigid& camera_from_marker, double background) {
    const cv::Mat use = pixel_uses(camera->projector(), camera_from_marker, area);
    if (cv::countNonZero(use) == 0)
        throw NumericalError("no part of the marker is inside the image");
    const PhotoOfMarker photo{gray_of(image), marker, use, pixel_fitted, background};

    PhotometricTerms levels_only = match_terms(camera->model());
    levels_only.pose = false;
    const PhotoState start = starting_state(photo, *camera, camera_from_marker, levels_only);
    const PhotometricAdjustment held =
        adjust_to_photos({&photo, 1}, camera, {&start, 1}, levels_only, {});

    const PhotometricTerms terms = match_terms(camera->model());
    PhotoMatch match;
    match.calibrated =
        fit_at(photo, *camera, held.photos.front(), levels_only, held.noise_scales.front());
    match.pose = photometric_pose(photo, camera, held.photos.front(), terms);
    match.refined = fit_at(photo, *camera, {match.pose.camera_from_marker, match.pose.photometry},
                           terms, match.pose.noise_scale);
    return match;
}

}  // namespace etalon
