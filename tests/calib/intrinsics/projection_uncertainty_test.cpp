#include "calib/intrinsics/projection_uncertainty.h"

#include <Eigen/Eigenvalues>

#include "tests/calib/synthetic_views.h"
#include "tests/test.h"

namespace etalon {
namespace {

const PixelUncertainty& nearest(const ProjectionUncertainty& map, double x, double y) {
    return *std::min_element(map.pixels.begin(), map.pixels.end(),
                             [&](const PixelUncertainty& a, const PixelUncertainty& b) {
                                 return (a.pixel - Eigen::Vector2d(x, y)).norm() <
                                        (b.pixel - Eigen::Vector2d(x, y)).norm();
                             });
}

// x = cx + fx u: an error of fx moves a ray by its distance from cx over fx, one of cx by itself.
TEST(ProjectionUncertainty, OfAPinholeIsItsAlgebra) {
    const CameraModel camera = test::camera_with(640, 480, {541, 533, 331, 243}, {});
    const CalibrationModel& model = calibration_model("pinhole");
    Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();
    covariance(0, 0) = 1.5 * 1.5;
    covariance(3, 3) = 0.4 * 0.4;
    const auto map = projection_uncertainty(camera, model, covariance, {});
    const PixelUncertainty& right = nearest(map, 639.5, 479.5);
    EXPECT_EQ(right.pixel, Eigen::Vector2d(639.5, 479.5));
    EXPECT_NEAR(right.held, 1.5 * (639.5 - 331) / 541, 1e-9);
    EXPECT_NEAR(nearest(map, 331, 0).held, 0.4, 1e-3);
    EXPECT_EQ(map.share_among_points(), 0.0);
}

// At 50 000 px the field of view is half a degree and a shift of the principal point is a turn of
// the camera to the square of that.
TEST(ProjectionUncertainty, ARotationTakesBackAShiftOfTheImage) {
    const CameraModel camera = test::camera_with(640, 480, {50000, 50000, 331, 243}, {});
    Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();
    covariance(2, 2) = 1.0;
    const auto map = projection_uncertainty(camera, calibration_model("pinhole"), covariance, {});
    EXPECT_NEAR(map.mean(&PixelUncertainty::held), 1.0, 1e-9);
    EXPECT_LT(map.worst(&PixelUncertainty::rotated), 1e-4);
}

TEST(ProjectionUncertainty, IsTheScatterOfRaysThroughDrawnCameras) {
    const CameraModel camera = test::calibration_truth();
    const CalibrationModel& model = calibration_model("standard");
    Eigen::VectorXd deviations(9);
    deviations << 0.8, 0.7, 0.5, 0.4, 0.004, 0.01, 3e-4, 2e-4, 0.01;
    const Eigen::MatrixXd covariance = deviations.cwiseAbs2().asDiagonal();
    const ImageRays rays = image_rays(camera);
    const std::size_t ray = rays.pixels.size() - 40;
    const int draws = 2000;
    Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
    RandomStream random(3, 1);
    for (int draw = 0; draw < draws; ++draw) {
        CameraModel drawn = camera;
        Eigen::VectorXd values = parameters_of(camera, model);
        for (int i = 0; i < 9; ++i)
            values[i] += deviations[i] * random.normal();
        set_parameters(drawn, model, values);
        const Intrinsics& k = drawn.intrinsics;
        const Eigen::Vector2d d = distort(drawn.distortion, rays.rays[ray].hnormalized()).point;
        const Eigen::Vector2d moved =
            Eigen::Vector2d(k.cx + k.fx * d.x(), k.cy + k.fy * d.y()) - rays.pixels[ray];
        scatter += moved * moved.transpose() / draws;
    }
    const double largest = std::sqrt(
        Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(Eigen::MatrixXd(scatter)).eigenvalues()[1]);
    const auto map = projection_uncertainty(camera, model, covariance, {});
    // Relative standard error of a standard deviation of 2000: 1 / sqrt(4000) = 0.016; 3.5 of it.
    EXPECT_NEAR(map.pixels[ray].held / largest, 1.0, 0.055);
}

// The hull of a triangle of legs 300 and 200 px is 30 000 of 307 200 px^2; a grid of 20 px counts
// it to about its border over the step: 20 of 600 px.
TEST(ProjectionUncertainty, CountsWhatLiesAmongThePoints) {
    const CameraModel camera = test::camera_with(640, 480, {541, 533, 331, 243}, {});
    const std::vector<Eigen::Vector2d> triangle{{100, 100}, {400, 100}, {100, 300}};
    const auto map = projection_uncertainty(camera, calibration_model("pinhole"),
                                            Eigen::Matrix4d::Identity(), triangle);
    EXPECT_NEAR(map.share_among_points(), 30000.0 / 307200.0, 0.02);
    EXPECT_TRUE(nearest(map, 200, 150).among_points);
    EXPECT_FALSE(nearest(map, 350, 260).among_points);
}

TEST(ProjectionDifference, OfACameraThatWasTurnedIsNone) {
    CameraModel camera = test::calibration_truth();
    camera.intrinsics = {20000, 20000, 331, 243};
    CameraModel shifted = camera;
    shifted.intrinsics.cx += 3.0;  // 3/20000 rad; the rest is 3 px times (320/20000)^2
    const ImageRays rays = image_rays(camera);
    const auto same =
        projection_difference(shifted, rays, Eigen::VectorXd::Ones(rays.pixels.size()));
    for (const Eigen::Vector2d& each : same.differences_px)
        EXPECT_LT(each.norm(), 2e-3);
    CameraModel larger = camera;
    larger.intrinsics.fx *= 1.01;
    larger.intrinsics.fy *= 1.01;
    const auto wider =
        projection_difference(larger, rays, Eigen::VectorXd::Ones(rays.pixels.size()));
    for (std::size_t i = 0; i < wider.pixels.size(); ++i)
        // A turn centres the enlargement on the grid, not on the principal point.
        EXPECT_NEAR(wider.differences_px[i].x(), 0.01 * (wider.pixels[i].x() - 319.5), 5e-3);
}

TEST(CrossValidation, NeedsSixViews) {
    const auto views = test::synthetic_views(test::calibration_truth(), 5, 0.2, 1);
    const CalibrationModel& model = calibration_model("radial");
    const CameraFit fit = fit_camera(views, test::image_size, model);
    EXPECT_THROW(cross_validate(views, fit), NumericalError);
}

}  // namespace
}  // namespace etalon
