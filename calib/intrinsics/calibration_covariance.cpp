#include "calib/intrinsics/calibration_covariance.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>

#include "calib/intrinsics/calibration_start.h"
#include "core/program/errors.h"
#include "core/statistics/covariance.h"
#include "core/statistics/distributions.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

// (I - H)^(-1/2) of a view's leverage H. Where the view alone decides (leverage 1) its residual is
// zero whatever its error: such directions say nothing of the error and are left out.
Eigen::MatrixXd leverage_correction(const Eigen::MatrixXd& leverage) {
    constexpr double least = 1e-9;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(leverage);
    Eigen::VectorXd factors(leverage.rows());
    for (Eigen::Index i = 0; i < factors.size(); ++i) {
        const double left = 1.0 - eigen.eigenvalues()[i];
        factors[i] = left > least ? 1.0 / std::sqrt(left) : 0.0;
    }
    return eigen.eigenvectors() * factors.asDiagonal() * eigen.eigenvectors().transpose();
}

// A column for each view, in units of the root G of the inverse information: with the view's
// equations T d = z its leverage is T G G^T T^T, its effect G^T T^T (I - leverage)^(-1/2) z.
Eigen::MatrixXd view_effects(std::span<const ViewEquations> equations,
                             const Eigen::MatrixXd& root) {
    Eigen::MatrixXd effects(root.cols(), std::ssize(equations));
    for (Eigen::Index i = 0; i < effects.cols(); ++i) {
        const ViewEquations& view = equations[static_cast<std::size_t>(i)];
        const Eigen::MatrixXd seen = view.triangle * root;
        effects.col(i) =
            seen.transpose() * (leverage_correction(seen * seen.transpose()) * view.rhs);
    }
    return effects;
}

using Multiplicities = std::vector<int>;

// How often each of n views comes up in n draws with replacement.
Multiplicities drawn_views(std::size_t n, std::uint64_t seed, int resample) {
    constexpr std::uint32_t stream = 1;
    constexpr int min_different = 3;
    RandomStream random(seed, stream, static_cast<std::uint64_t>(resample));
    for (;;) {
        Multiplicities counts(n, 0);
        for (std::size_t draw = 0; draw < n; ++draw)
            ++counts[static_cast<std::size_t>(random.uniform() * static_cast<double>(n))];
        if (std::count_if(counts.begin(), counts.end(), [](int count) { return count > 0; }) >=
            min_different)
            return counts;
    }
}

// A view that was drawn m times weighs m times as much.
CalibrationView weighted(CalibrationView view, int times) {
    if (view.sigma_px.empty())
        view.sigma_px.assign(view.pixels.size(), 1.0);
    for (double& sigma : view.sigma_px)
        sigma /= std::sqrt(static_cast<double>(times));
    return view;
}

std::optional<Eigen::VectorXd> resampled(std::span<const CalibrationView> views,
                                         const CameraFit& fit, const Multiplicities& counts) {
    std::vector<CalibrationView> drawn;
    std::vector<Rigid> poses;
    for (std::size_t i = 0; i < views.size(); ++i) {
        if (counts[i] == 0)
            continue;
        drawn.push_back(weighted(views[i], counts[i]));
        poses.push_back(fit.camera_from_target[i]);
    }
    return attempted([&] {
               return parameters_of(refit_camera(drawn, fit, std::move(poses)).camera, fit.model);
           })
        .value;
}

// The pixels' sigma that the mean weight belongs to.
double typical_sigma(std::span<const CalibrationView> views) {
    double weights = 0.0;
    for (const CalibrationView& view : views)
        for (std::size_t i = 0; i < view.pixels.size(); ++i)
            weights += 1.0 / (view.sigma(i) * view.sigma(i));
    return std::sqrt(static_cast<double>(point_count(views)) / weights);
}

// Exact views of bad geometry have no residuals to tell of it: pixels are taken to be no better
// than 0.1 px.
double noise_of(std::span<const CalibrationView> views, const CameraFit& fit) {
    constexpr double min_noise_px = 0.1;
    return std::max(std::sqrt(fit.variance), min_noise_px / typical_sigma(views));
}

bool frees(const CalibrationModel& model, std::string_view parameter) {
    return std::ranges::find(model.parameters, parameter) != model.parameters.end();
}

// A plane tells the magnification along the axis it is tilted about: cos^2 of fx's and sin^2 of
// fy's relative change. Where all tell nearly the same, the rest is noise in the axes' directions.
// A tilt of a few degrees may be the camera's above a table, common to all views.
void check_tilts(const CameraFit& fit, std::span<const ViewEquations> equations, double noise) {
    constexpr double max_share = 0.01, least_ratio = 0.01;
    Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
    for (std::size_t v = 0; v < equations.size(); ++v) {
        const auto columns = equations[v].triangle.leftCols<2>();
        if (tilt_rad(fit.camera_from_target[v].rotation) > hardly_tilted_rad)
            information += columns.transpose() * columns;
    }
    const Intrinsics& i = fit.camera.intrinsics;
    const Eigen::Matrix2d of_shares = Eigen::Vector2d(i.fx, i.fy).asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(
        Eigen::MatrixXd(of_shares * information * of_shares));
    const double least = eigen.eigenvalues()[0], most = eigen.eigenvalues()[1];
    if (!(least > least_ratio * most && least * max_share * max_share > noise * noise))
        throw NumericalError(
            "these views do not tell fy / fx of a telecentric camera: planes are needed that are "
            "tilted by 15 degrees or more, about the image's rows and about its columns");
}

void check_focal_length(const std::string& name, double value, double deviation,
                        std::span<const ViewEquations> equations, const CalibrationModel& model) {
    constexpr double max_share = 0.1;
    if (!(deviation < max_share * value))
        throw NumericalError(
            fmt::format("these views do not determine the focal length: {} {:.5g} with a standard "
                        "deviation of {:.2g} px; views of different tilt are needed, weakest is {}",
                        name, value, deviation, weakest_direction(equations, model).combination));
}

// Without distortion its centre is nowhere, whatever noise makes of it.
void check_centre(const std::string& name, double deviation, const CameraFit& fit) {
    if (!(deviation < 0.5 * std::max(fit.camera.width, fit.camera.height)))
        throw NumericalError(fmt::format(
            "these views do not determine the centre of the distortion: {} has a standard "
            "deviation of {:.2g} px; the distortion is too weak for model {}",
            name, deviation, fit.model.name));
}

// The least sum of squares over all parameters but one, which is held.
class Profile {
public:
    Profile(std::span<const CalibrationView> views, const CameraFit& fit)
        : views_(views),
          fit_(fit),
          least_squares_(weighted_squares(views, fit)),
          covariance_(fit.variance * inverse_information(view_equations(views, fit), fit.model)) {}

    // From where the profile t is -t to where it is t. `linear` is how far that is from the value
    // where the parameter acts linearly.
    std::optional<ProfileInterval> interval(Eigen::Index parameter, double t, double linear) const {
        const double value = parameters_of(fit_.camera, fit_.model)[parameter];
        const auto low = way(parameter, t, -linear), high = way(parameter, t, linear);
        if (!low || !high)
            return std::nullopt;
        return ProfileInterval{value + *low, value + *high};
    }
    double formal_deviation(Eigen::Index parameter) const {
        return std::sqrt(covariance_(parameter, parameter));
    }

private:
    // From the value to where the profile t is `t`: secants through the value until that is passed,
    // then between the ends; halfway back from where there is no fit.
    std::optional<double> way(Eigen::Index parameter, double t, double first) const {
        constexpr int most_steps = 15;
        constexpr double settled = 0.01, longest_stride = 2.0;
        double near = 0.0, near_t = 0.0, way = first;
        std::optional<double> far, far_t;
        for (int step = 0; step < most_steps; ++step) {
            const auto reached = t_at(parameter, way);
            if (reached && std::abs(*reached - t) < settled * t)
                return way;
            const bool is_passed = !reached || *reached > t;
            if (is_passed) {
                far = way;
                far_t = reached;
            } else {
                near = way;
                near_t = *reached;
            }
            if (far_t)
                way = near + (*far - near) * (t - near_t) / (*far_t - near_t);
            else if (far)
                way = 0.5 * (near + *far);
            else
                way *= std::min(t / near_t, longest_stride);
        }
        return std::nullopt;
    }

    // Started where the others would be if all were linear.
    std::optional<double> t_at(Eigen::Index parameter, double way) const {
        CameraFit held = fit_;
        held.model.parameters.erase(held.model.parameters.begin() + parameter);
        set_parameters(held.camera, fit_.model,
                       parameters_of(fit_.camera, fit_.model) +
                           covariance_.col(parameter) * (way / covariance_(parameter, parameter)));
        const auto fit =
            attempted([&] { return refit_camera(views_, held, fit_.camera_from_target); });
        if (!fit || !fit.value->converged)
            return std::nullopt;
        return std::sqrt((weighted_squares(views_, *fit.value) - least_squares_) / fit_.variance);
    }

    std::span<const CalibrationView> views_;
    const CameraFit& fit_;
    double least_squares_;
    Eigen::MatrixXd covariance_;
};

}  // namespace

double ParameterDeviation::ratio() const {
    return formal > 0.0 ? stated / formal : 1.0;
}

CalibrationCovariances covariances_of(std::span<const ViewEquations> equations,
                                      const CalibrationModel& model, double variance) {
    const Eigen::MatrixXd root = inverse_information_root(equations, model);
    const Eigen::MatrixXd effects = view_effects(equations, root), moved = root * effects;
    Eigen::MatrixXd stated = Eigen::MatrixXd::Zero(root.rows(), root.rows());
    if (variance > 0.0)
        stated = variance * root * cluster_robust_factor(effects / std::sqrt(variance)) *
                 root.transpose();
    return {variance * (root * root.transpose()), moved * moved.transpose(), stated};
}

std::vector<ParameterDeviation> deviations_of(const CalibrationModel& model,
                                              const CalibrationCovariances& covariances) {
    std::vector<ParameterDeviation> deviations;
    for (std::size_t p = 0; p < model.parameters.size(); ++p) {
        const auto i = static_cast<Eigen::Index>(p);
        const auto of = [&](const Eigen::MatrixXd& each) { return std::sqrt(each(i, i)); };
        deviations.push_back({model.parameters[p], of(covariances.formal),
                              of(covariances.cluster_robust), std::nullopt,
                              of(covariances.stated)});
        if (covariances.bootstrap)
            deviations.back().bootstrap = of(*covariances.bootstrap);
    }
    return deviations;
}

// The factor takes out that draws scatter about the mean of n views, not about the truth.
Eigen::MatrixXd Bootstrap::covariance(std::size_t views) const {
    const Eigen::Index size = parameters.empty() ? 0 : parameters.front().size();
    const double draws = static_cast<double>(parameters.size()), n = static_cast<double>(views);
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(size);
    for (const Eigen::VectorXd& each : parameters)
        mean += each / draws;
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(size, size);
    for (const Eigen::VectorXd& each : parameters)
        sum += (each - mean) * (each - mean).transpose();
    return n / (n - 1.0) / (draws - 1.0) * sum;
}

Bootstrap bootstrap_calibrations(std::span<const CalibrationView> views, const CameraFit& fit,
                                 int resamples, std::uint64_t seed, const std::stop_token& stop) {
    std::vector<std::optional<Eigen::VectorXd>> all(static_cast<std::size_t>(resamples));
    cv::parallel_for_(cv::Range(0, resamples), [&](const cv::Range& range) {
        for (int i = range.start; i < range.end; ++i) {
            throw_if_stopped(stop);
            all[static_cast<std::size_t>(i)] =
                resampled(views, fit, drawn_views(views.size(), seed, i));
        }
    });
    Bootstrap bootstrap;
    for (const auto& each : all)
        if (each)
            bootstrap.parameters.push_back(*each);
        else
            ++bootstrap.without_result;
    return bootstrap;
}

void check_identifiability(std::span<const CalibrationView> views, const CameraFit& fit,
                           std::span<const ViewEquations> equations) {
    const CalibrationModel& model = fit.model;
    const double noise = noise_of(views, fit);
    const bool is_telecentric = model.projection == Projection::telecentric;
    if (is_telecentric && frees(model, "fx") && frees(model, "fy"))
        check_tilts(fit, equations, noise);
    const Eigen::MatrixXd inverse = inverse_information(equations, model);
    const Eigen::VectorXd values = parameters_of(fit.camera, model);
    for (Eigen::Index i = 0; i < values.size(); ++i) {
        const std::string& name = model.parameters[static_cast<std::size_t>(i)];
        const double deviation = noise * std::sqrt(inverse(i, i));
        if (name == "fx" || name == "fy")
            check_focal_length(name, values[i], deviation, equations, model);
        else if (is_telecentric && (name == "cx" || name == "cy"))
            check_centre(name, deviation, fit);
    }
}

double profile_quantile(std::span<const CalibrationView> views, const CalibrationModel& model) {
    const int freedom = static_cast<int>(2 * point_count(views) - model.parameters.size()) -
                        pose_parameters(model.projection) * static_cast<int>(views.size());
    return student_t_quantile(0.025, freedom);
}

std::vector<std::optional<ProfileInterval>> profile_intervals(
    std::span<const CalibrationView> views, const CameraFit& fit,
    const Eigen::VectorXd& deviations) {
    std::vector<std::optional<ProfileInterval>> intervals(fit.model.parameters.size());
    if (!(fit.variance > 0.0) || !fit.pull.isZero())
        return intervals;
    const Profile profile(views, fit);
    const double quantile = profile_quantile(views, fit.model);
    cv::parallel_for_(
        cv::Range(0, static_cast<int>(intervals.size())), [&](const cv::Range& range) {
            for (int i = range.start; i < range.end; ++i)
                intervals[static_cast<std::size_t>(i)] =
                    profile.interval(i, quantile * deviations[i] / profile.formal_deviation(i),
                                     quantile * deviations[i]);
        });
    return intervals;
}

}  // namespace etalon
