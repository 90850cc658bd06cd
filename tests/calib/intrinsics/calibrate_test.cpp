#include "calib/intrinsics/calibrate.h"

#include <opencv2/calib3d.hpp>

#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

const CalibrationOptions quick{.leave_one_out = false, .resamples = 0};

std::string error_of(const std::vector<CalibrationView>& views) {
    return text_of_error<NumericalError>([&] { calibrate_camera(views, test::image_size, quick); });
}

// OpenCV takes single precision pixels: 3e-5 px of rounding at 500 px.
TEST(Calibrate, FindsTheCameraThatMadeTheViews) {
    const CameraModel truth = test::calibration_truth();
    const auto calibration =
        calibrate_camera(test::synthetic_views(truth, 7, 0.0, 1), test::image_size,
                         {.model = "standard", .resamples = 0});
    const CameraModel& found = calibration.camera;
    EXPECT_EQ(found.width, 640);
    EXPECT_EQ(found.height, 480);
    EXPECT_NEAR(found.intrinsics.fx, truth.intrinsics.fx, 1e-3);
    EXPECT_NEAR(found.intrinsics.fy, truth.intrinsics.fy, 1e-3);
    EXPECT_NEAR(found.intrinsics.cx, truth.intrinsics.cx, 1e-3);
    EXPECT_NEAR(found.intrinsics.cy, truth.intrinsics.cy, 1e-3);
    EXPECT_NEAR(found.distortion.k1, truth.distortion.k1, 1e-4);
    EXPECT_NEAR(found.distortion.p1, truth.distortion.p1, 1e-6);
    EXPECT_NEAR(found.distortion.p2, truth.distortion.p2, 1e-6);
    EXPECT_LT(calibration.rms_px, 1e-4);
    EXPECT_LT(*calibration.leave_one_out_rms_px, 2e-4);
    ASSERT_EQ(calibration.views.size(), 7u);
    for (int i = 0; i < 7; ++i)
        EXPECT_LT(left_difference(*calibration.views[i].camera_from_target, test::synthetic_pose(i))
                      .norm(),
                  2e-3)
            << i;
}

// OpenCV's own standard deviations, from Jacobians of its own. It divides the squared residuals by
// points - parameters, where each point gives two residuals: undone here.
TEST(Calibrate, FormalDeviationsAreOpenCvsWithResidualsCountedInXAndY) {
    const auto views = test::synthetic_views(test::calibration_truth(), 8, 0.3, 5);
    const auto calibration = calibrate_camera(views, test::image_size, quick);
    const auto [points, pixels] = test::opencv_views(views);
    const double count = 8 * 54;
    cv::Mat k, d, r, t, of_intrinsics, of_extrinsics, per_view;
    const double rms = cv::calibrateCamera(points, pixels, test::image_size, k, d, r, t,
                                           of_intrinsics, of_extrinsics, per_view);
    const double parameters = 9 + 6 * 8;
    const double factor = std::sqrt((count - parameters) / (2 * count - parameters));
    ASSERT_EQ(calibration.deviations.size(), 9u);
    for (int i = 0; i < 9; ++i)
        EXPECT_NEAR(calibration.deviations[i].formal / (factor * of_intrinsics.at<double>(i)), 1.0,
                    1e-3)
            << calibration.deviations[i].name;
    EXPECT_NEAR(calibration.rms_px, rms, 1e-6);
    for (int i = 0; i < 8; ++i)
        EXPECT_NEAR(calibration.views[i].rms_px, per_view.at<double>(i), 1e-5);
}

TEST(Calibrate, CameraFileStatesTheCovarianceThatIsReported) {
    const auto views = test::synthetic_views(test::calibration_truth(), 6, 0.3, 3);
    const auto calibration =
        calibrate_camera(views, test::image_size, {.model = "standard", .leave_one_out = false});
    const ParameterCovariance& covariance = *calibration.camera.covariance;
    EXPECT_EQ(covariance.order,
              (std::vector<std::string>{"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"}));
    for (int i = 0; i < 9; ++i) {
        const ParameterDeviation& deviation = calibration.deviations[i];
        EXPECT_EQ(deviation.name, covariance.order[i]);
        EXPECT_NEAR(std::sqrt(covariance.matrix(i, i)), deviation.stated, 1e-9 * deviation.stated);
        EXPECT_GT(deviation.cluster_robust, 0.0);
        EXPECT_NEAR(deviation.formal, std::sqrt(calibration.covariances.formal(i, i)), 1e-12);
    }
    EXPECT_LT((covariance.matrix - covariance.matrix.transpose()).norm(),
              1e-12 * covariance.matrix.norm());
}

// The left-out residual of a view with a gross error shows it; the other views' fit absorbs little.
TEST(Calibrate, LeavingAViewOutExposesTheOneThatIsWrong) {
    auto views = test::synthetic_views(test::calibration_truth(), 7, 0.2, 9);
    for (std::size_t i = 0; i < views[4].pixels.size(); i += 2)
        views[4].pixels[i].x() += 0.9;  // short of an outlier
    const auto calibration =
        calibrate_camera(views, test::image_size, {.model = "radial", .resamples = 0});
    EXPECT_EQ(calibration.points_left_out(), 0u);
    for (std::size_t i = 0; i < views.size(); ++i) {
        const CalibratedView& view = calibration.views[i];
        EXPECT_GE(*view.left_out_rms_px, view.rms_px);
        if (i == 4)
            continue;
        EXPECT_LT(*view.left_out_rms_px, *calibration.views[4].left_out_rms_px / 1.4) << i;
    }
}

TEST(Calibrate, GivesTheSameBitsForEveryNumberOfThreads) {
    const auto views = test::synthetic_views(test::calibration_truth(), 6, 0.2, 7);
    const int before = cv::getNumThreads();
    const CalibrationOptions options{.resamples = 10};
    cv::setNumThreads(1);
    const auto one = calibrate_camera(views, test::image_size, options);
    cv::setNumThreads(3);
    const auto three = calibrate_camera(views, test::image_size, options);
    cv::setNumThreads(before);
    EXPECT_EQ(one.camera.intrinsics.fx, three.camera.intrinsics.fx);
    EXPECT_EQ(one.camera.covariance->matrix, three.camera.covariance->matrix);
    EXPECT_EQ(*one.leave_one_out_rms_px, *three.leave_one_out_rms_px);
    EXPECT_EQ(*one.covariances.bootstrap, *three.covariances.bootstrap);
}

TEST(Calibrate, ThreeViewsHaveNoLeaveOneOut) {
    const auto calibration = calibrate_camera(
        test::synthetic_views(test::calibration_truth(), 3, 0.1, 2), test::image_size);
    EXPECT_FALSE(calibration.leave_one_out_rms_px);
    EXPECT_FALSE(calibration.advice.advised);
    EXPECT_FALSE(calibration.deviations[0].bootstrap);
    EXPECT_FALSE(calibration.halves);
    EXPECT_EQ(calibration.model.name, "standard");
}

TEST(Calibrate, RefusesAModelThatIsNone) {
    const auto views = test::synthetic_views(test::calibration_truth(), 4, 0.1, 2);
    EXPECT_THROW(calibrate_camera(views, test::image_size, {.model = "fisheye"}), ConfigError);
}

TEST(Calibrate, NamesTheViewThatCannotBeUsed) {
    const auto good = test::synthetic_views(test::calibration_truth(), 4, 0.1, 2);
    EXPECT_THAT(error_of({}), HasSubstr("0 views, three are needed"));
    EXPECT_THAT(error_of({good[0], good[1]}), HasSubstr("2 views, three are needed"));
    auto views = good;
    views[3].points_mm.resize(3);
    views[3].pixels.resize(3);
    EXPECT_THAT(error_of(views), HasSubstr("view 3: has 3 points, 4 are needed"));
}

// Parallel boards: distance and focal length trade against each other.
TEST(Calibrate, RefusesViewsThatDoNotDetermineTheCamera) {
    const CameraModel truth = test::calibration_truth();
    std::vector<CalibrationView> parallel, identical;
    for (int i = 0; i < 5; ++i) {
        const Rigid pose{Eigen::Quaterniond::Identity(), {-100.0 + 7 * i, -60.0 - 5 * i, 500}};
        parallel.push_back(test::synthetic_view(truth, pose, 0.1, i));
        identical.push_back(test::synthetic_view(truth, test::synthetic_pose(1), 0.0, 1));
    }
    EXPECT_NE(error_of(parallel), "no error");
    EXPECT_NE(error_of(identical), "no error");
}

}  // namespace
}  // namespace etalon
