#include "calib/intrinsics/calibrate.h"

#include <opencv2/calib3d.hpp>

#include "calib/intrinsics/calibration_outliers.h"
#include "calib/intrinsics/calibration_start.h"
#include "calib/intrinsics/camera_consistency.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

const CalibrationOptions quick{.leave_one_out = false, .resamples = 0};

std::string calibration_error(const std::vector<CalibrationView>& views) {
    return text_of_error<NumericalError>([&] { calibrate_camera(views, image_size, quick); });
}

// OpenCV takes single precision pixels: 3e-5 px of rounding at 500 px.
TEST(Calibrate, FindsTheCameraThatMadeTheViews) {
    const CameraModel truth = calibration_truth();
    const auto calibration = calibrate_camera(synthetic_views(truth, 7, 0.0, 1), image_size,
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
        EXPECT_LT(
            left_difference(*calibration.views[i].camera_from_target, synthetic_pose(i)).norm(),
            2e-3)
            << i;
}

// OpenCV's own standard deviations, from Jacobians of its own. It divides the squared residuals by
// points - parameters, where each point gives two residuals: undone here.
TEST(Calibrate, FormalDeviationsAreOpenCvsWithResidualsCountedInXAndY) {
    const auto views = synthetic_views(calibration_truth(), 8, 0.3, 5);
    const auto calibration = calibrate_camera(views, image_size, quick);
    const auto [points, pixels] = opencv_views(views);
    const double count = 8 * 54;
    cv::Mat k, d, r, t, of_intrinsics, of_extrinsics, per_view;
    const double rms = cv::calibrateCamera(points, pixels, image_size, k, d, r, t, of_intrinsics,
                                           of_extrinsics, per_view);
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
    const auto views = synthetic_views(calibration_truth(), 6, 0.3, 3);
    const auto calibration =
        calibrate_camera(views, image_size, {.model = "standard", .leave_one_out = false});
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
    auto views = synthetic_views(calibration_truth(), 7, 0.2, 9);
    for (std::size_t i = 0; i < views[4].pixels.size(); i += 2)
        views[4].pixels[i].x() += 0.9;  // short of an outlier
    const auto calibration =
        calibrate_camera(views, image_size, {.model = "radial", .resamples = 0});
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
    const auto views = synthetic_views(calibration_truth(), 6, 0.2, 7);
    const int before = cv::getNumThreads();
    const CalibrationOptions options{.resamples = 10};
    cv::setNumThreads(1);
    const auto one = calibrate_camera(views, image_size, options);
    cv::setNumThreads(3);
    const auto three = calibrate_camera(views, image_size, options);
    cv::setNumThreads(before);
    EXPECT_EQ(one.camera.intrinsics.fx, three.camera.intrinsics.fx);
    EXPECT_EQ(one.camera.covariance->matrix, three.camera.covariance->matrix);
    EXPECT_EQ(*one.leave_one_out_rms_px, *three.leave_one_out_rms_px);
    EXPECT_EQ(*one.covariances.bootstrap, *three.covariances.bootstrap);
}

TEST(Calibrate, ThreeViewsHaveNoLeaveOneOut) {
    const auto calibration =
        calibrate_camera(synthetic_views(calibration_truth(), 3, 0.1, 2), image_size);
    EXPECT_FALSE(calibration.leave_one_out_rms_px);
    EXPECT_FALSE(calibration.advice.advised);
    EXPECT_FALSE(calibration.deviations[0].bootstrap);
    EXPECT_FALSE(calibration.halves);
    EXPECT_EQ(calibration.model.name, "standard");
}

TEST(Calibrate, EndsAtAStop) {
    std::stop_source stop;
    stop.request_stop();
    const auto views = synthetic_views(calibration_truth(), 7, 0.1, 1);
    EXPECT_THROW(calibrate_camera(views, image_size, {.stop = stop.get_token()}), Interrupted);
}

TEST(Calibrate, RefusesAModelThatIsNone) {
    const auto views = synthetic_views(calibration_truth(), 4, 0.1, 2);
    EXPECT_THROW(calibrate_camera(views, image_size, {.model = "fisheye"}), ConfigError);
}

TEST(Calibrate, NamesTheViewThatCannotBeUsed) {
    const auto good = synthetic_views(calibration_truth(), 4, 0.1, 2);
    EXPECT_THAT(calibration_error({}), HasSubstr("0 views, three are needed"));
    EXPECT_THAT(calibration_error({good[0], good[1]}), HasSubstr("2 views, three are needed"));
    auto views = good;
    views[3].points_mm.resize(3);
    views[3].pixels.resize(3);
    EXPECT_THAT(calibration_error(views), HasSubstr("view 3: has 3 points, 4 are needed"));
}

// Parallel boards: distance and focal length trade against each other.
TEST(Calibrate, RefusesViewsThatDoNotDetermineTheCamera) {
    const CameraModel truth = calibration_truth();
    std::vector<CalibrationView> parallel, identical;
    for (int i = 0; i < 5; ++i) {
        const Rigid pose{Eigen::Quaterniond::Identity(), {-100.0 + 7 * i, -60.0 - 5 * i, 500}};
        parallel.push_back(synthetic_view(truth, pose, 0.1, i));
        identical.push_back(synthetic_view(truth, synthetic_pose(1), 0.0, 1));
    }
    EXPECT_NE(calibration_error(parallel), "no error");
    EXPECT_NE(calibration_error(identical), "no error");
}

// ---- wide calibration

// Calibrating lenses that see more than a plane: found from the views alone.

TEST(WideCalibration, FindsTheCameraThatMadeExactViews) {
    for (const auto& [name, truth] : wide_models()) {
        SCOPED_TRACE(name);
        const CalibrationModel& model = calibration_model(name);
        const CameraFit fit = fit_camera(wide_views(truth, 9, 0.0, 1), image_size, model);
        EXPECT_TRUE(fit.converged);
        EXPECT_LT(
            (parameters_of(fit.camera, model) - parameters_of(truth, model)).cwiseAbs().maxCoeff(),
            1e-6);
        EXPECT_EQ(fit.camera.projection.kind, truth.projection.kind);
        for (int v = 0; v < 9; ++v)
            EXPECT_LT((fit.camera_from_target[static_cast<std::size_t>(v)].translation -
                       wide_pose(v).translation)
                          .norm(),
                      1e-4);
    }
}

TEST(WideCalibration, FindsAPoseBesideTheAxis) {
    for (const auto& [name, truth] : wide_models())
        for (int v = 0; v < 6; ++v) {
            const Rigid pose = fit_view_pose(truth, synthetic_view(truth, wide_pose(v), 0.0, 1));
            EXPECT_LT((pose.translation - wide_pose(v).translation).norm(), 1e-6) << name << v;
        }
}

TEST(WideCalibration, TellsWideLensesFromOthers) {
    for (const auto& [name, truth] : wide_models())
        EXPECT_EQ(lens_angle(wide_views(truth, 9, 0.2, 3), image_size), LensAngle::wide) << name;
    EXPECT_EQ(lens_angle(synthetic_views(calibration_truth(), 9, 0.2, 3), image_size),
              LensAngle::ordinary);
    // Photos of two zooms follow neither kind.
    auto mixed = synthetic_views(calibration_truth(), 4, 0.2, 3);
    for (int v = 4; v < 8; ++v)
        mixed.push_back(synthetic_view(zoomed(1.3), synthetic_pose(v), 0.2, v));
    EXPECT_EQ(lens_angle(mixed, image_size), LensAngle::ordinary);
}

TEST(WideCalibration, RefusesWhatItCannotMean) {
    const auto views = wide_views(wide_models()[3].truth, 9, 0.1, 1);
    EXPECT_THAT(text_of_error<NumericalError>([&] {
                    fit_camera(views, image_size, calibration_model("kannala_brandt"),
                               {.start = CameraStart{calibration_truth(), std::vector<Rigid>(9)}});
                }),
                HasSubstr("model kannala_brandt cannot start from a camera that is perspective"));
}

// ---- telecentric calibration

// Calibrating telecentric lenses from the views alone: what is found, what is held, what is
// refused.

constexpr double degree = 0.017453292519943295;

CameraModel with_distortion(Distortion distortion) {
    CameraModel camera = telecentric_truth();
    camera.distortion = distortion;
    return camera;
}

const Eigen::Vector2d image_middle(319.5, 239.5);

// Tilted about (cos, sin) of the axis' angle, and before that turned in the board's plane.
Rigid tilted(double tilt_deg, double axis_deg, double turn_deg, double x_mm = 0.3) {
    const double axis = axis_deg * degree;
    const Eigen::Quaterniond rotation =
        rotation_from_vector(tilt_deg * degree *
                             Eigen::Vector3d(std::cos(axis), std::sin(axis), 0)) *
        rotation_from_vector({0, 0, turn_deg * degree});
    return {rotation, Eigen::Vector3d(x_mm, -0.4, 70) - rotation * Eigen::Vector3d(8, 5, 0)};
}

std::vector<CalibrationView> views_of(const CameraModel& camera, const std::vector<Rigid>& poses,
                                      double noise_px = 0.0, int seed = 1) {
    std::vector<CalibrationView> views;
    for (std::size_t i = 0; i < poses.size(); ++i)
        views.push_back(telecentric_view(camera, poses[i], noise_px, 100 * seed + int(i)));
    return views;
}

Rigid other_pose(int view) {
    return telecentric_pose(3 * view + 2);
}

// A few views, larger tilts, and the board seen from behind, as through a mirror.
Rigid mirrored_set(int view) {
    const Rigid pose = tilted(30.0 + 5 * view, 70.0 * view, 25.0 * view, 1.5 * view - 3.0);
    return {rotation_from_vector({M_PI, 0, 0}) * pose.rotation,
            pose.translation + Eigen::Vector3d(0.7, 9.0, 0)};
}

TEST(TelecentricCalibration, FindsTheCameraThatMadeExactViews) {
    const std::pair<const char*, CameraModel> lenses[] = {
        {"telecentric_radial", with_distortion({.k1 = -4.1e-5, .k2 = 1.3e-7})},
        {"telecentric_radial", with_distortion({.k1 = 1.7e-4})},
        {"telecentric_standard", telecentric_truth()},
        {"telecentric_standard",
         with_distortion({.k1 = 9e-5, .k2 = -3.7e-7, .p1 = -2.3e-5, .p2 = 1.1e-5})}};
    const std::pair<Rigid (*)(int), int> sets[] = {
        {telecentric_pose, 9}, {other_pose, 12}, {mirrored_set, 5}};
    for (const auto& [name, truth] : lenses)
        for (const auto& [pose, count] : sets) {
            SCOPED_TRACE(name + std::to_string(count));
            const CalibrationModel& model = calibration_model(name);
            const CameraFit fit =
                fit_camera(telecentric_views(truth, count, 0.0, 1, pose), image_size, model);
            EXPECT_TRUE(fit.converged);
            const Eigen::VectorXd found = parameters_of(fit.camera, model),
                                  expected = parameters_of(truth, model);
            for (Eigen::Index i = 0; i < found.size(); ++i)
                EXPECT_NEAR(found[i], expected[i],
                            1e-6 * std::abs(expected[i]) + (expected[i] == 0.0 ? 1e-11 : 0.0))
                    << model.parameters[std::size_t(i)];
            EXPECT_EQ(fit.camera.projection.kind, Projection::telecentric);
        }
}

TEST(TelecentricCalibration, FindsPosesButForTheSignOfTheirTilt) {
    const CameraModel truth = telecentric_truth();
    for (int v = 0; v < 6; ++v) {
        const Rigid pose = telecentric_pose(v);
        const Rigid found = fit_view_pose(truth, telecentric_view(truth, pose, 0.0, 1));
        const Eigen::Matrix3d seen = found.rotation.toRotationMatrix(),
                              expected = pose.rotation.toRotationMatrix();
        EXPECT_LT((seen - expected).topLeftCorner(2, 2).norm(), 1e-9) << v;
        EXPECT_NEAR(seen(2, 2), expected(2, 2), 1e-9);
        EXPECT_NEAR(std::abs(seen(2, 0)), std::abs(expected(2, 0)), 1e-9);
        EXPECT_LT((found.translation - pose.translation).head<2>().norm(), 1e-8);
        EXPECT_GT((found * Eigen::Vector3d(16, 10, 0)).z(), 0.0);
    }
}

// fx and fy are as the truth's, wherever the truth's centre is.
TEST(TelecentricCalibration, HoldsTheCentreWithoutDistortion) {
    const CameraModel truth = with_distortion({});
    const CalibrationModel& model = calibration_model("telecentric");
    const auto views = telecentric_views(truth, 8, 0.0, 1);
    const CameraFit fit = fit_camera(views, image_size, model);
    EXPECT_TRUE(fit.converged);
    EXPECT_NEAR(fit.camera.intrinsics.fx, 25.3, 25e-6);
    EXPECT_NEAR(fit.camera.intrinsics.fy, 24.9, 25e-6);
    EXPECT_EQ(fit.camera.intrinsics.cx, image_middle.x());
    EXPECT_EQ(fit.camera.intrinsics.cy, image_middle.y());
    EXPECT_LT(fit.condition_number, 2.0);
    // A model with a centre has nothing to find it by.
    EXPECT_THAT(text_of_error<NumericalError>([&] {
                    fit_camera(views, image_size, calibration_model("telecentric_radial"));
                }),
                HasSubstr("the distortion is too weak for model telecentric_radial"));
}

// Held: parameters + 5 a view, not 6.
TEST(TelecentricCalibration, CountsFiveParametersOfAPose) {
    const auto views = telecentric_views(with_distortion({}), 8, 0.2, 4);
    const CameraFit fit = fit_camera(views, image_size, calibration_model("telecentric"));
    double squares = 0.0;
    for (const auto& view : fit.residuals_px)
        for (const Eigen::Vector2d& residual : view)
            squares += residual.squaredNorm();
    EXPECT_NEAR(fit.variance, squares / (2 * 8 * 54 - 2 - 5 * 8), 1e-12);
}

// One way to tilt tells one magnification, and none tells nothing that a tilt common to all views
// (of the camera above a table) would not undo.
TEST(TelecentricCalibration, RefusesTiltsThatLeaveTheAspectOpen) {
    const CameraModel truth = with_distortion({});
    const std::vector<std::vector<Rigid>> sets{
        {tilted(20, 40, 0), tilted(35, 40, 30), tilted(27, 40, 70), tilted(-31, 40, 110, 1)},
        {tilted(20, 45, 0), tilted(35, -45, 30), tilted(27, 45, 70), tilted(-31, -45, 110, 1)},
        {tilted(0, 0, 0), tilted(0, 0, 40), tilted(0, 0, 75), tilted(0, 0, 120, 1)},
        {tilted(25, 0, 0), tilted(25, 0, 40), tilted(25, 0, 75), tilted(25, 0, 120, 1)}};
    for (const auto& poses : sets)
        for (const double noise_px : {0.0, 0.1})
            EXPECT_THAT(text_of_error<NumericalError>([&] {
                            fit_camera(views_of(truth, poses, noise_px), image_size,
                                       calibration_model("telecentric"));
                        }),
                        HasSubstr("do not tell fy / fx of a telecentric camera"));
}

// A tilt near zero is a minimum that steps do not converge to; it is taken for none, or found.
TEST(TelecentricCalibration, TakesViewsThatAreFlatOn) {
    const CameraModel truth = with_distortion({.k1 = -4.1e-5, .k2 = 1.3e-7});
    const CalibrationModel& model = calibration_model("telecentric_radial");
    std::vector<Rigid> poses{tilted(0, 0, 10), tilted(0, 0, 50, 2), tilted(0.4, 80, -20, -2),
                             tilted(2.5, 10, 0, 1)};
    for (int v = 0; v < 6; ++v)
        poses.push_back(telecentric_pose(v));
    const CameraFit exact = fit_camera(views_of(truth, poses), image_size, model);
    EXPECT_TRUE(exact.converged);
    EXPECT_LT((parameters_of(exact.camera, model) - parameters_of(truth, model))
                  .cwiseQuotient(parameters_of(truth, model))
                  .cwiseAbs()
                  .maxCoeff(),
              1e-6);
    for (std::size_t v = 0; v < 4; ++v)
        EXPECT_NEAR(tilt_rad(exact.camera_from_target[v].rotation), tilt_rad(poses[v].rotation),
                    1e-5);
    for (int seed = 1; seed <= 40; ++seed) {
        const auto views = views_of(truth, poses, 0.1, seed);
        const CameraFit fit = fit_camera(views, image_size, model);
        EXPECT_TRUE(fit.converged) << seed;
        EXPECT_LT(fit.iterations, 40) << seed;
        EXPECT_NEAR(fit.camera.intrinsics.fx, 25.3, 0.02);
        EXPECT_NEAR(fit.camera.intrinsics.fy, 24.9, 0.02);
        EXPECT_LT(tilt_rad(fit.camera_from_target[0].rotation), 2.5 * degree);
    }
}

// What a view that is flat on says of the camera is all that its points say, less turn and place.
TEST(TelecentricCalibration, AViewThatIsFlatOnLosesNoRow) {
    const CameraModel camera = with_distortion({.k1 = -4.1e-5, .k2 = 1.3e-7});
    const CalibrationModel& model = calibration_model("telecentric_radial");
    const Rigid pose = tilted(0, 0, 20);
    const CalibrationView view = telecentric_view(camera, pose, 0.1, 3);
    const CameraFit fit{.model = model, .camera = camera, .camera_from_target = {pose}};
    const auto equations = view_equations(std::span(&view, 1), fit);
    Eigen::MatrixXd of_camera(108, 6), of_pose(108, 3);
    for (std::size_t i = 0; i < 54; ++i) {
        const Eigen::Vector3d p = pose * view.points_mm[i];
        const auto row = 2 * static_cast<Eigen::Index>(i);
        of_camera.middleRows<2>(row) = parameter_jacobian(camera, p, model);
        const auto of = PixelModel<double>(camera.projection, all_parameters(camera))(p).of;
        of_pose.middleRows<2>(row) << of.leftCols<2>() * Eigen::Vector2d(-p.y(), p.x()),
            of.leftCols<2>();
    }
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(of_pose);
    const Eigen::MatrixXd basis = qr.householderQ() * Eigen::MatrixXd::Identity(108, 3);
    const Eigen::MatrixXd left = of_camera - basis * (basis.transpose() * of_camera);
    const Eigen::MatrixXd expected = left.transpose() * left,
                          got = equations[0].triangle.transpose() * equations[0].triangle;
    EXPECT_LT((got - expected).norm(), 1e-9 * expected.norm());
}

// Noise and outliers, everything that the command reports.
TEST(TelecentricCalibration, IsJudgedLikeAnyOther) {
    const CameraModel truth = with_distortion({.k1 = -4.1e-5, .k2 = 1.3e-7});
    auto views = telecentric_views(truth, 10, 0.1, 7);
    views[4].pixels[17].y() += 5.0;
    const CameraCalibration found =
        calibrate_camera(views, image_size, {.model = "telecentric_radial", .resamples = 40});
    EXPECT_EQ(found.advice.models.size(), 3u);
    ASSERT_TRUE(found.advice.advised);
    EXPECT_EQ(found.advice.models[*found.advice.advised].model, "telecentric_radial");
    EXPECT_EQ(found.points_left_out(), 1u);
    EXPECT_TRUE(found.views[4].left_out[17]);
    EXPECT_NEAR(found.rms_px, 0.1 * std::sqrt(2.0), 0.01);
    EXPECT_LT(*found.leave_one_out_rms_px, 0.16);
    EXPECT_FALSE(found.flatness);
    EXPECT_THAT(found.camera.covariance->order, ElementsAre("fx", "fy", "cx", "cy", "k1", "k2"));
    EXPECT_TRUE(found.covariances.bootstrap);
    ASSERT_TRUE(found.halves);
    EXPECT_LT(found.halves->rms_px, 3 * found.halves->expected_formal_px);
    EXPECT_LT(found.uncertainty.worst_among_points(&PixelUncertainty::rotated), 0.1);
}

// cx and cy are 30 px off in one half and not in the other, which a shift takes back.
TEST(TelecentricCalibration, CentresThatDifferAreAShift) {
    CameraModel one = with_distortion({}), other = one;
    other.intrinsics.cx += 90.0;
    other.intrinsics.cy -= 55.0;
    const ImageRays rays = image_rays(one);
    const auto difference =
        projection_difference(other, rays, Eigen::VectorXd::Ones(std::ssize(rays.rays)));
    for (const Eigen::Vector2d& each : difference.differences_px)
        EXPECT_LT(each.norm(), 1e-9);
}

TEST(TelecentricCalibration, IsNeverTakenUnasked) {
    const auto views = telecentric_views(with_distortion({}), 5, 0.1, 3);
    EXPECT_THAT(text_of_error<NumericalError>(
                    [&] { calibrate_camera(views, image_size, {.resamples = 0}); }),
                HasSubstr("the lens may be telecentric: model telecentric, which has to be named"));
}

TEST(TelecentricCalibration, RefusesABoardsShape) {
    const auto views = telecentric_views(with_distortion({}), 9, 0.1, 3);
    EXPECT_THAT(text_of_error<NumericalError>([&] {
                    calibrate_camera(views, image_size,
                                     {.model = "telecentric", .fit_board = true});
                }),
                AllOf(HasSubstr("telecentric"), HasSubstr("height")));
}

TEST(TelecentricCalibration, TellsMagnificationsApart) {
    CameraModel zoomed = telecentric_truth();
    zoomed.intrinsics.zoom(1.03);
    auto views = telecentric_views(telecentric_truth(), 12, 0.1, 5);
    EXPECT_EQ(camera_groups(views, image_size, true).size(), 1u);
    for (const int i : {2, 7})
        views[std::size_t(i)] = telecentric_view(zoomed, telecentric_pose(i), 0.1, i);
    const auto groups = camera_groups(views, image_size, true);
    ASSERT_EQ(groups.size(), 2u);
    EXPECT_THAT(groups[1].views, ElementsAre(2u, 7u));
    EXPECT_NEAR(groups[1].focal_px, 1.03 * 25.1, 0.1);
}

// ---- calibration outliers

std::vector<std::pair<int, int>> found_in(const CornerMask& mask) {
    std::vector<std::pair<int, int>> found;
    for (std::size_t v = 0; v < mask.size(); ++v)
        for (std::size_t i = 0; i < mask[v].size(); ++i)
            if (mask[v][i])
                found.emplace_back(v, i);
    return found;
}

const CalibrationOptions radial_fit{.model = "radial", .leave_one_out = false, .resamples = 0};

CornerMask corners_of(const std::vector<CalibrationView>& views) {
    return find_outlier_corners(views, image_size, {{calibration_model("standard")}});
}

// Six scales: of 756 points with normal errors one exceeds them in 8e-6 of all calibrations.
TEST(OutlierCorners, AreNotFoundInNoise) {
    for (const double noise : {0.02, 0.3, 2.0})
        EXPECT_THAT(found_in(corners_of(synthetic_views(calibration_truth(), 7, noise, 11))),
                    IsEmpty())
            << noise;
}

TEST(OutlierCorners, AreFoundAndNoneBesides) {
    auto views = synthetic_views(calibration_truth(), 7, 0.2, 12);
    views[2].pixels[17] += Eigen::Vector2d(1.9, -0.8);  // ten sigmas
    views[2].pixels[18] += Eigen::Vector2d(-40, 25);    // far off, and next to it
    views[5].pixels[53] += Eigen::Vector2d(0, 9);
    EXPECT_THAT(found_in(corners_of(views)),
                ElementsAre(std::pair(2, 17), std::pair(2, 18), std::pair(5, 53)));
}

TEST(OutlierCorners, TakeTheirViewWithThemWhenTheyAreAQuarterOfIt) {
    auto views = synthetic_views(calibration_truth(), 12, 0.2, 13);
    for (std::size_t i = 0; i < 14; ++i)
        views[4].pixels[i].y() += i % 2 == 0 ? 6.0 : -6.0;
    const auto mask = corners_of(views);
    EXPECT_EQ(found_in(mask).size(), 54u);
    EXPECT_TRUE(mask[4][53]);
}

// Medians: 0.2 of the fit and 0.31 left out, so that 0.6 and 0.93 are the limits.
TEST(OutlierViews, MustBeThreeTimesAsBadInTheFitAndLeftOut) {
    const std::vector<double> fit{0.2, 0.61, 0.59, 0.61, 0.19, 0.2, 0.18};
    const std::vector<double> out{0.3, 0.94, 2.00, 0.92, 0.29, 0.3, 0.31};
    EXPECT_THAT(find_outlier_views(fit, out), ElementsAre(1u));
}

TEST(Outliers, AreNamedCountedAndLeftOut) {
    auto views = synthetic_views(calibration_truth(), 7, 0.2, 14);
    const auto clean = calibrate_camera(views, image_size, radial_fit);
    EXPECT_EQ(clean.points_left_out(), 0u);
    views[3].pixels[20] += Eigen::Vector2d(12, 5);
    const auto found = calibrate_camera(views, image_size, radial_fit);
    EXPECT_EQ(found.points(), 7u * 54u);
    EXPECT_EQ(found.points_left_out(), 1u);
    EXPECT_TRUE(found.views[3].left_out[20]);
    EXPECT_NEAR((found.views[3].residuals_px[20] - Eigen::Vector2d(12, 5)).norm(), 0.0, 1.0);
    // One point of 378 less: the camera moves by a small part of its uncertainty.
    EXPECT_NEAR(found.camera.intrinsics.fx, clean.camera.intrinsics.fx,
                0.5 * clean.deviations[0].stated);
}

TEST(Outliers, OfAWholeViewLeaveTheOthersAsTheyAre) {
    auto views = synthetic_views(calibration_truth(), 11, 0.1, 15);
    auto others = views;
    others.erase(others.begin() + 6);
    std::swap(views[6].pixels, views[2].pixels);
    views[2].pixels = others[2].pixels;  // view 6 claims to see what view 2 sees, bent
    for (std::size_t i = 0; i < 54; ++i)
        views[6].pixels[i] += 1.5 * Eigen::Vector2d(std::sin(0.9 * i), std::cos(1.7 * i));
    const CalibrationOptions options{.model = "radial", .resamples = 0};
    const auto found = calibrate_camera(views, image_size, options);
    EXPECT_FALSE(found.views[6].used());
    EXPECT_EQ(found.points_left_out(), 54u);
    const auto without = calibrate_camera(others, image_size, radial_fit);
    EXPECT_NEAR(found.camera.intrinsics.fx, without.camera.intrinsics.fx, 1e-6);
    EXPECT_NEAR(found.rms_px, without.rms_px, 1e-9);
    EXPECT_GT(found.views[6].rms_px, 1.0);
}

// Before any fit: points in a wrong order would draw it anywhere.
TEST(Outliers, AreViewsThatNoPlaneExplains) {
    const auto good = synthetic_views(calibration_truth(), 11, 0.2, 17);
    auto reversed = good, scattered = good;
    std::reverse(reversed[4].pixels.begin(), reversed[4].pixels.begin() + 27);
    RandomStream random(5, 2);
    for (Eigen::Vector2d& pixel : scattered[7].pixels)
        pixel = {640.0 * random.uniform(), 480.0 * random.uniform()};
    for (const auto& [views, bad] : {std::pair{reversed, 4}, std::pair{scattered, 7}}) {
        const auto found = calibrate_camera(views, image_size, radial_fit);
        EXPECT_FALSE(found.views[bad].used());
        EXPECT_EQ(found.points_left_out(), 54u);
        auto others = good;
        others.erase(others.begin() + bad);
        EXPECT_NEAR(found.camera.intrinsics.fx,
                    calibrate_camera(others, image_size, radial_fit).camera.intrinsics.fx, 1e-6);
    }
}

TEST(Outliers, OfMoreThanATenthAreRefused) {
    auto views = synthetic_views(calibration_truth(), 7, 0.2, 16);
    for (std::size_t i = 0; i < 54; ++i)
        views[1].pixels[i] += 8.0 * Eigen::Vector2d(std::sin(0.9 * i), std::cos(1.7 * i));
    EXPECT_THAT(
        text_of_error<NumericalError>(
            [&] { calibrate_camera(views, image_size, {.model = "radial", .resamples = 0}); }),
        AllOf(HasSubstr("54 of 378 points do not fit the others"), HasSubstr("view 1: 54 of 54")));
}

}  // namespace
}  // namespace etalon
