#include "calib/intrinsics/camera_fit.h"

#include <opencv2/calib3d.hpp>

#include "calib/intrinsics/calibration_start.h"
#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

std::string fit_error(const std::vector<CalibrationView>& views,
                      const CameraFitOptions& options = {}) {
    return text_of_error<Error>(
        [&] { fit_camera(views, image_size, calibration_model("standard"), options); });
}

double largest_difference_in_u(const CameraFit& fit, const Eigen::VectorXd& other,
                               const std::vector<CalibrationView>& views,
                               const CalibrationModel& model) {
    const Eigen::MatrixXd covariance =
        fit.variance * inverse_information(view_equations(views, fit), model);
    return (parameters_of(fit.camera, model) - other)
        .cwiseQuotient(covariance.diagonal().cwiseSqrt())
        .cwiseAbs()
        .maxCoeff();
}

// ---- the model

template <typename Scalar>
PixelModel<Scalar> model_of(const CameraModel& camera) {
    return {camera.projection, all_parameters(camera).cast<Scalar>()};
}

// A perspective camera with every coefficient, and wide lenses with both parameters.
std::vector<CameraModel> named_cameras() {
    std::vector<CameraModel> cameras(3, all_fourteen());
    cameras[1].distortion = {.k1 = 0.03, .p1 = 0.001, .s3 = -0.002, .k7 = 0.004};
    cameras[2].distortion = cameras[1].distortion;
    cameras[1].projection = {Projection::double_sphere, -0.21, 0.57};
    cameras[2].projection = {Projection::extended_unified, 1.13, 0.62};
    cameras[0].intrinsics.skew = -17.0;
    cameras[1].intrinsics.skew = 31.0;
    return cameras;
}

TEST(PixelModel, IsTheProjector) {
    for (const CameraModel& camera : named_cameras()) {
        const Projector projector(camera);
        const auto model = model_of<double>(camera);
        for (const Eigen::Vector3d& p :
             {Eigen::Vector3d(310, -230, 1000), Eigen::Vector3d(-47, 11, 100)}) {
            const auto expected = projector.project_with_jacobian(p);
            const auto seen = model(p);
            EXPECT_TRUE(seen.is_regular);
            EXPECT_LT((seen.pixel - expected->pixel).norm(), 1e-11);
            EXPECT_LT((seen.of - expected->jacobian).norm(), 1e-12);
        }
    }
}

// Central differences in long double with a step of 1e-6: their own error is of the order of 1e-12
// times third derivatives of some 1000 px.
TEST(PixelModel, HasTheDerivativesThatDifferencesHave) {
    using Model = PixelModel<long double>;
    constexpr long double h = 1e-6L;
    const Model::Vector3 p(0.41L, -0.29L, 1.07L);
    for (const CameraModel& camera : named_cameras()) {
        const Projection kind = camera.projection.kind;
        const Model::Parameters parameters = all_parameters(camera).cast<long double>();
        const Model model(camera.projection, parameters);
        Model::OfParameters of_parameters;
        const auto seen = model.with_derivatives(p, of_parameters);
        for (int k = 0; k < camera_parameter_count; ++k) {
            const bool is_tilt = k == 16 || k == 17, is_of_wide_lens = k == 19 || k == 20;
            if (kind == Projection::perspective ? is_of_wide_lens : is_tilt)
                continue;
            const Model::Parameters step = h * Model::Parameters::Unit(k);
            const Model::Vector2 difference =
                (Model(camera.projection, parameters + step)(p).pixel -
                 Model(camera.projection, parameters - step)(p).pixel) /
                (2 * h);
            EXPECT_LT((difference - of_parameters.col(k)).norm(), 1e-8L) << k;
            EXPECT_GT(of_parameters.col(k).norm(), 1e-4L) << k;
        }
        for (int k = 0; k < 3; ++k) {
            const Model::Vector3 step = h * Model::Vector3::Unit(k);
            const Model::Vector2 difference =
                (model(p + step).pixel - model(p - step).pixel) / (2 * h);
            EXPECT_LT((difference - seen.of.col(k)).norm(), 1e-8L) << k;
        }
    }
}

TEST(PixelModel, IsNotRegularBehindAFoldOrAPole) {
    CameraModel camera = webcam();
    const auto is_regular = [&](double x, double y) {
        return model_of<double>(camera)({x, y, 1.0}).is_regular;
    };
    camera.distortion = {.k1 = -0.9};  // folds at r = 0.61
    EXPECT_TRUE(is_regular(0.5, 0.2));
    EXPECT_FALSE(is_regular(0.6, 0.3));
    EXPECT_FALSE(model_of<double>(camera)({0.1, 0.1, -1.0}).is_regular);
    camera.distortion = {.k4 = -2.0};  // pole at r = 0.71
    EXPECT_FALSE(is_regular(0.6, 0.5));
    camera.distortion = {};
    camera.projection = {Projection::double_sphere, -0.2, 1.1};  // no such lens
    EXPECT_FALSE(is_regular(0.1, 0.1));
}

// ---- calibration models

TEST(CalibrationModels, ContainEachTheOneBeforeAndSetWhatTheyName) {
    std::size_t before = 0;
    for (const CalibrationModel& model : calibration_models()) {
        EXPECT_GT(model.parameters.size(), before) << model.name;
        before = model.parameters.size();
        EXPECT_EQ(&calibration_model(model.name), &model);
    }
    EXPECT_EQ(calibration_model("standard").parameters.back(), "k3");
    EXPECT_EQ(calibration_model("rational").parameters.back(), "k6");
    EXPECT_EQ(calibration_model("tilted").parameters.size(), 18u);
    CameraModel camera = all_fourteen();
    const CalibrationModel radial = calibration_model("radial");
    Eigen::VectorXd values = parameters_of(camera, radial);
    EXPECT_EQ(values[5], camera.distortion.k2);
    values[5] = 0.77;
    set_parameters(camera, radial, values);
    EXPECT_EQ(camera.distortion.k2, 0.77);
    EXPECT_EQ(camera.distortion.tau_y, -0.11);
    EXPECT_THAT(text_of_error<Error>([] { calibration_model("fisheye"); }),
                HasSubstr("pinhole, radial"));
    EXPECT_THAT(text_of_error<Error>([] { parameter_index("k8"); }),
                HasSubstr("no parameter 'k8'"));
    for (const CalibrationModel& model : wide_calibration_models()) {
        EXPECT_EQ(&calibration_model(model.name), &model);
        CameraModel wide = webcam();
        wide.projection = {model.projection, 0.4, 0.3};
        const Eigen::VectorXd of_wide = parameters_of(wide, model);
        set_parameters(wide, model, 2.0 * of_wide);
        EXPECT_EQ(parameters_of(wide, model), 2.0 * of_wide) << model.name;
    }
    EXPECT_EQ(parameter_index("alpha"), parameter_index("xi") + 1);
}

// ---- the fit

// Exact views: what is left is rounding, some 1e-13 px of 500, times the condition number 50.
TEST(CameraFit, FindsTheCameraThatMadeTheViews) {
    const CameraModel truth = calibration_truth();
    const auto views = synthetic_views(truth, 7, 0.0, 1);
    const CalibrationModel& model = calibration_model("standard");
    const CameraFit fit = fit_camera(views, image_size, model);
    EXPECT_TRUE(fit.converged);
    EXPECT_LT(std::sqrt(fit.variance), 1e-11);
    EXPECT_LT((parameters_of(fit.camera, model) - parameters_of(truth, model)).norm(), 1e-9);
    for (int i = 0; i < 7; ++i)
        EXPECT_LT(left_difference(fit.camera_from_target[i], synthetic_pose(i)).norm(), 1e-9);
}

// OpenCV reads single precision: it is given numbers that are, and stops at a step of 1e-9. Its
// minimum is ours within a hundredth of u, and not below it.
TEST(CameraFit, EndsWhereOpenCvEnds) {
    auto views = synthetic_views(calibration_truth(), 8, 0.3, 5);
    const auto [points, pixels] = opencv_views(views);
    for (int v = 0; v < 8; ++v)
        for (std::size_t i = 0; i < views[v].pixels.size(); ++i)
            views[v].pixels[i] = {pixels[v][i].x, pixels[v][i].y};
    cv::Mat k, d;
    std::vector<cv::Mat> r, t;
    const double rms =
        cv::calibrateCamera(points, pixels, image_size, k, d, r, t, 0,
                            {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 300, 1e-15});
    const CalibrationModel& model = calibration_model("standard");
    const CameraFit fit = fit_camera(views, image_size, model);
    Eigen::VectorXd opencv(9);
    opencv << k.at<double>(0, 0), k.at<double>(1, 1), k.at<double>(0, 2), k.at<double>(1, 2),
        d.at<double>(0), d.at<double>(1), d.at<double>(2), d.at<double>(3), d.at<double>(4);
    EXPECT_LT(largest_difference_in_u(fit, opencv, views, model), 0.01);
    const double degrees = 2 * 432 - 9 - 48;
    const double ours = std::sqrt(fit.variance * degrees / 432);
    EXPECT_NEAR(ours, rms, 1e-6 * rms);
    EXPECT_LE(ours, rms * (1 + 1e-12));
}

// The covariance from differences of the projector alone: all columns at once, poses and all, by
// normal equations.
TEST(CameraFit, InverseInformationIsThatOfTheWholeJacobianByDifferences) {
    const auto views = synthetic_views(calibration_truth(), 5, 0.2, 3);
    const CalibrationModel& model = calibration_model("standard");
    const CameraFit fit = fit_camera(views, image_size, model);
    const int rows = 2 * 54 * 5, columns = 9 + 30;
    const auto residuals = [&](const CameraModel& camera, int view, const Rigid& pose) {
        const Projector projector(camera);
        Eigen::VectorXd of_view(108);
        for (int i = 0; i < 54; ++i)
            of_view.segment<2>(2 * i) = projector.project(pose * views[view].points_mm[i]).value();
        return of_view;
    };
    Eigen::MatrixXd jacobian = Eigen::MatrixXd::Zero(rows, columns);
    for (int v = 0; v < 5; ++v) {
        const Rigid& pose = fit.camera_from_target[v];
        for (int k = 0; k < 9; ++k) {
            const double h = k < 4 ? 1e-3 : 1e-5;
            CameraModel up = fit.camera, down = fit.camera;
            const Eigen::VectorXd step = h * Eigen::VectorXd::Unit(9, k);
            set_parameters(up, model, parameters_of(fit.camera, model) + step);
            set_parameters(down, model, parameters_of(fit.camera, model) - step);
            jacobian.col(k).segment(108 * v, 108) =
                (residuals(up, v, pose) - residuals(down, v, pose)) / (2 * h);
        }
        for (int k = 0; k < 6; ++k) {
            const Vector6d step = (k < 3 ? 1e-6 : 1e-3) * Vector6d::Unit(k);
            jacobian.col(9 + 6 * v + k).segment(108 * v, 108) =
                (residuals(fit.camera, v, left_perturbed(pose, step)) -
                 residuals(fit.camera, v, left_perturbed(pose, -step))) /
                (2 * step[k]);
        }
    }
    const Eigen::MatrixXd expected = (jacobian.transpose() * jacobian).inverse();
    const Eigen::MatrixXd inverse = inverse_information(view_equations(views, fit), model);
    for (int i = 0; i < 9; ++i)
        for (int j = 0; j < 9; ++j)
            EXPECT_NEAR(inverse(i, j), expected(i, j),
                        1e-5 * std::sqrt(expected(i, i) * expected(j, j)))
                << i << " " << j;
}

// At the minimum the views' scores cancel, and what no change can remove is the cost.
TEST(CameraFit, ScoresCancelAtTheMinimum) {
    const auto views = synthetic_views(calibration_truth(), 6, 0.2, 4);
    const CalibrationModel& model = calibration_model("standard");
    const CameraFit fit = fit_camera(views, image_size, model);
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(9), sizes = sum;
    double squares = 0.0;
    for (const ViewEquations& view : view_equations(views, fit)) {
        const Eigen::VectorXd score = view.triangle.transpose() * view.rhs;
        sum += score;
        sizes += score.cwiseAbs();
        squares += view.rhs.squaredNorm() + view.rest;
    }
    for (int i = 0; i < 9; ++i)
        EXPECT_LT(std::abs(sum[i]), 1e-6 * sizes[i]) << i;
    EXPECT_NEAR(squares, fit.variance * (2 * 324 - 9 - 36), 1e-6 * squares);
}

// A point that is there twice is one with its sigma divided by the root of two.
TEST(CameraFit, WeighsPointsByTheirSigma) {
    auto once = synthetic_views(calibration_truth(), 5, 0.2, 6);
    auto twice = once;
    once[2].sigma_px.assign(54, 1.0);
    for (int i = 0; i < 20; ++i) {
        once[2].sigma_px[i] = 1.0 / std::sqrt(2.0);
        twice[2].points_mm.push_back(twice[2].points_mm[i]);
        twice[2].pixels.push_back(twice[2].pixels[i]);
    }
    const CalibrationModel& model = calibration_model("standard");
    const CameraFit a = fit_camera(once, image_size, model);
    const CameraFit b = fit_camera(twice, image_size, model);
    EXPECT_LT(largest_difference_in_u(a, parameters_of(b.camera, model), once, model), 1e-6);
}

// Ten of 378 points are 15 px off: squares follow them by many u, Huber's function does not.
TEST(CameraFit, HubersFunctionLeavesOutliersWhereTheyAre) {
    const CalibrationModel& model = calibration_model("standard");
    const auto clean = synthetic_views(calibration_truth(), 7, 0.1, 8);
    auto views = clean;
    for (int i = 0; i < 10; ++i)
        views[i % 7].pixels[5 * i + 3] += Eigen::Vector2d(15.0, -4.0);
    const CameraFit expected = fit_camera(clean, image_size, model);
    const auto off = [&](double huber) {
        const CameraFit fit = fit_camera(views, image_size, model, {.huber = huber});
        return largest_difference_in_u(expected, parameters_of(fit.camera, model), clean, model);
    };
    EXPECT_GT(off(0.0), 10.0);
    EXPECT_LT(off(0.2), 3.0);
    const CameraFit robust = fit_camera(views, image_size, model, {.huber = 0.2});
    EXPECT_GT(robust.residuals_px[3][18].norm(), 14.0);
}

TEST(CameraFit, StartsFromAStartAndKeepsWhatIsNotFree) {
    CameraModel truth = calibration_truth();
    const auto views = synthetic_views(truth, 6, 0.0, 1);
    std::vector<Rigid> poses;
    for (int i = 0; i < 6; ++i)
        poses.push_back(synthetic_pose(i));
    truth.intrinsics.fx += 3.0;
    const CameraFit fit = fit_camera(views, image_size, calibration_model("radial"),
                                     {.start = CameraStart{truth, poses}});
    EXPECT_EQ(fit.camera.distortion.k3, -0.02);
    EXPECT_EQ(fit.camera.distortion.p1, 0.0012);
    EXPECT_NEAR(fit.camera.intrinsics.fx, 541.0, 1e-8);
    poses.pop_back();
    EXPECT_THAT(fit_error(views, {.start = CameraStart{truth, poses}}),
                HasSubstr("5 poses for 6 views"));
}

TEST(CameraFit, RefusesViewsThatDoNotDetermineTheCamera) {
    const CameraModel truth = calibration_truth();
    std::vector<CalibrationView> square;
    for (int i = 0; i < 4; ++i)
        square.push_back(synthetic_view(
            truth, {Eigen::Quaterniond::Identity(), {-100, -60, 400.0 + 50 * i}}, 0.05, i));
    EXPECT_THAT(fit_error(square), HasSubstr("do not determine"));
    EXPECT_THAT(fit_error(square), HasSubstr("fx"));
}

TEST(CameraFit, RefusesWhatIsNoView) {
    const auto good = synthetic_views(calibration_truth(), 4, 0.1, 2);
    EXPECT_THAT(fit_error({good[0], good[1]}), HasSubstr("2 views, three are needed"));
    const auto broken = [&](const std::function<void(CalibrationView&)>& change) {
        auto views = good;
        change(views[2]);
        return fit_error(views);
    };
    EXPECT_THAT(broken([](auto& v) { v.pixels[7].x() = std::nan(""); }),
                HasSubstr("view 2: point 7 is not finite"));
    EXPECT_THAT(broken([](auto& v) { v.points_mm[5].z() = 1e-9; }),
                HasSubstr("view 2: point 5 is not in the plane"));
    EXPECT_THAT(broken([](auto& v) { v.pixels.pop_back(); }), HasSubstr("54 points but 53 pixels"));
    EXPECT_THAT(broken([](auto& v) { v.sigma_px.assign(54, 0.0); }),
                HasSubstr("standard deviation 0 px"));
    EXPECT_THAT(broken([](auto& v) { v.sigma_px.assign(7, 1.0); }),
                HasSubstr("7 standard deviations"));
    EXPECT_THAT(broken([](auto& v) { v.ids.assign(54, 3); }), HasSubstr("the id 3 is there twice"));
    EXPECT_THAT(broken([](auto& v) {
                    v.points_mm.resize(9);
                    v.pixels.resize(9);
                }),
                HasSubstr("view 2: the points are collinear"));
}

// ---- poses

TEST(ViewPose, IsFoundForACameraWithEveryCoefficient) {
    const CameraModel camera = all_fourteen();
    for (int i = 0; i < 7; ++i) {
        const CalibrationView view = synthetic_view(camera, synthetic_pose(i), 0.0, i);
        const Rigid pose = fit_view_pose(camera, view);
        EXPECT_LT(left_difference(pose, synthetic_pose(i)).norm(), 1e-8) << i;
        for (const Eigen::Vector2d& residual : view_residuals(camera, pose, view))
            EXPECT_LT(residual.norm(), 1e-9);
    }
}

// A board of 200 mm in 6 m distance: the mirrored pose leaves 0.1 px more at most.
TEST(ViewPose, TakesTheBetterOfTwoMirroredPoses) {
    const CameraModel camera = calibration_truth();
    for (int i = 0; i < 7; ++i) {
        Rigid pose = synthetic_pose(i);
        pose.translation.z() += 5500.0;
        const Rigid found = fit_view_pose(camera, synthetic_view(camera, pose, 0.0, i));
        EXPECT_LT(left_difference(found, pose).norm(), 1e-5) << i;
    }
}

TEST(ViewPose, OfPointsBehindTheCameraHasNoResiduals) {
    const CameraModel camera = calibration_truth();
    const CalibrationView view = synthetic_view(camera, synthetic_pose(1), 0.0, 1);
    const Rigid behind{Eigen::Quaterniond::Identity(), {0, 0, -500}};
    EXPECT_THAT(text_of_error<Error>([&] { view_residuals(camera, behind, view); }),
                HasSubstr("no ray near"));
}

// Weak perspective: both poses project the plane's middle alike, and the mirror of the mirror is
// the pose.
TEST(CalibrationStart, AMirroredPoseTiltsTheOtherWay) {
    const Rigid pose = synthetic_pose(2);
    const Eigen::Vector3d centre(100, 62.5, 0);
    const Rigid mirrored = mirrored_pose(pose, centre);
    EXPECT_LT((mirrored * centre - pose * centre).norm(), 1e-9);
    EXPECT_GT(left_difference(mirrored, pose).head<3>().norm(), 0.5);
    EXPECT_LT(left_difference(mirrored_pose(mirrored, centre), pose).norm(), 1e-9);
}

// Two pixels high and one wide, and a barrel: the start is within a few percent.
TEST(CalibrationStart, IsNearTheCamera) {
    const CameraModel webcam = calibration_truth();
    const CameraStart start = calibration_start(synthetic_views(webcam, 8, 0.2, 3), image_size);
    EXPECT_NEAR(start.camera.intrinsics.fx, 541.0, 27.0);
    CameraModel tall = webcam;
    tall.intrinsics.fy = 280.0;
    const CameraStart of_tall = calibration_start(synthetic_views(tall, 8, 0.2, 3), image_size);
    EXPECT_NEAR(of_tall.camera.intrinsics.fx / of_tall.camera.intrinsics.fy, 541.0 / 280.0, 0.15);
}

}  // namespace
}  // namespace etalon
