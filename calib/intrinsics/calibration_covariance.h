// The covariance of calibrated parameters (docs/calibration.md). The usual one is too small on
// photographs, because the errors of one photo share its blur, light, JPEG blocks and board.
//
//  formal          variance of the residuals times the inverse information: independent points.
//  cluster-robust  what the residuals of each view, taken together, did to the parameters: the
//                  sandwich of Liang and Zeger (Biometrika 73, 1986) with views as clusters,
//                  unbiased for few of them (CR2: Bell and McCaffrey, Survey Methodology 28, 2002).
//  bootstrap       the scatter of calibrations of views drawn from these with replacement (Efron,
//                  1979); no linearisation.
//  stated          where the formal covariance is the identity, the cluster-robust one drawn
//                  towards a multiple of it (core/statistics/covariance.h: cluster_robust_factor).
//
// Cluster-robust and bootstrap need many independent views: of n a standard deviation is uncertain
// by about 1 / sqrt(2 (n - 1)); of fewer views than parameters some combinations only look certain.
#pragma once

#include <stop_token>

#include "calib/intrinsics/camera_fit.h"

namespace etalon {

// One standard deviation of a parameter, four ways.
struct ParameterDeviation {
    std::string name;  // "fx"
    double formal = 0.0;
    double cluster_robust = 0.0;
    std::optional<double> bootstrap;
    double stated = 0.0;

    // Stated over formal; 1 when both are zero.
    double ratio() const;
};

// In the order of the model's parameters.
struct CalibrationCovariances {
    Eigen::MatrixXd formal, cluster_robust, stated;
    std::optional<Eigen::MatrixXd> bootstrap = std::nullopt;
};

// Without the bootstrap. Throws NumericalError when the views do not determine the parameters.
CalibrationCovariances covariances_of(std::span<const ViewEquations> equations,
                                      const CalibrationModel& model, double variance);
std::vector<ParameterDeviation> deviations_of(const CalibrationModel& model,
                                              const CalibrationCovariances& covariances);

struct Bootstrap {
    std::vector<Eigen::VectorXd> parameters;  // of each resample that has a calibration
    int without_result = 0;                   // resamples that did not determine the camera

    Eigen::MatrixXd covariance(std::size_t views) const;
};

inline constexpr int bootstrap_resamples = 400;  // sd uncertain by 1 / sqrt(2 * 399) = 3.5 %
inline constexpr std::size_t min_bootstrap_views = 6;

// `fit` is of all views and starts every search. Resamples with less than three different views are
// drawn again. A stop throws Interrupted. 0.5 s for 13 views of 54 points; on all cores, same
// result for any number.
Bootstrap bootstrap_calibrations(std::span<const CalibrationView> views, const CameraFit& fit,
                                 int resamples = bootstrap_resamples, std::uint64_t seed = 1,
                                 const std::stop_token& stop = {});

// Whether views determine the camera that was fitted to them well enough to be used at all.

// Throws NumericalError, naming what is weak, for a lost rank and a focal length that noise (0.1
// px, or the fit's) makes uncertain by a tenth. A telecentric lens also needs views tilted by more
// than hardly_tilted_rad about several axes (fx and fy to a hundredth), and a distortion that tells
// its centre to half the image. `equations` are the fit's.
void check_identifiability(std::span<const CalibrationView> views, const CameraFit& fit,
                           std::span<const ViewEquations> equations);

// 95 % intervals where a standard deviation does not say enough: with a parameter held at an end
// and all else fitted again, the sum of squares is what Student's distribution allows above the
// least (profile t: Bates and Watts, "Nonlinear Regression Analysis and Its Applications", 1988,
// 6.1).
//
// Focal length, xi and distortion of an omnidirectional lens trade for each other: two deviations
// hold the truth in 90 % of calibrations, the profile's interval in 95 %.

struct ProfileInterval {
    double low = 0.0, high = 0.0;
};

// An interval is skewed whose ends differ in distance by more than this share of its length.
inline constexpr double skewed_interval_share = 0.1;

// Student's: an interval reaches so many deviations to both sides where a parameter acts linearly.
double profile_quantile(std::span<const CalibrationView> views, const CalibrationModel& model);

// In the order of the model's parameters. `deviations` are the stated ones; where photos share
// errors they exceed the formal ones, and so does the rise allowed. Nothing for a parameter without
// ends in reach, and for all of a fit with a pull or without residuals. Two or three fits an end,
// on all cores, with the same result for any number of them.
std::vector<std::optional<ProfileInterval>> profile_intervals(
    std::span<const CalibrationView> views, const CameraFit& fit,
    const Eigen::VectorXd& deviations);

}  // namespace etalon
