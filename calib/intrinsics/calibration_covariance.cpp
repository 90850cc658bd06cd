#include "calib/intrinsics/calibration_covariance.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "core/program/errors.h"
#include "core/statistics/covariance.h"
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

// What the residuals of each view did to the parameters, a column each, in units of the root G of
// the inverse information: with the view's own equations T d = z its leverage is T G G^T T^T and
// its effect G^T T^T (I - leverage)^(-1/2) z.
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
                                         cv::Size image_size, const CalibrationModel& model,
                                         const CameraFit& fit, const Multiplicities& counts) {
    std::vector<CalibrationView> drawn;
    CameraStart start{fit.camera, {}};
    for (std::size_t i = 0; i < views.size(); ++i) {
        if (counts[i] == 0)
            continue;
        drawn.push_back(weighted(views[i], counts[i]));
        start.camera_from_target.push_back(fit.camera_from_target[i]);
    }
    return attempted([&] {
               return parameters_of(fit_camera(drawn, image_size, model, {.start = start}).camera,
                                    model);
           })
        .value;
}

}  // namespace

double ParameterDeviation::ratio() const {
    return formal > 0.0 ? stated / formal : 1.0;
}

Eigen::MatrixXd formal_covariance(std::span<const ViewEquations> equations,
                                  const CalibrationModel& model, double variance) {
    return variance * inverse_information(equations, model);
}

Eigen::MatrixXd cluster_robust_covariance(std::span<const ViewEquations> equations,
                                          const CalibrationModel& model) {
    const Eigen::MatrixXd root = inverse_information_root(equations, model);
    const Eigen::MatrixXd effects = root * view_effects(equations, root);
    return effects * effects.transpose();
}

Eigen::MatrixXd stated_covariance(std::span<const ViewEquations> equations,
                                  const CalibrationModel& model, double variance) {
    const Eigen::MatrixXd root = inverse_information_root(equations, model);
    if (!(variance > 0.0))
        return Eigen::MatrixXd::Zero(root.rows(), root.rows());
    return variance * root * excess_scatter(view_effects(equations, root) / std::sqrt(variance)) *
           root.transpose();
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

Bootstrap bootstrap_calibrations(std::span<const CalibrationView> views, cv::Size image_size,
                                 const CalibrationModel& model, const CameraFit& fit, int resamples,
                                 std::uint64_t seed) {
    std::vector<std::optional<Eigen::VectorXd>> all(static_cast<std::size_t>(resamples));
    cv::parallel_for_(cv::Range(0, resamples), [&](const cv::Range& range) {
        for (int i = range.start; i < range.end; ++i)
            all[static_cast<std::size_t>(i)] =
                resampled(views, image_size, model, fit, drawn_views(views.size(), seed, i));
    });
    Bootstrap bootstrap;
    for (const auto& each : all)
        if (each)
            bootstrap.parameters.push_back(*each);
        else
            ++bootstrap.without_result;
    return bootstrap;
}

}  // namespace etalon
