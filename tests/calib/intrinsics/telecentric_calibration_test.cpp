// Calibrating telecentric lenses from the views alone: what is found, what is held, what is
// refused.

#include "calib/intrinsics/calibration_outliers.h"
#include "calib/intrinsics/calibration_start.h"
#include "calib/intrinsics/camera_consistency.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr double degree = 0.017453292519943295;

CameraModel with_distortion(Distortion distortion) {
    CameraModel camera = test::telecentric_truth();
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
        views.push_back(test::telecentric_view(camera, poses[i], noise_px, 100 * seed + int(i)));
    return views;
}

Rigid other_pose(int view) {
    return test::telecentric_pose(3 * view + 2);
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
        {"telecentric_standard", test::telecentric_truth()},
        {"telecentric_standard",
         with_distortion({.k1 = 9e-5, .k2 = -3.7e-7, .p1 = -2.3e-5, .p2 = 1.1e-5})}};
    const std::pair<Rigid (*)(int), int> sets[] = {
        {test::telecentric_pose, 9}, {other_pose, 12}, {mirrored_set, 5}};
    for (const auto& [name, truth] : lenses)
        for (const auto& [pose, count] : sets) {
            SCOPED_TRACE(name + std::to_string(count));
            const CalibrationModel& model = calibration_model(name);
            const CameraFit fit = fit_camera(test::telecentric_views(truth, count, 0.0, 1, pose),
                                             test::image_size, model);
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
    const CameraModel truth = test::telecentric_truth();
    for (int v = 0; v < 6; ++v) {
        const Rigid pose = test::telecentric_pose(v);
        const Rigid found = fit_view_pose(truth, test::telecentric_view(truth, pose, 0.0, 1));
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
    const auto views = test::telecentric_views(truth, 8, 0.0, 1);
    const CameraFit fit = fit_camera(views, test::image_size, model);
    EXPECT_TRUE(fit.converged);
    EXPECT_NEAR(fit.camera.intrinsics.fx, 25.3, 25e-6);
    EXPECT_NEAR(fit.camera.intrinsics.fy, 24.9, 25e-6);
    EXPECT_EQ(fit.camera.intrinsics.cx, image_middle.x());
    EXPECT_EQ(fit.camera.intrinsics.cy, image_middle.y());
    EXPECT_LT(fit.condition_number, 2.0);
    // A model with a centre has nothing to find it by.
    EXPECT_THAT(text_of_error<NumericalError>([&] {
                    fit_camera(views, test::image_size, calibration_model("telecentric_radial"));
                }),
                HasSubstr("the distortion is too weak for model telecentric_radial"));
}

// Held: parameters + 5 a view, not 6.
TEST(TelecentricCalibration, CountsFiveParametersOfAPose) {
    const auto views = test::telecentric_views(with_distortion({}), 8, 0.2, 4);
    const CameraFit fit = fit_camera(views, test::image_size, calibration_model("telecentric"));
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
                            fit_camera(views_of(truth, poses, noise_px), test::image_size,
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
        poses.push_back(test::telecentric_pose(v));
    const CameraFit exact = fit_camera(views_of(truth, poses), test::image_size, model);
    EXPECT_TRUE(exact.converged);
    EXPECT_LT((parameters_of(exact.camera, model) - parameters_of(truth, model))
                  .cwiseQuotient(parameters_of(truth, model))
                  .cwiseAbs()
                  .maxCoeff(),
              1e-6);
    for (std::size_t v = 0; v < 4; ++v)
        EXPECT_NEAR(tilt_rad(exact.camera_from_target[v].rotation), tilt_rad(poses[v].rotation),
                    1e-5);
    for (int seed = 1; seed <= 20; ++seed) {
        const auto views = views_of(truth, poses, 0.1, seed);
        const CameraFit fit = fit_camera(views, test::image_size, model);
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
    const CalibrationView view = test::telecentric_view(camera, pose, 0.1, 3);
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
    auto views = test::telecentric_views(truth, 10, 0.1, 7);
    views[4].pixels[17].y() += 5.0;
    const CameraCalibration found =
        calibrate_camera(views, test::image_size, {.model = "telecentric_radial", .resamples = 40});
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
    const auto views = test::telecentric_views(with_distortion({}), 5, 0.1, 3);
    EXPECT_THAT(text_of_error<NumericalError>(
                    [&] { calibrate_camera(views, test::image_size, {.resamples = 0}); }),
                HasSubstr("the lens may be telecentric: model telecentric, which has to be named"));
}

TEST(TelecentricCalibration, RefusesABoardsShape) {
    const auto views = test::telecentric_views(with_distortion({}), 9, 0.1, 3);
    EXPECT_THAT(text_of_error<NumericalError>([&] {
                    calibrate_camera(views, test::image_size,
                                     {.model = "telecentric", .fit_board = true});
                }),
                AllOf(HasSubstr("telecentric"), HasSubstr("height")));
}

TEST(TelecentricCalibration, TellsMagnificationsApart) {
    CameraModel zoomed = test::telecentric_truth();
    zoomed.intrinsics.zoom(1.03);
    auto views = test::telecentric_views(test::telecentric_truth(), 12, 0.1, 5);
    EXPECT_EQ(camera_groups(views, test::image_size, true).size(), 1u);
    for (const int i : {2, 7})
        views[std::size_t(i)] = test::telecentric_view(zoomed, test::telecentric_pose(i), 0.1, i);
    const auto groups = camera_groups(views, test::image_size, true);
    ASSERT_EQ(groups.size(), 2u);
    EXPECT_THAT(groups[1].views, ElementsAre(2u, 7u));
    EXPECT_NEAR(groups[1].focal_px, 1.03 * 25.1, 0.1);
}

}  // namespace
}  // namespace etalon
