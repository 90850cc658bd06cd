#include <gtest/gtest.h>

#include "tests/calib/synthetic_views.h"

namespace etalon {
namespace {

// n calibrations of the same views with independent noise of 0.3 px. An estimated standard
// deviation from n = 60 has the relative standard error 1/sqrt(2 (n - 1)) = 0.092; the formal one
// varies with the residuals' variance, by 1/sqrt(2 * 783) = 0.025. Four of both together: 0.38.
TEST(CalibrateStatistics, FormalDeviationsAreWhatIndependentNoiseDoes) {
    const int n = 60;
    const CameraModel truth = test::calibration_truth();
    Eigen::Matrix<double, 9, 1> sum, squares, formal;
    sum.setZero();
    squares.setZero();
    formal.setZero();
    double mean_squares = 0.0;
    for (int run = 0; run < n; ++run) {
        const auto calibration =
            calibrate_camera(test::synthetic_views(truth, 8, 0.3, 100 + run), {640, 480},
                             {.model = "standard", .leave_one_out = false, .resamples = 0});
        const Intrinsics& i = calibration.camera.intrinsics;
        const Distortion& d = calibration.camera.distortion;
        Eigen::Matrix<double, 9, 1> x;
        x << i.fx, i.fy, i.cx, i.cy, d.k1, d.k2, d.p1, d.p2, d.k3;
        sum += x;
        squares += x.cwiseAbs2();
        for (int p = 0; p < 9; ++p)
            formal[p] += calibration.deviations[p].formal / n;
        mean_squares += calibration.rms_px * calibration.rms_px / n;
    }
    const Eigen::Matrix<double, 9, 1> variance = (squares - sum.cwiseAbs2() / n) / (n - 1);
    for (int p = 0; p < 9; ++p)
        EXPECT_NEAR(std::sqrt(variance[p]) / formal[p], 1.0, 0.38) << p;
    // 864 residuals less 57 parameters, over 432 points: 0.09 * 807 / 432. Relative standard error
    // sqrt(2 / (807 * 60)) = 0.0064, four of it.
    EXPECT_NEAR(mean_squares, 0.09 * 807 / 432, 0.09 * 807 / 432 * 0.026);
}

// A photo whose corners err together, by a bend that no pose takes back: up to 0.4 px at 100 mm
// from the board's middle, of another size in each photo.
void bend(CalibrationView& view, RandomStream& random) {
    const double across = 0.4 * random.normal(), down = 0.4 * random.normal();
    for (std::size_t i = 0; i < view.pixels.size(); ++i) {
        const double x = (view.points_mm[i].x() - 100) / 100, y = (view.points_mm[i].y() - 62) / 62;
        view.pixels[i] += Eigen::Vector2d(across * x * x * y, down * y * y * x);
    }
}

// Of 150 runs the scatter's variance has a relative standard error of sqrt(2 / 149) = 0.116; the
// mean of the robust variances of 10 views has a smaller one. 3.5 of both: 0.5. The correction for
// few views is exact for independent points only.
TEST(CalibrateStatistics, RobustDeviationsAreWhatPhotosDoWhoseCornersErrTogether) {
    const int n = 150;
    const CalibrationModel& model = calibration_model("radial");
    CameraModel truth = test::calibration_truth();
    truth.distortion = {.k1 = -0.27, .k2 = 0.09};
    Eigen::Matrix<double, 6, 1> sum, squares, robust, formal;
    for (auto* each : {&sum, &squares, &robust, &formal})
        each->setZero();
    for (int run = 0; run < n; ++run) {
        auto views = test::synthetic_views(truth, 10, 0.1, 4000 + run);
        RandomStream random(5000 + run, 3);
        for (CalibrationView& view : views)
            bend(view, random);
        const CameraFit fit = fit_camera(views, {640, 480}, model);
        const auto covariances = covariances_of(view_equations(views, fit), model, fit.variance);
        const Eigen::VectorXd found = parameters_of(fit.camera, model);
        sum += found;
        squares += found.cwiseAbs2();
        robust += covariances.cluster_robust.diagonal() / n;
        formal += covariances.formal.diagonal() / n;
    }
    const Eigen::Matrix<double, 6, 1> variance = (squares - sum.cwiseAbs2() / n) / (n - 1);
    for (int p = 0; p < 6; ++p)
        EXPECT_NEAR(robust[p] / variance[p], 1.0, 0.5) << model.parameters[p];
    EXPECT_LT(formal.cwiseQuotient(variance).minCoeff(), 0.6);
}

}  // namespace
}  // namespace etalon
