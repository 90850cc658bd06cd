// The covariance of calibrated parameters, three ways, because the usual one is too small on
// photographs: it takes the errors of all points for independent, but those of one photo share its
// blur, its light, its JPEG blocks and the bend of the board.
//
//  formal          variance of the residuals times the inverse information. Only this one assumes
//                  independent points.
//  cluster-robust  what the residuals of each view, taken together, did to the parameters: the
//                  sandwich of Liang and Zeger (Biometrika 73, 1986) with views as clusters,
//                  unbiased for few of them (CR2: Bell and McCaffrey, Survey Methodology 28, 2002).
//  bootstrap       the scatter of calibrations of views that were drawn from these with
//                  replacement (Efron, 1979); no linearisation.
//
// The two latter assume that views are independent, and need many of them to be exact themselves:
// of n views a standard deviation is uncertain by about 1 / sqrt(2 (n - 1)), 20 % for 13.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/intrinsics/calibration_view.h"
#include "calib/intrinsics/camera_fit.h"

namespace etalon {

// One standard deviation of a parameter, three ways.
struct ParameterDeviation {
    std::string name;  // "fx"
    double formal = 0.0;
    double cluster_robust = 0.0;
    std::optional<double> bootstrap;

    double largest() const;
    // Largest over formal; 1 when all are zero.
    double ratio() const;
};

// All of them have the order of the model's parameters. Throw NumericalError when the views do not
// determine the parameters.
Eigen::MatrixXd formal_covariance(std::span<const ViewEquations> equations,
                                  const CalibrationModel& model, double variance);
Eigen::MatrixXd cluster_robust_covariance(std::span<const ViewEquations> equations,
                                          const CalibrationModel& model);

struct Bootstrap {
    std::vector<Eigen::VectorXd> parameters;  // of each resample that has a calibration
    int without_result = 0;                   // resamples that did not determine the camera

    Eigen::MatrixXd covariance(std::size_t views) const;
};

inline constexpr int bootstrap_resamples = 400;  // sd uncertain by 1 / sqrt(2 * 399) = 3.5 %
inline constexpr std::size_t min_bootstrap_views = 6;

// `fit` is that of all views and the start of every search. Resamples with less than three
// different views are drawn again. Some 0.5 s for 13 views of 54 points; on all cores, with the
// same result for any number of them.
Bootstrap bootstrap_calibrations(std::span<const CalibrationView> views, cv::Size image_size,
                                 const CalibrationModel& model, const CameraFit& fit,
                                 int resamples = bootstrap_resamples, std::uint64_t seed = 1);

// The correlations of the formal covariance with the largest of the deviations.
Eigen::MatrixXd with_largest_deviations(const Eigen::MatrixXd& formal,
                                        std::span<const ParameterDeviation> deviations);

}  // namespace etalon
