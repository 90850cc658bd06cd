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

}  // namespace
}  // namespace etalon
